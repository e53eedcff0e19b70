import type { Judgement, Pad, Position, SessionState, VerdictSummary } from "../shared/api/records";
import type { Drone, Look } from "../shared/drones";
import { actionNoun, actionVerb, count, countWord, length, likelihood } from "../shared/format";
import { direction, type Local } from "../shared/geo/frame";

/** A part of a sentence; what matters most stands out. */
export type Phrase = string | { strong: string };
export type Account = { title: string; look: Look; sentence: Phrase[] };

/** "12.9 m north of Aurajoki 2"; "over Aurajoki 2" within a metre and a half. */
export function whereabouts(place: Local, padName: string): string {
  const distance = Math.hypot(place.east_mm, place.north_mm);
  return distance < 1_500 ? `over ${padName}` : `${length(distance, distance < 10_000)} ${direction(place)} of ${padName}`;
}

function anchorsMeasured(pad: Pad | undefined): string {
  const n = pad?.commissioning?.anchors.length;
  return n === undefined ? "The pad" : `${countWord(n)} anchors`;
}

function away(judgement: Judgement): Phrase[] {
  return [{ strong: length(judgement.error_mm, true) }, " from there."];
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
]);

function undecided(verdict: VerdictSummary): string {
  const blocked = verdict.reasons.find(({ code }) => BLOCKING.has(code));
  if (blocked !== undefined) return ` Not verified: ${blocked.text}`;
  const rounds = `${countWord(verdict.rounds)} rounds of ranging neither confirm nor refute it.`;
  if (verdict.more_rounds < 0) return ` ${rounds} No further ranging would settle it.`;
  if (verdict.more_rounds === 0) return ` ${rounds}`;
  return ` ${rounds} About ${count(verdict.more_rounds)} more would settle it.`;
}

function claimed(claim: Position, padName: string): string {
  return whereabouts(claim, padName);
}

/** The verdict in words, before any figure. */
export function account(verdict: VerdictSummary, pad: Pad | undefined): Account {
  const name = pad?.name ?? verdict.pad_id;
  const who: Phrase = { strong: verdict.uav_id };
  const { signed, broadcast } = verdict;
  const deed = actionNoun(verdict.action);
  if (verdict.outcome === "refuted" && signed?.outcome === "refuted") {
    return {
      title: "Refuted",
      look: "refuted",
      sentence: [
        who,
        ` says it is ${claimed(signed.claim, name)}. ${anchorsMeasured(pad)} measured it `,
        ...away(signed),
      ],
    };
  }
  if (broadcast?.outcome === "refuted") {
    return {
      title: "Refuted",
      look: "refuted",
      sentence: [
        who,
        ` tells the public that it is ${claimed(broadcast.claim, name)}. ${anchorsMeasured(pad)} measured it `,
        ...away(broadcast),
        ...(signed?.outcome === "verified" ? [` What it told ${name} holds.`] : []),
      ],
    };
  }
  if (verdict.outcome === "refuted") {
    return { title: "Refuted", look: "refuted", sentence: [who, ` was refused ${deed} at ${name}.`] };
  }
  if (verdict.outcome === "verified" && signed !== undefined) {
    const refused = verdict.permission === "refused";
    return {
      title: refused ? `Verified, ${deed} refused` : "Verified",
      look: "verified",
      sentence: [
        who,
        ` says it is ${claimed(signed.claim, name)}. ${anchorsMeasured(pad)} measured it there, to within `,
        { strong: length(signed.error_mm) },
        ".",
        ...(refused ? [` It may not ${actionVerb(verdict.action)}${verdict.authorised ? "" : ": it is not authorised"}.`] : []),
      ],
    };
  }
  return {
    title: verdict.outcome === "verified" ? "Verified" : "Inconclusive",
    look: verdict.outcome,
    sentence: [
      who,
      signed === undefined ? ` asked for ${deed} at ${name}.` : ` says it is ${claimed(signed.claim, name)}.`,
      undecided(verdict),
    ],
  };
}

const STAGES = {
  request: "Waiting for the pad to poll",
  poll: "The pad polls",
  match: "The codes match",
  reply: "The drone replied",
  range: "Ranged",
  confirm: "The drone countersigned",
  verdict: "The contract has decided",
  permission: "Permission is on the ledger",
} as const;

