import type { ReactElement } from "react";
import { usePages } from "../shared/api/usePages";
import { useApi } from "../shared/api/api";
import { useServerNow } from "../shared/live/useLive";
import { More } from "../shared/ui/More";
import { zones } from "./calls";
import { toZones, zonesHref } from "./links";
import { TYPES, TypeTag } from "./looks";
import { zoneTexts as t } from "./texts";
import { heights, holding, nameOf } from "./words";

const PAGE = 100;

/** Every zone that is in force; the map's zones as a table. */
export function ListPage({ type: asked }: { type: string | undefined }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(30_000);
  const type = TYPES.find((each) => each === asked);
  const { query, rows } = usePages(["zones", "list", type], (cursor) =>
    zones(api, { limit: PAGE, ...(type !== undefined && { type }), ...(cursor !== undefined && { cursor }) }), { keep: true });
  return (
    <>
      <div className="zones-bar">
        <label className="inline-field">
          {t("typeName")}
          <select value={type ?? ""} onChange={({ target }) => toZones(["list"], target.value === "" ? {} : { type: target.value }, true)}>
            <option value="">{t("every")}</option>
            {TYPES.map((each) => (
              <option key={each} value={each}>
                {t("type", { type: each })}
              </option>
            ))}
          </select>
        </label>
        <a className="button" href="/api/v1/zones/export" download="zones.ed318.json">
          {t("export")}
        </a>
      </div>
      <div className="float table-frame" aria-busy={query.isPlaceholderData}>
        {rows.length > 0 && (
          <table className="table num">
            <thead>
              <tr>
                <th scope="col">{t("zone")}</th>
                <th scope="col">{t("typeName")}</th>
                <th scope="col">{t("now")}</th>
                <th scope="col">{t("heights")}</th>
                <th scope="col">{t("source")}</th>
              </tr>
            </thead>
            <tbody>
              {rows.map((zone) => (
                <tr key={zone.zone_id}>
                  <th scope="row">
                    <a className="outcome" href={zonesHref(["list", zone.zone_id])}>
                      {nameOf(zone)}
                    </a>{" "}
                    {zone.name !== undefined && <span className="quiet">{zone.zone_id}</span>}
                  </th>
                  <td>
                    <TypeTag type={zone.type} active={zone.active} />
                  </td>
                  <td>{holding(zone, now_ms)}</td>
                  <td>{heights(zone).join("; ")}</td>
                  <td>{zone.source}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        <More query={query} empty={t("noZones")} count={rows.length} />
      </div>
    </>
  );
}
