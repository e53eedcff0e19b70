import type { Alert, Pad } from "../shared/api/records";
import type { Look } from "../shared/drones";
import { oddity } from "../sessions/broadcastTexts";
import { actionVerb, age, count, day, length } from "../shared/format";
import type { Phrase } from "../shared/i18n/texts";
import { alertTexts as t, driftTexts } from "./texts";

const ACTIONS = ["land", "takeoff", "dock"] as const;

function fact(alert: Alert, name: string): string | number | undefined {
  const value: unknown = alert.facts[name];
  return typeof value === "string" || typeof value === "number" ? value : undefined;
}

function number(alert: Alert, name: string): number | undefined {
  const value = fact(alert, name);
  return typeof value === "number" ? value : undefined;
}

/** Until when what it tells of went on. */
function until({ state, over_ms }: Alert, now_ms: number): number {
  return state === "returned" || state === "over" ? (over_ms ?? now_ms) : now_ms;
}

/** What a pad's anchors found when they ranged each other. */
function drift(alert: Alert): string {
  const state = fact(alert, "state");
  const anchor = fact(alert, "anchor_id");
  const off_mm = number(alert, "off_mm");
  const extra_mm = number(alert, "extra_sigma_mm") ?? 0;
  // Alerts of former versions have the English sentence only.
  if (state === undefined) return driftTexts("said", { why: fact(alert, "why") ?? t("unknown") });
  if (state === "moved" && anchor !== undefined && off_mm !== undefined) return driftTexts("moved", { anchor, off: length(off_mm, true) });
  return driftTexts("drifting", { anchor: anchor ?? "all", more: extra_mm === 0 ? "none" : length(extra_mm, true) });
}

/** The alert in one sentence, in the user's language and units. What it does not know it calls unknown. */
export function sentence(alert: Alert, pads: ReadonlyMap<string, Pad>, now_ms: number): Phrase[] {
  const error_mm = fact(alert, "error_mm");
  const action = ACTIONS.find((each) => each === fact(alert, "action"));
  const since_ms = fact(alert, "since_ms");
  const until_ms = fact(alert, "until_ms");
  const unknown = t("unknown");
  return t.rich(alert.kind, {
    uav: alert.uav_id ?? unknown,
    pad: alert.pad_id === undefined ? unknown : (pads.get(alert.pad_id)?.name ?? alert.pad_id),
    distance: typeof error_mm === "number" ? length(error_mm, true) : unknown,
    action: action === undefined ? unknown : actionVerb(action),
    since: typeof since_ms === "number" ? age(until(alert, now_ms) - since_ms) : unknown,
    until: typeof until_ms === "number" ? day(until_ms) : unknown,
    who: fact(alert, "who") ?? unknown,
    why: fact(alert, "why") ?? unknown,
    code: fact(alert, "zone") === undefined && fact(alert, "code") === "zone_active" ? "" : (fact(alert, "code") ?? ""),
    zone: fact(alert, "zone") ?? "",
    drift: drift(alert),
    supported: alert.facts["supported"] === true ? "yes" : "no",
    state: fact(alert, "state") ?? "",
    drones: count(number(alert, "drones") ?? 0),
    what: oddity({
      kind: String(fact(alert, "finding") ?? ""),
      distance_mm: number(alert, "distance_mm"),
      interval_ms: number(alert, "interval_ms"),
      other_uav_id: String(fact(alert, "other_uav_id") ?? unknown),
    }),
  });
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
