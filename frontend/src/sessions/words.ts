import type { Judgement, Pad, Position, SessionSummary, VerdictSummary } from "../shared/api/records";
import type { Drone, Look } from "../shared/drones";
import { actionNoun, actionVerb, count, countWord, length, likelihood } from "../shared/format";
import { direction, type Local } from "../shared/geo/frame";
import type { Phrase } from "../shared/i18n/texts";
import { heightOff, isContradicted, refutedBy } from "../shared/refuted";
import { endText } from "./ends";
import { reasonText } from "./reasons";
import { proofTexts as t, rowTexts as row } from "./texts";

export type Account = { title: string; look: Look; sentence: Phrase[] };

/** The direction from the pad to a place, in words. */
export function directionWord(place: Local): string {
  return t("direction", { direction: direction(place).replace("-", "") });
}

/** "12.9 m north of Aurajoki 2"; "over Aurajoki 2" within a metre and a half. */
export function whereabouts(place: Local, pad: string): string {
  const distance = Math.hypot(place.east_mm, place.north_mm);
  if (distance < 1_500) return t("over", { pad });
  return t("from", { distance: length(distance, distance < 10_000), direction: directionWord(place), pad });
}

function measurer(pad: Pad | undefined): string {
  const n = pad?.commissioning?.anchors.length;
  return n === undefined ? t("thePad") : t("anchors", { count: countWord(n) });
}

/** Reasons that by themselves keep a claim from being verified, whatever the likelihood. */
const BLOCKING = new Set([
  "session_stopped",
  "codes_not_matched",
  "countersignature_invalid",
  "not_countersigned",
  "assurance_too_low",
  "rounds_not_fresh",
  "claims_not_fresh",
  "time_goes_back",
  "claim_far_away",
  "claim_vague",
  "claims_go_back",
  "claims_jump",
  "claim_height_vague",
  "mirror_ambiguity",
  "too_few_rounds",
  "ranges_inconsistent",
  "no_estimate",
  "cannot_refute",
  "rounds_missing",
  "claims_torn",
  "claims_unseen",
  "claims_waver",
  "height_doubted",
  "height_not_proved",
  "broadcast_unsupported",
  "broadcast_undecided",
  "broadcast_not_heard",
]);

function undecided(verdict: VerdictSummary): string {
  const blocked = [...verdict.reasons, ...(verdict.signed?.reasons ?? [])].find(({ code }) => BLOCKING.has(code));
  if (blocked !== undefined) return t("notVerified", { why: reasonText(blocked) });
  const rounds = t("undecided", { rounds: countWord(verdict.rounds) });
  if (verdict.more_rounds < 0) return rounds + t("noMore");
  if (verdict.more_rounds === 0) return rounds;
  return rounds + t("more", { rounds: count(verdict.more_rounds) });
}

function claimed(claim: Position, padName: string): string {
  return whereabouts(claim, padName);
}

/**
 * How far time stamps that need no word of the drone's clock put it from its claim: what refutes a drone whose two-way
 * ranges fit, because it bent its own clock.
 */
export function differing(verdict: VerdictSummary): number | undefined {
  return verdict.time_differences?.error_mm ?? verdict.witness?.error_mm;
}

function side(height_mm: number): "above" | "below" {
  return height_mm > 0 ? "above" : "below";
}

/** Why a drone was refuted, by what refuted it; undefined where it was not. */
function refutation(verdict: VerdictSummary, pad: Pad | undefined): Phrase[] | undefined {
  const by = refutedBy(verdict);
  if (by === undefined) return undefined;
  const { signed, broadcast, uav_id: who } = verdict;
  const name = pad?.name ?? verdict.pad_id;
  if (by === "broadcast" && broadcast?.claim !== undefined) {
    const values = { who, place: claimed(broadcast.claim, name), measurer: measurer(pad), error: length(broadcast.error_mm ?? 0, true) };
    const sentence = t.rich("publicMeasuredAway", values);
    if (broadcast.tolerance_mm !== undefined) sentence.push(t("canMean", { tolerance: length(broadcast.tolerance_mm, true) }));
    if (signed?.outcome === "verified") sentence.push(t("toldPadHolds", { pad: name }));
    return sentence;
  }
  if (signed === undefined) return t.rich("wasRefused", { who, deed: actionNoun(verdict.action), pad: name });
  const place = claimed(signed.claim, name);
  const height_mm = heightOff(verdict);
  if (by === "height" && height_mm !== undefined) {
    const values = { who, place, measurer: measurer(pad), error: length(Math.abs(height_mm), true), side: side(height_mm) };
    return t.rich("saysHeightAway", values);
  }
  if (by === "leaving") return t.rich("isLeaving", { who, place, error: length(signed.error_mm) });
  if (by === "stamps") {
    const error_mm = differing(verdict);
    return error_mm === undefined
      ? t.rich("clockBentVague", { who, place })
      : t.rich("clockBent", { who, place, error: length(error_mm, true) });
  }
  return t.rich("saysMeasuredAway", { who, place, measurer: measurer(pad), error: length(signed.error_mm, true) });
}

