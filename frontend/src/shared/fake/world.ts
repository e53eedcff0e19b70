import type {
  Action,
  Anchor,
  Estimate,
  Judgement,
  Outcome,
  Pad,
  Position,
  SessionState,
  Status,
  StepName,
  Track,
  VerdictSummary,
} from "../api/records";
import { plainFrame, toGlobe, type Local } from "../geo/frame";
import type { Changes } from "../live/protocol";
import { hex, noise, type Random } from "./random";

/** A drone of the script: where it flies in its pad's frame, where it says it is, and what it asks for when. */
export type Actor = {
  uav_id: string;
  pad_id: string;
  /** Seconds into each cycle at which it asks; undefined for one that only broadcasts. */
  asks_at_s?: number;
  action: Action;
  outcome: Outcome;
  /** Where it truly hovers while it is proved, and how far its signed and its broadcast claim are from there. */
  hover: Local;
  lie?: Local;
  broadcastLie?: Local;
  authorised?: boolean;
  cancelled?: string;
  silent?: boolean;
  rounds: number;
  sigma_mm: number;
};

export const CYCLE_S = 120;

const STAGES: readonly (readonly [StepName, at_s: number])[] = [
  ["request", 0],
  ["poll", 0.9],
  ["match", 1.3],
  ["reply", 1.7],
  ["range", 5.2],
  ["confirm", 5.6],
  ["verdict", 6.1],
  ["permission", 6.1],
];
const DECIDED_S = 6.1;
const LANDED_S = 20;

const at = (east_mm: number, north_mm: number): Local => ({ east_mm, north_mm });
const plus = (a: Local, b: Local = at(0, 0)): Local => at(a.east_mm + b.east_mm, a.north_mm + b.north_mm);

/** Each lie once, honest drones around them. */
export const ACTORS: readonly Actor[] = [
  { uav_id: "OH-DRN-0417", pad_id: "aurajoki-2", asks_at_s: 8, action: "land", outcome: "refuted", hover: at(3_600, 10_700), lie: at(-3_400, 2_500), rounds: 24, sigma_mm: 90 },
  { uav_id: "OH-DRN-0640", pad_id: "kupittaa", asks_at_s: 14, action: "land", outcome: "refuted", hover: at(-6_200, -4_100), broadcastLie: at(24_000, 19_600), rounds: 42, sigma_mm: 70 },
  { uav_id: "OH-DRN-0871", pad_id: "aurajoki-2", asks_at_s: 24, action: "land", outcome: "inconclusive", hover: at(-14_800, 9_400), lie: at(420, -560), rounds: 160, sigma_mm: 620 },
  { uav_id: "OH-DRN-0118", pad_id: "satama-1", asks_at_s: 52, action: "dock", outcome: "verified", hover: at(5_100, -7_400), rounds: 80, sigma_mm: 60 },
  { uav_id: "OH-DRN-0925", pad_id: "kupittaa", asks_at_s: 55.2, action: "takeoff", outcome: "verified", hover: at(400, 300), rounds: 30, sigma_mm: 40 },
  { uav_id: "OH-DRN-0233", pad_id: "aurajoki-2", asks_at_s: 31, action: "land", outcome: "verified", hover: at(-5_200, -8_300), rounds: 36, sigma_mm: 70 },
  { uav_id: "OH-DRN-0377", pad_id: "satama-1", asks_at_s: 2, action: "dock", outcome: "verified", hover: at(-2_100, 6_900), rounds: 33, sigma_mm: 60 },
  { uav_id: "OH-DRN-0512", pad_id: "satama-1", asks_at_s: 36, action: "land", outcome: "verified", authorised: false, hover: at(9_000, 3_000), rounds: 40, sigma_mm: 70 },
  { uav_id: "OH-DRN-0733", pad_id: "kupittaa", asks_at_s: 40, action: "land", outcome: "verified", cancelled: "codes_did_not_match", hover: at(12_000, -15_000), rounds: 0, sigma_mm: 70 },
  { uav_id: "OH-DRN-0102", pad_id: "aurajoki-2", action: "land", outcome: "verified", hover: at(310_000, 268_000), rounds: 0, sigma_mm: 70 },
  { uav_id: "SE-UAS-7715", pad_id: "kupittaa", action: "land", outcome: "verified", hover: at(-690_000, 420_000), rounds: 0, sigma_mm: 70 },
  { uav_id: "OH-DRN-0559", pad_id: "satama-1", action: "land", outcome: "verified", hover: at(120_000, -60_000), silent: true, rounds: 0, sigma_mm: 70 },
];