/** What a session that is not decided is doing. */
export function progress(session: SessionState, drone: Drone | undefined, pad: Pad | undefined): Account {
  const name = pad?.name ?? session.pad_id;
  const who: Phrase = { strong: session.uav_id };
  if (session.state === "cancelled") {
    const why = session.end === undefined ? "" : `: ${session.end.replaceAll("_", " ")}`;
    return {
      title: "No verdict",
      look: "unproved",
      sentence: [who, ` asked to ${actionVerb(session.action)} at ${name}. The session ended without a verdict${why}.`],
    };
  }
  const last = session.steps.at(-1)?.step ?? "request";
  const estimate = drone?.estimate;
  const ranging = stepNumber(session) <= 5 && estimate?.session_id === session.session_id;
  return {
    title: "Being proved",
    look: "proving",
    sentence: [
      who,
      ` asks to ${actionVerb(session.action)} at ${name}. `,
      ranging
        ? `Ranging: ${count(estimate.rounds)} rounds, likelihood so far ${likelihood(estimate.likelihood_ppm)}.`
        : `${STAGES[last]}.`,
    ],
  };
}

/** What can be said of a drone that nobody has proved. */
export function unproved(drone: Drone): Account {
  const who: Phrase = { strong: drone.uav_id };
  const near = drone.nearest;
  const where = near === undefined ? "" : `, ${length(near.distance_mm, true)} from ${near.pad.name}`;
  if (drone.look === "silent") {
    return { title: "Silent", look: "silent", sentence: [who, ` has not been heard lately${where === "" ? "" : `; last${where}`}.`] };
  }
  const sentence: Phrase[] = [who, ` broadcasts a position${where}. Nobody has checked it.`];
  return drone.look === "out-of-range"
    ? { title: "Out of range", look: "out-of-range", sentence: [...sentence, " No pad's calibration reaches that far."] }
    : { title: "No proof", look: "unproved", sentence };
}

/** The two short texts of a list row: what is known, and where. */
export function rowText(drone: Drone, padName: (pad_id: string) => string): { right: string; second: string } {
  const { session, verdict, look } = drone;
  if (look === "proving" && session !== undefined) {
    const pad = padName(session.pad_id);
    const n = stepNumber(session);
    const ranging = n <= 5 && drone.estimate?.session_id === session.session_id;
    const rounds = ranging ? `, ${count(drone.estimate?.rounds ?? 0)} rounds` : "";
    const stage = STAGES[session.steps.at(-1)?.step ?? "request"];
    return { right: `step ${ranging ? 5 : n} of 8`, second: rounds === "" ? `${stage} · ${pad}` : `Ranging at ${pad}${rounds}` };
  }
  if (session !== undefined && verdict?.session_id === session.session_id) {
    const pad = padName(verdict.pad_id);
    const deed = actionNoun(verdict.action);
    switch (drone.need) {
      case "refuted":
        return {
          right: `${length((verdict.signed ?? verdict.broadcast)?.error_mm ?? 0, true)} off`,
          second: `Refuted at ${pad} · ${deed} refused`,
        };
      case "broadcast-refuted":
        return {
          right: `${length(verdict.broadcast?.error_mm ?? 0, true)} off`,
          second: `Broadcast differs from what it told ${pad}`,
        };
      case "inconclusive":
        return {
          right: verdict.signed === undefined ? `${count(verdict.rounds)} rounds` : likelihood(verdict.signed.likelihood_ppm),
          second: `Inconclusive at ${pad} · ${deed} refused`,
        };
      case "not-authorised":
        return { right: "refused", second: `Verified at ${pad} · not authorised` };
      case "no-verdict":
      case undefined:
        return {
          right: length(verdict.signed?.error_mm ?? 0),
          second: `Verified at ${pad} · ${session.state === "completed" ? ended(session) : `${deed} permitted`}`,
        };
    }
  }
  if (session?.state === "cancelled") {
    const why = session.end === undefined ? "" : ` · ${session.end.replaceAll("_", " ")}`;
    return { right: "no verdict", second: `Session at ${padName(session.pad_id)} ended${why}` };
  }
  const near = drone.nearest;
  if (look === "silent") {
    return { right: "silent", second: drone.track === undefined ? "Not heard" : `Last heard by ${padName(drone.track.pad_id)}` };
  }
  const where = near === undefined ? "" : ` · ${length(near.distance_mm, true)} from ${near.pad.name}`;
  return { right: look === "out-of-range" ? "out of range" : "no proof", second: `Broadcast only${where}` };
}

function ended(session: SessionState): string {
  if (session.end === "aborted") return `${actionNoun(session.action)} aborted`;
  return { land: "landed", takeoff: "took off", dock: "docked" }[session.action];
}

/** The step that is under way, 2 to 8: the one after the last that was reached. */
export function stepNumber(session: SessionState): number {
  const order = ["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"];
  const reached = Math.max(0, ...session.steps.map((step) => order.indexOf(step.step) + 1));
  return Math.min(8, reached + 1);
}