/** The pad that refuted it, by name; undefined where nothing was refuted. */
export function refutedAt(verdict: VerdictSummary | undefined, pad: Pad | undefined): string | undefined {
  return verdict === undefined || refutedBy(verdict) === undefined ? undefined : (pad?.name ?? verdict.pad_id);
}

/** What was claimed and how the measurement fits it: a place, or only a distance from the pad. */
function fits(verdict: VerdictSummary, signed: Judgement, pad: Pad | undefined): Phrase[] {
  const place = claimed(signed.claim, pad?.name ?? verdict.pad_id);
  const values = { who: verdict.uav_id, place, error: length(signed.error_mm) };
  if (verdict.assurance === 0) return t.rich("unbound", values);
  // Two-way ranges about a place that the anchors do not surround prove a distance, not the place (docs/method.md).
  const bounded = verdict.within_mm !== undefined && (verdict.outcome !== "verified" || verdict.reasons.some(({ code }) => code === "upper_bound"));
  return bounded
    ? t.rich("within", { ...values, within: length(verdict.within_mm ?? 0, true) })
    : t.rich("saysMeasuredThere", { ...values, measurer: measurer(pad) });
}

/** Somebody broadcasts its number from elsewhere; empty where nobody does. */
function impersonation(verdict: VerdictSummary): Phrase[] {
  if (!isContradicted(verdict)) return [];
  const error_mm = verdict.broadcast?.error_mm;
  return t.rich("impersonation", { error: error_mm === undefined ? "–" : length(error_mm, true) });
}

/** The verdict in words, before any figure. */
export function account(verdict: VerdictSummary, pad: Pad | undefined): Account {
  const name = pad?.name ?? verdict.pad_id;
  const who = verdict.uav_id;
  const { signed } = verdict;
  const deed = actionNoun(verdict.action);
  const refuted = refutation(verdict, pad);
  if (refuted !== undefined) return { title: t("refuted"), look: "refuted", sentence: refuted };
  if (verdict.outcome === "verified" && signed !== undefined) {
    const refused = verdict.permission === "refused";
    const sentence = [...fits(verdict, signed, pad), ...impersonation(verdict)];
    if (refused) sentence.push(t(verdict.authorised ? "mayNot" : "mayNotUnauthorised", { action: actionVerb(verdict.action) }));
    return { title: refused ? t("verifiedRefused", { deed }) : t("verified"), look: "verified", sentence };
  }
  if (verdict.outcome === "inconclusive" && signed?.outcome === "verified") {
    const sentence = [...fits(verdict, signed, pad), ...impersonation(verdict), undecided(verdict)];
    return { title: t("inconclusive"), look: "inconclusive", sentence };
  }
  const opening =
    signed === undefined ? t.rich("askedFor", { who, deed, pad: name }) : t.rich("says", { who, place: claimed(signed.claim, name) });
  return {
    title: t(verdict.outcome === "verified" ? "verified" : "inconclusive"),
    look: verdict.outcome,
    sentence: [...opening, ...impersonation(verdict), undecided(verdict)],
  };
}

/** Why a session ended, for a sentence that goes on with it. */
function because(session: SessionSummary, separator: string): string {
  return session.end === undefined ? "" : separator + endText(session.end);
}

/** What a session that is not decided is doing. */
export function progress(session: SessionSummary, drone: Drone | undefined, pad: Pad | undefined): Account {
  const values = { who: session.uav_id, action: actionVerb(session.action), pad: pad?.name ?? session.pad_id };
  if (session.state === "cancelled") {
    const sentence = t.rich("endedWithout", { ...values, why: because(session, ": ") });
    return { title: t("noVerdict"), look: "unproved", sentence };
  }
  const step = session.steps.at(-1)?.step ?? "request";
  const estimate = drone?.estimate;
  const ranging = stepNumber(session) <= 5 && estimate?.session_id === session.session_id;
  const doing = ranging
    ? t("ranging", { rounds: count(estimate.rounds), likelihood: likelihood(estimate.likelihood_ppm) })
    : `${t("stage", { step })}.`;
  return { title: t("beingProved"), look: "proving", sentence: [...t.rich("asksTo", values), doing] };
}