function pad(pad_id: string, name: string, lat: number, lon: number): Pad {
  const place = { lat_e7: Math.round(lat * 1e7), lon_e7: Math.round(lon * 1e7) };
  const frame = plainFrame(place);
  const corner = 1_200;
  const anchors: Anchor[] = (["A", "B", "C", "D"] as const).map((anchor_id, i) => ({
    anchor_id,
    east_mm: i === 1 || i === 2 ? corner : -corner,
    north_mm: i < 2 ? corner : -corner,
    up_mm: 300 + 150 * (i % 2),
  }));
  return {
    pad_id,
    name,
    operator_id: "FIN87astrdge12k8",
    msp_id: "PadMSP",
    status: "commissioned",
    ...place,
    height_mm: 34_000,
    commissioning: {
      frame,
      anchors,
      range_sigma_mm: 100,
      max_range_mm: 60_000,
      valid_from_ms: 0,
      valid_until_ms: 4_102_444_800_000,
    },
    anchors: anchors.map((anchor) => {
      const [lon, lat] = toGlobe(frame, anchor);
      return { ...anchor, lat_e7: Math.round(lat * 1e7), lon_e7: Math.round(lon * 1e7) };
    }),
    health: { anchors: anchors.map(({ anchor_id }) => ({ anchor_id, state: "up" as const })) },
  };
}

export const PADS: readonly Pad[] = [
  pad("aurajoki-2", "Aurajoki 2", 60.45148, 22.26868),
  pad("satama-1", "Satama 1", 60.43552, 22.21874),
  pad("kupittaa", "Kupittaa", 60.45062, 22.29721),
];

/** The scripted world, a function of its time: every quantity at time t follows from the seed. */
export class FakeWorld {
  private block = 18_000;
  private readonly done = new Set<string>();

  constructor(
    readonly start_ms: number,
    private readonly random: Random,
  ) {}

  /** Everything that changed at t seconds since the start. */
  tick(t_s: number): Changes {
    const t_ms = this.start_ms + Math.round(t_s * 1000);
    const changes: Required<Omit<Changes, "status" | "pads">> = { tracks: [], estimates: [], sessions: [], verdicts: [] };
    for (const actor of ACTORS) {
      const cycle = Math.floor(t_s / CYCLE_S);
      const into_s = actor.asks_at_s === undefined ? -1 : (t_s % CYCLE_S) - actor.asks_at_s;
      if (actor.silent !== true || t_s < 3) changes.tracks.push(this.track(actor, t_s, into_s, t_ms));
      if (into_s < 0) continue;
      const session = this.session(actor, cycle, into_s, t_ms - Math.round(into_s * 1000));
      const mark = `${session.session_id}:${session.state}:${session.steps.length}`;
      if (into_s >= 1.7 && into_s < DECIDED_S && actor.cancelled === undefined && session.state === "requested") {
        changes.estimates.push(this.estimate(actor, session.session_id, into_s, t_ms));
      }
      if (this.done.has(mark)) continue;
      this.done.add(mark);
      changes.sessions.push(session);
      if (session.state === "decided") changes.verdicts.push(this.verdict(actor, session, session.requested_ms + DECIDED_S * 1000));
    }
    return { ...changes, status: this.status() };
  }

  status(): Status {
    return {
      ledger: {
        kind: "embedded",
        notice: "Embedded ledger, no multi-party trust",
        channel: "wonderland",
        height: this.block + 1,
        mirrored: this.block,
        lag_ms: 180,
        organisations: ["AuthorityMSP", "PadMSP", "FleetMSP"],
      },
      server: { version: "0.1.0", epoch: "fake" },
    };
  }

