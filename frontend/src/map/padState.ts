import type { Pad } from "../shared/api/records";
import { age, count } from "../shared/format";
import { padTexts as t } from "./texts";

/** A pad's agent tells its health every ten seconds. */
export const STALE_MS = 35_000;
/** So many records wait at a pad that reports faster than it is heard. */
export const LAGGING_RECORDS = 200;
/** Fewer one-time keys than this will soon be none. */
export const FEW_PREKEYS = 5;

export type PadTone = "ok" | "maybe" | "bad";
export type PadState = { tone: PadTone; text: string };

/** Who has the pad, or for whom it is kept, and how many wait for it, in words; undefined where nobody does either. */
export function inUse({ queue }: Pad, now_ms: number): string | undefined {
  if (queue === undefined) return undefined;
  const occupant = queue.occupant !== undefined && now_ms < queue.occupant.until_ms ? queue.occupant : undefined;
  const next = queue.reservation;
  const kept = occupant === undefined && next !== undefined && next.from_ms <= now_ms && now_ms < next.until_ms ? next : undefined;
  if (occupant === undefined && kept === undefined && queue.waiting === 0) return undefined;
  const by = occupant !== undefined ? String(occupant.landed) : kept !== undefined ? "kept" : "nobody";
  return t("inUse", { landed: by, uav: (occupant ?? kept)?.uav_id ?? "", waiting: queue.waiting });
}

/** How a pad does, the gravest first, in words. What its agent says of itself is not from the ledger. */
export function padState(pad: Pad, now_ms: number): PadState {
  const state = condition(pad, now_ms);
  const use = inUse(pad, now_ms);
  if (use === undefined) return state;
  return { ...state, text: state.tone === "ok" ? use : `${state.text} · ${use}` };
}

function condition(pad: Pad, now_ms: number): PadState {
  const bad = (text: string): PadState => ({ tone: "bad", text });
  const maybe = (text: string): PadState => ({ tone: "maybe", text });
  const { commissioning, health } = pad;
  if (!commissioning) return maybe(t("notCommissioned"));
  if (commissioning.valid_until_ms <= now_ms) return bad(t("expired"));
  if (!health) return bad(t("neverHeard"));
  if (!health.connected) return bad(t("disconnected", { age: age(now_ms - health.t_ms) }));
  const down = health.anchors.filter(({ state }) => state !== "up").length;
  if (down > 0) return bad(t("anchorsDown", { down, all: health.anchors.length }));
  if (health.drift?.state === "moved") return bad(t("moved"));
  if (now_ms - health.t_ms > STALE_MS) return maybe(t("stale", { age: age(now_ms - health.t_ms) }));
  const { spool } = health;
  if (spool !== undefined && spool.dropped > 0 && spool.records > 0) return maybe(t("congested", { records: count(spool.dropped) }));
  if (spool !== undefined && spool.records > LAGGING_RECORDS) return maybe(t("lagging", { records: count(spool.records) }));
  if (health.drift?.state === "drifting") return maybe(t("drifting"));
  if (health.prekeys !== undefined && health.prekeys < FEW_PREKEYS) return maybe(t("prekeys", { count: health.prekeys }));
  return { tone: "ok", text: t("ok") };
}

const ORDER: readonly PadTone[] = ["bad", "maybe", "ok"];

/** Pads that are not retired, those that somebody should look at first. */
export function padsByNeed(pads: Iterable<Pad>, now_ms: number): { pad: Pad; state: PadState }[] {
  return [...pads]
    .filter(({ status }) => status !== "retired")
    .map((pad) => ({ pad, state: padState(pad, now_ms) }))
    .sort((a, b) => ORDER.indexOf(a.state.tone) - ORDER.indexOf(b.state.tone) || a.pad.name.localeCompare(b.pad.name));
}
