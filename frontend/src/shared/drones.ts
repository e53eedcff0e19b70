import type { Estimate, Pad, SessionState, Track, VerdictSummary } from "./api/records";
import { distance_mm, type Place } from "./geo/frame";
import type { LiveStore } from "./live/store";

/** What a drone looks like everywhere: one shape and one colour for each. */
export type Look = "verified" | "refuted" | "inconclusive" | "unproved" | "out-of-range" | "silent" | "proving";

export type Group = "needs-you" | "proving" | "verified" | "other";

export type Drone = {
  uav_id: string;
  look: Look;
  group: Group;
  /** What needs the officer has a reason, worst first in the list. */
  need?: "refuted" | "broadcast-refuted" | "inconclusive" | "not-authorised" | "no-verdict";
  /** When what the row tells happened. */
  t_ms: number;
  track?: Track;
  session?: SessionState;
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

const NEED_ORDER = ["refuted", "broadcast-refuted", "inconclusive", "not-authorised", "no-verdict"] as const;
const GROUP_ORDER: readonly Group[] = ["needs-you", "proving", "verified", "other"];
const LOOK_ORDER: readonly Look[] = [
  "refuted",
  "inconclusive",
  "verified",
  "proving",
  "unproved",
  "out-of-range",
  "silent",
];

function nearestPad(place: Place, pads: Iterable<Pad>): Drone["nearest"] {
  let best: Drone["nearest"];
  for (const pad of pads) {
    if (pad.status === "retired") continue;
    const distance = distance_mm(place, pad);
    if (best === undefined || distance < best.distance_mm) best = { pad, distance_mm: distance };
  }
  return best;
}

function needOf(verdict: VerdictSummary): Drone["need"] {
  if (verdict.broadcast?.outcome === "refuted" && verdict.signed?.outcome !== "refuted") return "broadcast-refuted";
  if (verdict.outcome === "refuted") return "refuted";
  if (verdict.outcome === "inconclusive") return "inconclusive";
  return verdict.permission === "refused" ? "not-authorised" : undefined;
}

type Parts = Pick<Drone, "uav_id" | "track" | "session" | "verdict" | "estimate" | "nearest">;

function classify(parts: Parts, now_ms: number): Omit<Drone, keyof Parts> {
  const { track, session, verdict, nearest } = parts;
  const heard_ms = track?.t_ms ?? 0;
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
  if (now_ms - heard_ms > SILENT_MS) return { look: "silent", group: "other", t_ms: heard_ms };
  const reach = nearest?.pad.commissioning?.max_range_mm;
  const far = nearest === undefined || (reach !== undefined && nearest.distance_mm > reach);
  return { look: far ? "out-of-range" : "unproved", group: "other", t_ms: heard_ms };
}

/**
 * A session as it stands at a time: one that nobody decided before its end is over, whether or not anybody has said so
 * on the ledger.
 */
export function asOf(session: SessionState, now_ms: number): SessionState {
  if (session.state !== "requested" || now_ms <= session.expires_ms) return session;
  return { ...session, state: "cancelled", end: "expired" };
}

/** Every drone that is known to be about, sorted by need: what needs the officer first, newest first within. */
export function drones(store: LiveStore, now_ms: number): Drone[] {
  const newestSession = new Map<string, SessionState>();
  for (const session of store.sessionsByTime()) {
    if (!newestSession.has(session.uav_id)) newestSession.set(session.uav_id, session);
  }
  const newestVerdict = new Map<string, VerdictSummary>();
  for (const verdict of store.verdictsByTime()) {
    if (!newestVerdict.has(verdict.uav_id)) newestVerdict.set(verdict.uav_id, verdict);
  }
  const ids = new Set([...store.tracks.keys(), ...newestSession.keys(), ...newestVerdict.keys()]);
  const result: Drone[] = [];
  for (const uav_id of ids) {
    const track = store.tracks.get(uav_id);
    const verdict = newestVerdict.get(uav_id);
    let session = newestSession.get(uav_id);
    // A verdict that REST brought may have no session in the store: it is its own.
    if (verdict !== undefined && (session === undefined || session.requested_ms < verdict.decided_ms - 3_600_000)) {
      session = store.sessions.get(verdict.session_id) ?? sessionOf(verdict);
    }
    if (session !== undefined) session = asOf(session, now_ms);
    if (session !== undefined && session.state !== "requested") {
      const end_ms = Math.max(session.requested_ms, session.steps.at(-1)?.t_ms ?? 0);
      if (now_ms - end_ms > VERDICT_HOLDS_MS) session = undefined;
    }
    const estimate = store.estimates.get(uav_id);
    const nearest = track === undefined ? undefined : nearestPad(track, store.pads.values());
    const parts: Parts = {
      uav_id,
      ...(track !== undefined && { track }),
      ...(session !== undefined && { session }),
      ...(verdict !== undefined && { verdict }),
      ...(estimate !== undefined && { estimate }),
      ...(nearest !== undefined && { nearest }),
    };
    const drone = { ...parts, ...classify(parts, now_ms) };
    const known_ms = Math.max(track?.t_ms ?? 0, drone.t_ms);
    if (drone.group === "needs-you" || drone.group === "proving" || now_ms - known_ms <= GONE_MS) result.push(drone);
  }
  return result.sort(byNeed);
}

/** What can be said of a session of which only the verdict is known. */
export function sessionOf(verdict: VerdictSummary): SessionState {
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

function byNeed(a: Drone, b: Drone): number {
  return (
    rank(GROUP_ORDER, a.group) - rank(GROUP_ORDER, b.group) ||
    rank<Drone["need"]>(NEED_ORDER, a.need) - rank<Drone["need"]>(NEED_ORDER, b.need) ||
    (a.group === "other" ? rank(LOOK_ORDER, a.look) - rank(LOOK_ORDER, b.look) : 0) ||
    // Rows of drones that report all the time would change places all the time: those go by name.
    (a.group === "needs-you" || a.group === "verified" ? b.t_ms - a.t_ms : 0) ||
    a.uav_id.localeCompare(b.uav_id)
  );
}

export function countByGroup(all: readonly Drone[]): Record<Group, number> {
  const counts: Record<Group, number> = { "needs-you": 0, proving: 0, verified: 0, other: 0 };
  for (const drone of all) counts[drone.group] += 1;
  return counts;
}
