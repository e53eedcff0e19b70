import type { Estimate, Pad, SessionSummary, Track, VerdictSummary } from "./api/records";
import { distance_mm, type Place } from "./geo/frame";
import type { LiveStore } from "./live/store";
import { isContradicted, refutedBy } from "./refuted";

/** What a drone looks like everywhere: one shape and one colour for each. */
export type Look = "verified" | "refuted" | "inconclusive" | "unproved" | "out-of-range" | "silent" | "proving";

export type Group = "needs-you" | "proving" | "verified" | "other";

export type Drone = {
  uav_id: string;
  look: Look;
  group: Group;
  /** What needs the officer has a reason, worst first in the list. */
  need?: "refuted" | "broadcast-refuted" | "impersonation" | "inconclusive" | "not-authorised" | "no-verdict";
  /** When what the row tells happened. */
  t_ms: number;
  track?: Track;
  session?: SessionSummary;
  verdict?: VerdictSummary;
  estimate?: Estimate;
  nearest?: { pad: Pad; distance_mm: number };
};

/** A drone whose broadcast was not heard for this long is silent. */
export const SILENT_MS = 10_000;
/** A verdict speaks of a moment; after this long it no longer says how a drone stands. */
export const VERDICT_HOLDS_MS = 10 * 60_000;
/** A drone unheard for this long is no longer in the air as far as anybody knows; what needs the officer stays. */
export const GONE_MS = 2 * 60_000;

/** The looks by the numbers that columns of them hold. */
export const LOOKS: readonly Look[] = ["refuted", "inconclusive", "verified", "proving", "unproved", "out-of-range", "silent"];

const NEED_ORDER = ["refuted", "broadcast-refuted", "impersonation", "inconclusive", "not-authorised", "no-verdict"] as const;
const GROUP_ORDER: readonly Group[] = ["needs-you", "proving", "verified", "other"];
export function nearestPad(place: Place, pads: Iterable<Pad>): Drone["nearest"] {
  let best: Drone["nearest"];
  for (const pad of pads) {
    if (pad.status === "retired") continue;
    const distance = distance_mm(place, pad);
    if (best === undefined || distance < best.distance_mm) best = { pad, distance_mm: distance };
  }
  return best;
}

function needOf(verdict: VerdictSummary): Drone["need"] {
  if (refutedBy(verdict) === "broadcast") return "broadcast-refuted";
  if (verdict.outcome === "refuted") return "refuted";
  if (isContradicted(verdict)) return "impersonation";
  if (verdict.outcome === "inconclusive") return "inconclusive";
  return verdict.permission === "refused" ? "not-authorised" : undefined;
}

type Parts = Pick<Drone, "uav_id" | "track" | "session" | "verdict" | "estimate">;

/** What a session or verdict makes of a drone; undefined where they say nothing any more, and only what is heard does. */
function judged({ session, verdict }: Parts): Pick<Drone, "look" | "group" | "t_ms" | "need"> | undefined {
  if (session?.state === "requested") {
    return { look: "proving", group: "proving", t_ms: session.steps.at(-1)?.t_ms ?? session.requested_ms };
  }
  if (verdict !== undefined && verdict.session_id === session?.session_id) {
    const need = needOf(verdict);
    const group = need === undefined ? "verified" : "needs-you";
    return { look: verdict.outcome, group, t_ms: verdict.decided_ms, ...(need !== undefined && { need }) };
  }
  if (session?.state === "cancelled") {
    const t_ms = session.steps.at(-1)?.t_ms ?? session.requested_ms;
    return { look: "unproved", group: "needs-you", need: "no-verdict", t_ms };
  }
  return undefined;
}

/**
 * A session as it stands at a time: one that nobody decided before its end is over, whether or not anybody has said so
 * on the ledger.
 */
export function asOf(session: SessionSummary, now_ms: number): SessionSummary {
  if (session.state !== "requested" || now_ms <= session.expires_ms) return session;
  return { ...session, state: "cancelled", end: "expired" };
}

/** The session that speaks of a drone at a time: the newest, as long as it is not too old. */
function holding(store: LiveStore, session: SessionSummary | undefined, verdict: VerdictSummary | undefined, now_ms: number): SessionSummary | undefined {
  let found = session;
  // A verdict that REST brought may have no session in the store: it is its own.
  if (verdict !== undefined && (found === undefined || found.requested_ms < verdict.decided_ms - 3_600_000)) {
    found = store.sessions.get(verdict.session_id) ?? sessionOf(verdict);
  }
  if (found === undefined) return undefined;
  found = asOf(found, now_ms);
  if (found.state === "requested") return found;
  const end_ms = Math.max(found.requested_ms, found.steps.at(-1)?.t_ms ?? 0);
  return now_ms - end_ms > VERDICT_HOLDS_MS ? undefined : found;
}

/** A drone of which a session or a verdict speaks; undefined where none does at this time. */
export function judgedDrone(
  store: LiveStore,
  uav_id: string,
  session: SessionSummary | undefined,
  verdict: VerdictSummary | undefined,
  now_ms: number,
): Drone | undefined {
  const held = holding(store, session, verdict, now_ms);
  if (held === undefined) return undefined;
  const track = store.tracks.get(uav_id);
  const estimate = store.estimates.get(uav_id);
  const parts: Parts = {
    uav_id,
    session: held,
    ...(track !== undefined && { track }),
    ...(verdict !== undefined && { verdict }),
    ...(estimate !== undefined && { estimate }),
  };
  const said = judged(parts);
  if (said === undefined) return undefined;
  const known_ms = Math.max(track?.t_ms ?? 0, said.t_ms);
  if (said.group === "verified" && now_ms - known_ms > GONE_MS) return undefined;
  return { ...parts, ...said };
}

/** A drone of which nothing is known but what is heard. */
export function heardDrone(store: LiveStore, slot: number, look: Look): Drone {
  const track = store.tracks.at(slot);
  const nearest = nearestPad(track, store.pads.values());
  return { uav_id: track.uav_id, look, group: "other", t_ms: track.t_ms, track, ...(nearest !== undefined && { nearest }) };
}

/** What can be said of a session of which only the verdict is known. */
export function sessionOf(verdict: VerdictSummary): SessionSummary {
  return {
    session_id: verdict.session_id,
    pad_id: verdict.pad_id,
    uav_id: verdict.uav_id,
    action: verdict.action,
    state: "decided",
    requested_ms: verdict.decided_ms,
    expires_ms: verdict.decided_ms,
    decided_ms: verdict.decided_ms,
    steps: [],
    request_tx: verdict.session_id,
    verdict_tx: verdict.tx_id,
    outcome: verdict.outcome,
    permission: verdict.permission,
    rounds: verdict.rounds,
  };
}

function rank<T>(order: readonly T[], value: T): number {
  const index = order.indexOf(value);
  return index < 0 ? order.length : index;
}

/** What needs the officer first, newest first within. */
export function byNeed(a: Drone, b: Drone): number {
  return (
    rank(GROUP_ORDER, a.group) - rank(GROUP_ORDER, b.group) ||
    rank<Drone["need"]>(NEED_ORDER, a.need) - rank<Drone["need"]>(NEED_ORDER, b.need) ||
    (a.group === "proving" ? 0 : b.t_ms - a.t_ms) ||
    a.uav_id.localeCompare(b.uav_id)
  );
}