  /** An hour of earlier verdicts, for the strip at the bottom. */
  history(): VerdictSummary[] {
    const result: VerdictSummary[] = [];
    for (let i = 0; i < 118; i++) {
      const base = ACTORS[Math.floor(this.random() * 7)] ?? raise("the script has no actors");
      const roll = this.random();
      const outcome: Outcome = roll > 0.94 ? "refuted" : roll > 0.86 ? "inconclusive" : "verified";
      const actor: Actor = {
        ...base,
        uav_id: `OH-DRN-${String(1000 + Math.floor(this.random() * 90))}`,
        outcome,
        broadcastLie: at(0, 0),
        ...(outcome === "refuted" ? { lie: at(5_000 * this.random(), 4_000) } : { lie: at(60, -40) }),
      };
      const requested_ms = this.start_ms - Math.round(660_000 + this.random() * 2_900_000);
      const session = this.session(actor, -1 - i, LANDED_S + 1, requested_ms);
      result.push({ ...this.verdict(actor, session, requested_ms + DECIDED_S * 1000), block: 17_000 + i });
    }
    return result.sort((a, b) => a.decided_ms - b.decided_ms);
  }

  private place(actor: Actor, t_s: number, into_s: number): Local {
    if (actor.asks_at_s === undefined) {
      const turn = t_s / 9;
      return plus(actor.hover, at(26_000 * Math.sin(turn), 14_000 * Math.cos(turn * 1.3)));
    }
    const stays = actor.outcome === "verified" && actor.authorised !== false && actor.cancelled === undefined;
    const fromPad = Math.hypot(actor.hover.east_mm, actor.hover.north_mm);
    const out = at(actor.hover.east_mm / fromPad, actor.hover.north_mm / fromPad);
    const sway = at(150 * Math.sin(t_s), 120 * Math.cos(t_s * 0.8));
    if (into_s < 0) {
      const waiting_s = -into_s;
      const distance = waiting_s * 6_000;
      const bend = at(-out.north_mm * Math.sin(waiting_s / 7) * 9_000, out.east_mm * Math.sin(waiting_s / 7) * 9_000);
      return plus(plus(actor.hover, at(out.east_mm * distance, out.north_mm * distance)), waiting_s > 1 ? bend : sway);
    }
    if (into_s < DECIDED_S + 1) return plus(actor.hover, sway);
    const gone_s = into_s - DECIDED_S - 1;
    if (stays) {
      const left = Math.max(0, 1 - gone_s / (LANDED_S - DECIDED_S - 1));
      return at(actor.hover.east_mm * left, actor.hover.north_mm * left);
    }
    const distance = Math.max(0, gone_s - 25) * 3_000;
    return plus(plus(actor.hover, at(out.east_mm * distance, out.north_mm * distance)), sway);
  }

  private track(actor: Actor, t_s: number, into_s: number, t_ms: number): Track {
    const home = this.pad(actor);
    const place = plus(plus(this.place(actor, t_s, into_s), actor.lie), actor.broadcastLie);
    const [lon, lat] = toGlobe(home.commissioning?.frame ?? plainFrame(home), place);
    return {
      uav_id: actor.uav_id,
      lat_e7: Math.round(lat * 1e7),
      lon_e7: Math.round(lon * 1e7),
      height_mm: 12_000,
      accuracy_mm: 1_000,
      speed_mm_s: into_s < 0 ? 6_000 : 300,
      t_ms,
      pad_id: actor.pad_id,
      transport: "wifi_beacon",
      verified: false,
    };
  }