/** What can be said of a drone that nobody has proved. */
export function unproved(drone: Drone): Account {
  const who = drone.uav_id;
  const near = drone.nearest;
  const where = near === undefined ? undefined : { distance: length(near.distance_mm, true), pad: near.pad.name };
  if (drone.look === "silent") {
    const sentence = where === undefined ? t.rich("notHeard", { who }) : t.rich("notHeardNear", { who, ...where });
    return { title: t("silent"), look: "silent", sentence };
  }
  const sentence = where === undefined ? t.rich("broadcasts", { who }) : t.rich("broadcastsNear", { who, ...where });
  return drone.look === "out-of-range"
    ? { title: t("outOfRange"), look: "out-of-range", sentence: [...sentence, t("tooFar")] }
    : { title: t("noProof"), look: "unproved", sentence };
}

function refutedRow(verdict: VerdictSummary, pad: string, deed: string): RowText {
  const by = refutedBy(verdict);
  if (by === "stamps") return { right: clockOff(verdict), second: row("clockBent", { pad, deed }) };
  const height_mm = by === "height" ? heightOff(verdict) : undefined;
  if (height_mm !== undefined) {
    return { right: row("off", { distance: length(Math.abs(height_mm), true) }), second: row("heightAt", { pad, deed, side: side(height_mm) }) };
  }
  if (by === "leaving") return { right: row("leaving"), second: row("leavingAt", { pad, deed }) };
  const error_mm = verdict.signed?.error_mm ?? verdict.broadcast?.error_mm ?? 0;
  return { right: row("off", { distance: length(error_mm, true) }), second: row("refutedAt", { pad, deed }) };
}

const LIKELY_PPM = 990_000;

type RowText = { right: string; second: string };

/** The two short texts of a list row: what is known, and where. */
export function rowText(drone: Drone, padName: (pad_id: string) => string): RowText {
  const { session, verdict, look } = drone;
  if (look === "proving" && session !== undefined) {
    const pad = padName(session.pad_id);
    const n = stepNumber(session);
    if (n <= 5 && drone.estimate?.session_id === session.session_id) {
      return { right: row("step", { step: 5 }), second: row("rangingAt", { pad, rounds: count(drone.estimate.rounds) }) };
    }
    const stage = t("stage", { step: session.steps.at(-1)?.step ?? "request" });
    return { right: row("step", { step: n }), second: row("stageAt", { stage, pad }) };
  }
  if (session !== undefined && verdict?.session_id === session.session_id) {
    const pad = padName(verdict.pad_id);
    const deed = actionNoun(verdict.action);
    switch (drone.need) {
      case "refuted":
        return refutedRow(verdict, pad, deed);
      case "broadcast-refuted":
        return {
          right: row("off", { distance: length(verdict.broadcast?.error_mm ?? 0, true) }),
          second: row("broadcastDiffers", { pad }),
        };
      case "impersonation":
        return {
          right: row("off", { distance: length(verdict.broadcast?.error_mm ?? 0, true) }),
          second: row("impersonationAt", { pad, deed, permission: verdict.permission }),
        };
      case "inconclusive":
        return {
          // Where it is likely enough, something else keeps it open: its likelihood would say the contrary.
          right: verdict.signed === undefined || verdict.signed.likelihood_ppm > LIKELY_PPM ? row("rounds", { rounds: count(verdict.rounds) }) : likelihood(verdict.signed.likelihood_ppm),
          second: row("inconclusiveAt", { pad, deed }),
        };
      case "not-authorised":
        return { right: row("refused"), second: row("notAuthorised", { pad }) };
      case "no-verdict":
      case undefined: {
        const end = session.state === "completed" ? ended(session) : row("permitted", { deed });
        return { right: length(verdict.signed?.error_mm ?? 0), second: row("verifiedAt", { pad, end }) };
      }
    }
  }
  if (session?.state === "cancelled") {
    return { right: row("noVerdict"), second: row("ended", { pad: padName(session.pad_id), why: because(session, " · ") }) };
  }
  if (look === "silent") {
    const second = drone.track === undefined ? row("notHeard") : row("lastHeard", { pad: padName(drone.track.pad_id) });
    return { right: row("silent"), second };
  }
  const near = drone.nearest;
  const second =
    near === undefined ? row("broadcastOnly") : row("broadcastOnlyNear", { distance: length(near.distance_mm, true), pad: near.pad.name });
  return { right: row(look === "out-of-range" ? "outOfRange" : "noProof"), second };
}

function clockOff(verdict: VerdictSummary): string {
  const error_mm = differing(verdict);
  return error_mm === undefined ? row("refused") : row("off", { distance: length(error_mm, true) });
}

function ended(session: SessionSummary): string {
  const { action } = session;
  return session.end === "aborted" ? row("aborted", { deed: actionNoun(action) }) : row("did", { action });
}

/** The step that is under way, 2 to 8: the one after the last that was reached. */
export function stepNumber(session: SessionSummary): number {
  const order = ["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"];
  const reached = Math.max(0, ...session.steps.map((step) => order.indexOf(step.step) + 1));
  return Math.min(8, reached + 1);
}
