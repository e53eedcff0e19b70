import type { ReactElement } from "react";
import { usePages } from "../shared/api/usePages";
import { useApi } from "../shared/api/api";
import { dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { More } from "../shared/ui/More";
import { Symbol } from "../shared/ui/Symbol";
import { padClosures, type PadClosures } from "./calls";
import { zonesHref } from "./links";
import { TypeTag } from "./looks";
import { zoneTexts as t } from "./texts";

const LOOKS = { open: "unproved", missing: "refuted", current: "verified", ending: "inconclusive", differs: "refuted", outdated: "refuted" } as const;

export function PadState({ state }: { state: PadClosures["state"] }): ReactElement {
  return (
    <span className={`zone-state look-${LOOKS[state]}`}>
      <Symbol look={LOOKS[state]} size={14} /> {t("padState", { state })}
    </span>
  );
}

/** Each pad: which zones reach it, and whether the ledger knows what follows from them. */
export function PadsPage(): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(30_000);
  const { query, rows } = usePages(["zones", "pads"], (cursor) => padClosures(api, cursor), { keep: true });
  return (
    <>
      <div className="zones-intro">
        <p className="lead">{t("padsIntro")}</p>
      </div>
      <div className="float table-frame">
        {rows.length > 0 && (
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("pad")}</th>
                <th scope="col">{t("state")}</th>
                <th scope="col">{t("touching")}</th>
                <th scope="col">{t("published")}</th>
              </tr>
            </thead>
            <tbody>
              {rows.map((each) => (
                <tr key={each.pad_id}>
                  <th scope="row">
                    <a className="outcome" href={zonesHref(["pads", each.pad_id])}>
                      {each.name}
                    </a>{" "}
                    <span className="quiet">{each.pad_id}</span>
                  </th>
                  <td>
                    <PadState state={each.state} />
                  </td>
                  <td>
                    {each.zones.length === 0 ? <span className="quiet">{t("noneTouching")}</span> : null}
                    <span className="zone-chips">
                      {each.zones.slice(0, 4).map((zone) => (
                        <TypeTag key={zone.zone_id} type={zone.type} active={zone.active} />
                      ))}
                      {each.zones.length > 4 && t("moreRows", { count: each.zones.length - 4 })}
                    </span>
                  </td>
                  <td>{each.published === undefined ? t("never") : dayAndTime(each.published.valid_until_ms, now_ms)}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <More query={query} empty={t("noPads")} count={rows.length} />
      </div>
    </>
  );
}