  private session(actor: Actor, cycle: number, into_s: number, requested_ms: number): SessionState {
    const id = hex(`${actor.uav_id}/${cycle}`);
    const verified = actor.outcome === "verified";
    const limit = actor.cancelled === undefined ? Infinity : 1.3;
    const steps = STAGES.filter(([, at_s]) => at_s <= into_s && at_s <= limit).map(([step, at_s]) => ({
      step,
      t_ms: requested_ms + Math.round(at_s * 1000) + (step === "permission" ? 4 : 0),
      ok: !(step === "verdict" && !verified) && !(step === "match" && actor.cancelled !== undefined),
      source: step === "request" || step === "verdict" || step === "permission" ? ("ledger" as const) : ("pad" as const),
      ...(step === "match" ? { detail: actor.cancelled === undefined ? "codes match" : "codes differ" } : {}),
      ...(step === "range" ? { detail: `${actor.rounds} rounds` } : {}),
    }));
    const base = {
      session_id: id,
      pad_id: actor.pad_id,
      uav_id: actor.uav_id,
      action: actor.action,
      requested_ms,
      request_tx: id,
    };
    if (actor.cancelled !== undefined && into_s > 2.5) {
      return { ...base, state: "cancelled", steps, end: actor.cancelled };
    }
    if (into_s < DECIDED_S) return { ...base, state: "requested", steps };
    const granted = verified && actor.authorised !== false;
    const landed = granted && into_s >= LANDED_S;
    return {
      ...base,
      state: landed ? "completed" : "decided",
      steps,
      verdict_tx: hex(`${id}/verdict`),
      ...(landed ? { complete_tx: hex(`${id}/complete`), end: "done" } : {}),
      outcome: actor.outcome,
      permission: granted ? "granted" : "refused",
      rounds: actor.rounds,
    };
  }

  private estimate(actor: Actor, session_id: string, into_s: number, t_ms: number): Estimate {
    const home = this.pad(actor);
    const rounds = Math.max(1, Math.round((actor.rounds * (into_s - 1.7)) / 3.5));
    const spread = actor.sigma_mm * (0.4 + 2.4 / Math.sqrt(rounds));
    const place = plus(actor.hover, at(noise(this.random) * spread * 0.5, noise(this.random) * spread * 0.4));
    const [lon, lat] = toGlobe(home.commissioning?.frame ?? plainFrame(home), place);
    return {
      session_id,
      uav_id: actor.uav_id,
      pad_id: actor.pad_id,
      lat_e7: Math.round(lat * 1e7),
      lon_e7: Math.round(lon * 1e7),
      east_mm: Math.round(place.east_mm),
      north_mm: Math.round(place.north_mm),
      ...covariance(actor.hover, spread),
      rounds,
      likelihood_ppm: actor.outcome === "refuted" ? 40 : Math.min(980_000, 600_000 + rounds * 9_000),
      ranges: Object.fromEntries(
        (home.commissioning?.anchors ?? []).map((anchor) => [
          anchor.anchor_id,
          Math.round(Math.hypot(place.east_mm - anchor.east_mm, place.north_mm - anchor.north_mm, 11_000)),
        ]),
      ),
      t_ms,
      verified: false,
    };
  }

  private verdict(actor: Actor, session: SessionState, decided_ms: number): VerdictSummary {
    this.block += 1;
    const signedAt = plus(actor.hover, actor.lie);
    const found = plus(actor.hover, at(noise(this.random) * actor.sigma_mm * 0.6, noise(this.random) * actor.sigma_mm * 0.6));
    const error = (claim: Local): number =>
      Math.round(Math.hypot(claim.east_mm - found.east_mm, claim.north_mm - found.north_mm));
    const judged = (claim: Local, outcome: Outcome): Judgement => ({
      outcome,
      claim: this.position(actor, claim),
      error_mm: error(claim),
      likelihood_ppm: { verified: 998_200, refuted: 12, inconclusive: 834_000 }[outcome],
      paper_rule: error(claim) <= 1_000,
      reasons: [{ code: "within_buffer", text: outcome === "refuted" ? "The estimate lies significantly outside the buffer around the claim" : "The estimate lies within the buffer around the claim" }],
    });
    const broadcastAt = plus(signedAt, actor.broadcastLie);
    const broadcastOutcome: Outcome = isPublicLiar(actor) ? "refuted" : actor.outcome;
    const granted = actor.outcome === "verified" && actor.authorised !== false;
    return {
      session_id: session.session_id,
      pad_id: actor.pad_id,
      uav_id: actor.uav_id,
      action: actor.action,
      outcome: actor.outcome,
      permission: granted ? "granted" : "refused",
      authorised: actor.authorised !== false,
      assurance: 2,
      rounds: actor.rounds,
      buffer_mm: 1_000,
      decided_ms: Math.round(decided_ms),
      evidence_sha256: hex(`${session.session_id}/evidence`),
      reasons: reasons(actor),
      more_rounds: actor.outcome === "inconclusive" ? 38 : -1,
      signed: judged(signedAt, isPublicLiar(actor) ? "verified" : actor.outcome),
      broadcast: judged(broadcastAt, broadcastOutcome),
      estimate: this.position(actor, found),
      covariance: covariance(actor.hover, actor.sigma_mm),
      chi2_milli: 3_100,
      chi2_claim_milli: actor.outcome === "refuted" ? 412_000 : 4_200,
      within_mm: 14_000,
      tx_id: session.verdict_tx ?? hex(session.session_id),
      block: this.block,
      tx_index: 0,
    };
  }

