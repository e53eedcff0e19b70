import type { ReactElement } from "react";
import type { SessionSummary } from "../shared/api/records";
import { duration, timeOfDay } from "../shared/format";
import { Hash } from "../shared/ui/Hash";
import { sharedTexts } from "../shared/texts";
import { stepRows, type StepRow } from "./stepRows";
import { stepTexts as t } from "./texts";

function Dot({ row, session }: { row: StepRow; session: SessionSummary }): ReactElement {
  const tone =
    row.step === "verdict" && session.outcome === "inconclusive"
      ? "maybe"
      : { done: "ok", failed: "bad", refused: "bad", now: "accent", waiting: "line", never: "line" }[row.state];
  const hollow = row.state === "waiting" || row.state === "never" || row.state === "refused";
  return (
    <svg className="symbol" width="16" height="16" viewBox="0 0 20 20" role="img" aria-label={t("state", { state: row.state })}>
      {row.state === "now" ? (
        <>
          <circle cx="10" cy="10" r="6" fill="none" stroke="var(--line)" strokeWidth="3" />
          <path className="arc" d="M10 4a6 6 0 0 1 6 6" fill="none" stroke="var(--accent)" strokeWidth="3" />
        </>
      ) : (
        <circle
          cx="10"
          cy="10"
          r="5"
          fill={hollow ? "none" : `var(--${tone})`}
          stroke={`var(--${row.state === "waiting" || row.state === "never" ? "control" : tone})`}
          strokeWidth="2"
        />
      )}
    </svg>
  );
}

/** The eight steps with times and transaction ids, filling in while they happen. */
export function Steps({ session }: { session: SessionSummary }): ReactElement {
  return (
    <section className="steps" aria-label={t("title")}>
      <ol className="num">
        {stepRows(session).map((row) => (
          <li key={row.step} className={`step step-${row.state}`}>
            <Dot row={row} session={session} />
            <span className="step-name" title={row.detail}>
              {row.number} {row.name}
              {row.detail !== undefined && <span className="quiet"> · {row.detail}</span>}
            </span>
            {row.tx_id !== undefined && <Hash value={row.tx_id} label={sharedTexts("transaction")} />}
            <span className="step-time quiet" title={row.t_ms === undefined ? undefined : timeOfDay(row.t_ms)}>
              {row.took_ms !== undefined ? duration(row.took_ms) : row.t_ms === undefined ? "" : timeOfDay(row.t_ms)}
            </span>
          </li>
        ))}
      </ol>
      <p className="note">{t("note")}</p>
    </section>
  );
}
