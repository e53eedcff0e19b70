import type { Alert, Pad } from "../shared/api/records";
import type { Look } from "../shared/drones";
import { oddity } from "../sessions/broadcastTexts";
import { shownFacts, type Facts } from "../shared/i18n/facts";
import type { Phrase } from "../shared/i18n/texts";
import { alertTexts as t, alertTitles } from "./texts";

/** What its text needs, of what it has; as the user reads it. */
function facts({ facts: its, uav_id, pad_id }: Alert, pads: ReadonlyMap<string, Pad>): Facts {
  const plain = Object.entries(its).filter((each): each is [string, string | number] => typeof each[1] === "string" || typeof each[1] === "number");
  return { ...Object.fromEntries(plain), ...(uav_id !== undefined && { uav_id }), ...(pad_id !== undefined && { pad_id: pads.get(pad_id)?.name ?? pad_id }) };
}

/** The alert in one sentence, in the user's language and units. */
export function sentence(alert: Alert, pads: ReadonlyMap<string, Pad>): Phrase[] {
  const its = facts(alert, pads);
  const what = oddity(String(its["finding"] ?? ""), its);
  return t.rich(alert.kind, shownFacts(t.all.en[alert.kind], { ...its, what }, true));
}

/** What it is, in a word or two. */
export function alertTitle(kind: string): string {
  return kind in alertTitles.all.en ? alertTitles(kind as Alert["kind"]) : kind;
}

/** The symbol: that of the verdict where the alert is about one, else the triangle of a warning. */
export function lookOf(alert: Alert): Look {
  if (alert.kind === "pad_silent") return "silent";
  return alert.severity === "critical" ? "refuted" : "inconclusive";
}

/** Nobody has acknowledged it, whether or not its cause goes on. */
export function wantsSomebody({ state }: Alert): boolean {
  return state === "open" || state === "returned";
}

/** Somebody has put it off. */
export function isAsleep(alert: Alert, now_ms: number): boolean {
  return wantsSomebody(alert) && (alert.snoozed_until_ms ?? 0) > now_ms;
}

/** In the inbox. */
export function isWaiting(alert: Alert, now_ms: number): boolean {
  return wantsSomebody(alert) && !isAsleep(alert, now_ms);
}