  private position(actor: Actor, place: Local): Position {
    const home = this.pad(actor);
    const [lon, lat] = toGlobe(home.commissioning?.frame ?? plainFrame(home), place);
    return {
      east_mm: Math.round(place.east_mm),
      north_mm: Math.round(place.north_mm),
      up_mm: 11_000,
      lat_e7: Math.round(lat * 1e7),
      lon_e7: Math.round(lon * 1e7),
      height_mm: 45_000,
    };
  }

  private pad(actor: Actor): Pad {
    return PADS.find(({ pad_id }) => pad_id === actor.pad_id) ?? raise(`the script names no such pad: ${actor.pad_id}`);
  }
}

function isPublicLiar({ broadcastLie }: Actor): boolean {
  return broadcastLie !== undefined && Math.hypot(broadcastLie.east_mm, broadcastLie.north_mm) > 0;
}

function raise(text: string): never {
  throw new Error(text);
}

/** Ranges from anchors close together tell distance well and direction badly: the ellipse lies across the sight line. */
function covariance(place: Local, sigma_mm: number): { ee_mm2: number; en_mm2: number; nn_mm2: number } {
  const r = Math.max(1, Math.hypot(place.east_mm, place.north_mm));
  const [ue, un] = [place.east_mm / r, place.north_mm / r];
  const along = (sigma_mm * 0.35) ** 2;
  const across = (sigma_mm * (0.5 + r / 14_000)) ** 2;
  return {
    ee_mm2: Math.round(along * ue * ue + across * un * un),
    en_mm2: Math.round((along - across) * ue * un),
    nn_mm2: Math.round(along * un * un + across * ue * ue),
  };
}

function reasons(actor: Actor): VerdictSummary["reasons"] {
  if (isPublicLiar(actor)) {
    return [
      { code: "within_buffer", text: "Measured 0.11 m from the claim, within 1.00 m." },
      { code: "broadcast_contradicts", text: "Its broadcast puts it 31.04 m from where it was measured." },
    ];
  }
  if (actor.outcome === "refuted") {
    return [
      { code: "residuals", text: "Ranges disagree with the claim: χ² 412 for 4, limit 18.5" },
      { code: "countersigned", text: "The drone countersigned the ranges" },
      { code: "paper_rule", text: "The paper's rule (≤ 1 m) refuses it too" },
    ];
  }
  if (actor.outcome === "inconclusive") {
    return [
      { code: "between", text: "Likelihood 0.83 is between 0.01 and 0.99" },
      { code: "obstructed", text: "Two of four anchors saw an obstruction in most rounds" },
    ];
  }
  return [
    { code: "within_buffer", text: "The estimate lies within 1 m of the claim with likelihood 0.9982" },
    { code: "consistent", text: "The four ranges agree with each other: χ² 3.1 for 2, limit 13.8" },
    ...(actor.authorised === false
      ? [{ code: "maintenance_lapsed", text: "Maintenance lapsed on 3 November 2025" }]
      : [{ code: "authorised", text: `Authorised to ${actor.action} here until 31 December` }]),
  ];
}
