import { STEP_NAMES, type SessionSummary, type Step, type StepName } from "../shared/api/records";
import { actionVerb, count } from "../shared/format";
import { detailText } from "./ends";
import { stepTexts as t } from "./texts";

export type StepRow = {
  step: StepName;
  number: number;
  name: string;
  state: "done" | "failed" | "refused" | "now" | "waiting" | "never";
  /** Since the step before; undefined for the first and where that is not known. */
  took_ms?: number;
  t_ms?: number;
  detail?: string;
  tx_id?: string;
  source?: Step["source"];
};

function stepName(step: StepName, session: SessionSummary): string {
  if (step === "range" && session.rounds !== undefined && session.rounds > 0) return t("rangeRounds", { rounds: count(session.rounds) });
  return step === "permission" ? t("permissionTo", { action: actionVerb(session.action) }) : t("name", { step });
}

function transaction(session: SessionSummary, step: StepName): string | undefined {
  if (step === "request") return session.request_tx;
  if (step === "verdict") return session.verdict_tx;
  return step === "permission" ? session.complete_tx : undefined;
}

/**
 * The eight steps of a session, reached or not, with the time each took after the one before.
 *
 * Ledger and pad have their own clocks: a step may seem to come before the last; then it took "no time".
 */
export function stepRows(session: SessionSummary): StepRow[] {
  const reported = new Map(session.steps.map((step) => [step.step, step]));
  const last = session.steps.reduce((most, { step }) => Math.max(most, STEP_NAMES.indexOf(step)), 0);
  const running = session.state === "requested";
  let before_ms: number | undefined;
  return STEP_NAMES.map((step, index): StepRow => {
    const report = reported.get(step);
    const row: StepRow = { step, number: index + 1, name: stepName(step, session), state: "waiting" };
    const tx_id = transaction(session, step);
    if (tx_id !== undefined) row.tx_id = tx_id;
    if (report === undefined) {
      const decided = session.state === "decided" || session.state === "completed";
      if (step === "permission" && session.permission !== undefined) {
        row.state = session.permission === "granted" ? "done" : "refused";
        row.detail = t("permission", { permission: session.permission });
      } else if ((step === "request" || (step === "verdict" && decided)) && tx_id !== undefined) {
        row.state = "done";
        row.t_ms = step === "request" ? session.requested_ms : (session.decided_ms ?? session.requested_ms);
      } else if (running) row.state = index === last + 1 ? "now" : "waiting";
      else row.state = "never";
      return row;
    }
    row.t_ms = report.t_ms;
    row.source = report.source;
    row.state = report.ok ? "done" : step === "permission" ? "refused" : "failed";
    // The name says how many rounds there were, and the panel's head what the verdict is.
    const said = (step === "range" && session.rounds !== undefined && report.ok) || step === "verdict";
    if (report.detail !== undefined && !said) row.detail = detailText(report.detail);
    if (step === "permission") {
      if (session.permission !== undefined) row.detail = t("permission", { permission: session.permission });
      if (session.permission === "refused") row.state = "refused";
    }
    if (step === "verdict" && session.outcome !== undefined) {
      row.state = session.outcome === "verified" ? "done" : "failed";
    }
    if (before_ms !== undefined) row.took_ms = Math.max(0, report.t_ms - before_ms);
    before_ms = report.t_ms;
    return row;
  });
}
