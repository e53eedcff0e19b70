import type { ReactElement } from "react";
import { go, placeHash, type Filters as Chosen } from "../shared/address/location";
import { roomTexts } from "../shared/roomTexts";
import { useApi } from "../shared/api/api";
import { usePages } from "../shared/api/usePages";
import type { VerdictSummary } from "../shared/api/records";
import { actionNoun, count, dayAndTime, length, likelihood } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { LiveStore, Topic } from "../shared/live/store";
import { heightOff, refutedBy } from "../shared/refuted";
import { asked, Filters } from "../sessions/Filters";
import { differing } from "../sessions/words";
import { lookTexts, sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { Symbol } from "../shared/ui/Symbol";
import { Scroll } from "../shared/ui/Scroll";
import { verdictTexts as t } from "./texts";

const PADS: readonly Topic[] = ["pads"];
const VERDICTS: readonly Topic[] = ["verdicts"];
const PAGE = 50;

function worst(verdict: VerdictSummary): { error_mm: number; likelihood_ppm?: number } | undefined {
  const by = refutedBy(verdict);
  // The ranges of one that bent its clock fit; what refutes it has an error, and no likelihood of its own.
  const stamps_mm = by === "stamps" ? differing(verdict) : undefined;
  if (stamps_mm !== undefined) return { error_mm: stamps_mm };
  const height_mm = by === "height" ? heightOff(verdict) : undefined;
  if (height_mm !== undefined) return { error_mm: Math.abs(height_mm) };
  const { signed, broadcast } = verdict;
  if (by !== "broadcast") return signed;
  return broadcast?.error_mm === undefined ? undefined : { error_mm: broadcast.error_mm, ...(broadcast.likelihood_ppm !== undefined && { likelihood_ppm: broadcast.likelihood_ppm }) };
}

function Row({ verdict, padName, now_ms }: { verdict: VerdictSummary; padName: string; now_ms: number }): ReactElement {
  const judged = worst(verdict);
  return (
    <tr>
      <td>
        <a className={`outcome look-${verdict.outcome}`} href={placeHash({ room: "sessions", session: verdict.session_id })}>
          <Symbol look={verdict.outcome} size={18} />
          {lookTexts(verdict.outcome)}
        </a>
      </td>
      <td>
        <b>{verdict.uav_id}</b>
      </td>
      <td>{padName}</td>
      <td>
        {t("permissionIs", { deed: actionNoun(verdict.action), permission: verdict.permission })}
      </td>
      <td className="right">{judged === undefined ? "–" : length(judged.error_mm)}</td>
      <td className="right">{judged?.likelihood_ppm === undefined ? "–" : likelihood(judged.likelihood_ppm)}</td>
      <td className="right">{count(verdict.rounds)}</td>
      <td className="right">{verdict.assurance}</td>
      <td>{dayAndTime(verdict.decided_ms, now_ms)}</td>
      <td className="right">{count(verdict.block)}</td>
      <td>
        <Hash value={verdict.tx_id} label={sharedTexts("transaction")} />
      </td>
    </tr>
  );
}

function newestVerdict(store: LiveStore): string {
  return store.verdictsByTime()[0]?.tx_id ?? "";
}

function show(filters: Chosen): void {
  go({ room: "verdicts", filters }, true);
}

/** All verdicts as a table, the newest first: what the map shows, in words and figures. */
export function VerdictsPage({ filters }: { filters: Chosen }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const pads = useLive(PADS, (store) => [...store.pads.values()]);
  const store = useLiveStore();
  const mark = useLive(VERDICTS, newestVerdict);
  const { query, rows } = usePages(
    ["verdicts", filters],
    (cursor) => api.verdicts({ ...asked(filters), limit: PAGE, ...(cursor !== undefined && { cursor }) }),
    { keep: true, fresh: { mark: mark, newest: () => newestVerdict(store) } },
  );
  return (
    <div className="page">
      <div className="page-head">
        <h1>{t("verdicts")}</h1>
      </div>
      <Filters filters={filters} onFilters={show} />
      <Scroll label={roomTexts("verdicts")} className="table-frame float" busy={query.isPlaceholderData}>
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("verdict")}</th>
              <th scope="col">{t("drone")}</th>
              <th scope="col">{t("pad")}</th>
              <th scope="col">{t("permission")}</th>
              <th scope="col" className="right">
                {t("error")}
              </th>
              <th scope="col" className="right">
                {t("likelihood")}
              </th>
              <th scope="col" className="right">
                {t("rounds")}
              </th>
              <th scope="col" className="right">
                {t("assurance")}
              </th>
              <th scope="col">{t("decided")}</th>
              <th scope="col" className="right">
                {t("block")}
              </th>
              <th scope="col">{t("transaction")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((verdict) => (
              <Row
                key={verdict.tx_id}
                verdict={verdict}
                padName={pads.find(({ pad_id }) => pad_id === verdict.pad_id)?.name ?? verdict.pad_id}
                now_ms={now_ms}
              />
            ))}
          </tbody>
        </table>
        <More query={query} empty={t(Object.keys(filters).length === 0 ? "none" : "noneFits")} count={rows.length} />
      </Scroll>
    </div>
  );
}
