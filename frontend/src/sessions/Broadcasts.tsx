import type { ReactElement } from "react";
import type { SessionDetail, Track, VerdictSummary } from "../shared/api/records";
import { count, sentenceCase, timeOfDay } from "../shared/format";
import { isContradicted } from "../shared/refuted";
import { Scroll } from "../shared/ui/Scroll";
import { broadcastTexts as t, oddity, signature } from "./broadcastTexts";

/** Who signed the broadcasts during the session (not whether they are true), and what was odd about them. */
export function Broadcasts({ detail, verdict, track }: { detail: SessionDetail; verdict: VerdictSummary | undefined; track?: Track | undefined }): ReactElement {
  const { findings, summary } = detail;
  const running = summary.ended_ms === undefined && (track?.drip?.t_ms ?? 0) >= summary.requested_ms;
  const drip = detail.signature ?? (running ? track?.drip : undefined);
  const refused = drip?.state === "refused" ? 0 : (detail.signature?.refused ?? 0);
  return (
    <section className="float card">
      <h2>{t("title")}</h2>
      <p className="quiet">{t("hint")}</p>
      {drip !== undefined && (
        <dl className="facts num">
          <div>
            <dt>{t("signature")}</dt>
            <dd>
              {signature(drip)}
              {refused > 0 && <span className="quiet"> {t("besides", { count: count(refused) })}</span>}
            </dd>
          </div>
        </dl>
      )}
      {findings.length === 0 ? (
        <p>{t(verdict !== undefined && isContradicted(verdict) ? "contradicted" : "nothing")}</p>
      ) : (
        <Scroll label={t("title")}>
          <table className="table num">
            <tbody>
              {findings.map((each) => (
                <tr key={`${each.kind}/${each.t_ms}`}>
                  <td>{timeOfDay(each.t_ms)}</td>
                  <td>{sentenceCase(oddity(each.kind, { ...(each.distance_mm !== undefined && { distance_mm: each.distance_mm }), ...(each.interval_ms !== undefined && { interval_ms: each.interval_ms }), ...(each.other_uav_id !== undefined && { other_uav_id: each.other_uav_id }) }))}</td>
                  <td className="right">{each.count > 1 && t("times", { count: count(each.count) })}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </Scroll>
      )}
    </section>
  );
}
