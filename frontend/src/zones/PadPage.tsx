import { useQuery } from "@tanstack/react-query";
import { useState, type ReactElement } from "react";
import { useApi } from "../shared/api/api";
import { count, dayAndTime, length } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import type { Change } from "../shared/signing/flow";
import { SignPanel } from "../shared/signing/SignPanel";
import { More } from "../shared/ui/More";
import { closuresOf, plan, type ClosurePlan, type PadClosures } from "./calls";
import { zonesHref } from "./links";
import { TypeTag } from "./looks";
import { PadState } from "./PadsPage";
import { Scroll } from "./Scroll";
import { zoneTexts as t } from "./texts";
import { holding, nameOf } from "./words";

const DAYS = [3, 7, 14, 30, 90] as const;
const SHOWN = 12;
const ROLES = ["admin"] as const;

function Touching({ zones, now_ms }: { zones: PadClosures["zones"]; now_ms: number }): ReactElement {
  if (zones.length === 0) return <p className="empty">{t("noneTouching")}</p>;
  return (
    <Scroll name={t("touching")}>
      <table className="table num">
        <thead>
          <tr>
            <th scope="col">{t("zone")}</th>
            <th scope="col">{t("typeName")}</th>
            <th scope="col">{t("now")}</th>
            <th scope="col">{t("distance")}</th>
            <th scope="col">{t("effect")}</th>
          </tr>
        </thead>
        <tbody>
          {zones.map((zone) => (
            <tr key={zone.zone_id}>
              <th scope="row">
                <a className="outcome" href={zonesHref(["list", zone.zone_id])}>
                  {nameOf(zone)}
                </a>
              </th>
              <td>
                <TypeTag type={zone.type} active={zone.active} />
              </td>
              <td>{holding(zone, now_ms)}</td>
              <td>{zone.distance_m === 0 ? t("covers") : length(zone.distance_m * 1000, true)}</td>
              <td>
                {t(zone.closes ? "closes" : "closesNot")} {zone.reaches === "perhaps" && <span className="quiet">({t("perhaps")})</span>}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </Scroll>
  );
}

function Due({ due, now_ms }: { due: ClosurePlan; now_ms: number }): ReactElement {
  const until = dayAndTime(due.valid_until_ms, now_ms);
  if (due.closures.length === 0) return <p>{t("nothing", { until })}</p>;
  return (
    <>
      <p>{t("dueIs", { count: due.closures.length, until })}</p>
      <Scroll name={t("due")}>
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("zone")}</th>
              <th scope="col">{t("fromWhen")}</th>
              <th scope="col">{t("untilWhen")}</th>
            </tr>
          </thead>
          <tbody>
            {due.closures.slice(0, SHOWN).map((each) => (
              <tr key={`${each.zone_id}/${each.from_ms}`}>
                <th scope="row">{each.zone_id}</th>
                <td>{dayAndTime(each.from_ms, now_ms)}</td>
                <td>{dayAndTime(each.until_ms, now_ms)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
      {due.closures.length > SHOWN && <p className="quiet">{t("moreRows", { count: count(due.closures.length - SHOWN) })}</p>}
    </>
  );
}

/** What follows from today's zones, to be looked at and signed. */
function Publish({ pad, now_ms, onDone }: { pad: PadClosures; now_ms: number; onDone: () => void }): ReactElement {
  const api = useApi();
  const [days, setDays] = useState(14);
  const [signing, setSigning] = useState<Change>();
  const query = useQuery({ queryKey: ["zones", "plan", pad.pad_id, days], queryFn: () => plan(api, pad.pad_id, days) });
  const due = query.data;
  const begin = (argument: ClosurePlan): void => {
    const { published } = pad;
    const seen = published === undefined ? ("nothing" as const) : { block: published.block, tx_index: published.tx_index };
    setSigning({ name: "SetClosures", argument, seen });
  };
  if (signing !== undefined) {
    return (
      <SignPanel
        change={signing}
        roles={ROLES}
        summary={<Due due={signing.argument as ClosurePlan} now_ms={now_ms} />}
        onDone={onDone}
        onBack={() => {
          setSigning(undefined);
          onDone();
        }}
        conflict={
          <>
            <p>{t("conflict")}</p>
            <button
              type="button"
              className="button"
              onClick={() => {
                setSigning(undefined);
                onDone();
              }}
            >
              {t("reload")}
            </button>
          </>
        }
      />
    );
  }
  return (
    <>
      <label className="inline-field">
        {t("days")}
        <select value={days} onChange={({ target }) => setDays(Number(target.value))}>
          {DAYS.map((each) => (
            <option key={each}>{each}</option>
          ))}
        </select>
      </label>
      {due === undefined ? (
        <More query={{ ...query, hasNextPage: false, isFetchingNextPage: false, fetchNextPage: () => undefined }} empty="" count={0} />
      ) : (
        <>
          <Due due={due} now_ms={now_ms} />
          <div className="form-actions">
            <button type="button" className="button primary" onClick={() => begin(due)}>
              {t("publish")}
            </button>
          </div>
        </>
      )}
    </>
  );
}

/** One pad: its zones, what the ledger has, and what it should have. */
export function PadPage({ pad_id }: { pad_id: string }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(30_000);
  const query = useQuery({ queryKey: ["zones", "pads", pad_id], queryFn: () => closuresOf(api, pad_id) });
  const pad = query.data;
  return (
    <>
      <p className="zones-bar">
        <a href={zonesHref(["pads"])}>← {t("back")}</a>
      </p>
      {pad === undefined ? (
        <div className="float">
          <More query={{ ...query, hasNextPage: false, isFetchingNextPage: false, fetchNextPage: () => undefined }} empty="" count={0} />
        </div>
      ) : (
        <>
          <section className="float card">
            <div className="zones-head">
              <h2>
                {pad.name} <span className="quiet num">{pad.pad_id}</span>
              </h2>
              <PadState state={pad.state} />
            </div>
            <p className="lead">{t("padHint", { state: pad.state })}</p>
            {pad.published !== undefined && (
              <p className="quiet num">
                {t("published")} {dayAndTime(pad.published.valid_until_ms, now_ms)} · {pad.published.set_by}, {dayAndTime(pad.published.set_ms, now_ms)}
              </p>
            )}
          </section>
          <section className="float card">
            <h2>{t("touching")}</h2>
            <Touching zones={pad.zones} now_ms={now_ms} />
          </section>
          <section className="float card">
            <h2>{t("due")}</h2>
            <Publish pad={pad} now_ms={now_ms} onDone={() => void query.refetch()} />
          </section>
        </>
      )}
    </>
  );
}
