import type {
  Estimate,
  Judgement,
  Outcome,
  Pad,
  Position,
  SessionSummary,
  Status,
  StepName,
  Track,
  VerdictSummary,
} from "../api/records";
import { plainFrame, toGlobe, type Local } from "../geo/frame";
import type { Changes } from "../live/protocol";
import { ACTORS, CYCLE_S, PADS, at, type Actor } from "./cast";
import { hex, noise, type Random } from "./random";

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


const plus = (a: Local, b: Local = at(0, 0)): Local => at(a.east_mm + b.east_mm, a.north_mm + b.north_mm);

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
    const changes: Required<Omit<Changes, "status" | "pads" | "alerts">> = { tracks: [], estimates: [], sessions: [], verdicts: [] };
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
        connected: true,
        halted: null,
        organisations: ["AuthorityMSP", "PadMSP", "FleetMSP"],
        alone_since_ms: null,
        rows_checked_ms: null,
        rows_differ: [],
      },
      server: { version: "0.1.0", epoch: "fake", demo: true },
      counts: {
        pads: PADS.length,
        pads_connected: PADS.length,
        drones: ACTORS.length,
        tracks: ACTORS.length,
        sessions: 0,
        verdicts: 0,
        verified: 0,
        refuted: 0,
        inconclusive: 0,
        agents: PADS.length,
        viewers: 1,
      },
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
      ...actor.says,
    };
  }

  private session(actor: Actor, cycle: number, into_s: number, requested_ms: number): SessionSummary {
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
      expires_ms: requested_ms + 60_000,
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
      decided_ms: requested_ms + DECIDED_S * 1000,
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

  private verdict(actor: Actor, session: SessionSummary, decided_ms: number): VerdictSummary {
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
      reasons: [outcome === "refuted" ? { code: "outside_buffer", facts: { error_mm: error(claim), buffer_mm: 1_000, significance_milli: 12_400 } } : { code: "within_buffer", facts: { error_mm: error(claim), buffer_mm: 1_000 } }],
    });
    const broadcastAt = plus(signedAt, actor.broadcastLie);
    const heard = { verified: "supported", refuted: "contradicted", inconclusive: "undecided" } as const;
    const { likelihood_ppm, error_mm, claim } = judged(broadcastAt, isPublicLiar(actor) ? "refuted" : actor.outcome);
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
      more_rounds: isPublicLiar(actor) ? 20 : actor.outcome === "inconclusive" ? 38 : -1,
      signed: judged(signedAt, isPublicLiar(actor) ? "verified" : actor.outcome),
      broadcast: {
        outcome: isPublicLiar(actor) ? "contradicted" : heard[actor.outcome],
        messages: 4,
        attributed: 0,
        supported: !isPublicLiar(actor) && actor.outcome === "verified",
        claim,
        error_mm,
        likelihood_ppm,
        tolerance_mm: 2_000,
      },
      estimate: this.position(actor, found),
      estimate_ms: Math.round(decided_ms) - 900,
      covariance: covariance(actor.hover, actor.sigma_mm),
      height: {
        outcome: actor.outcome === "verified" ? "proved" : "claimed",
        claimed_mm: 11_000,
        measured_mm: 11_040,
        lowest_mm: 10_610,
        highest_mm: 11_470,
        tolerance_mm: 1_000,
        likelihood_ppm: 999_900,
        uu_mm2: 20_500,
        eu_mm2: 1_200,
        nu_mm2: -900,
        chi2_milli: 2_700,
      },
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
      { code: "within_buffer", facts: { error_mm: 110, buffer_mm: 1_000 } },
      { code: "broadcast_contradicts", facts: { error_mm: 31_040 } },
      { code: "broadcast_unsupported", facts: {} },
    ];
  }
  if (actor.outcome === "refuted") return [{ code: "outside_buffer", facts: { error_mm: 4_210, buffer_mm: 1_000, significance_milli: 12_400 } }];
  if (actor.outcome === "inconclusive") {
    return [
      { code: "obstructed", facts: { ranges: 38 } },
      { code: "undecided", facts: { error_mm: 820, sigma_mm: 310 } },
    ];
  }
  return [
    { code: "within_buffer", facts: { error_mm: 40, buffer_mm: 1_000 } },
    ...(actor.authorised === false ? [{ code: "maintenance_lapsed", facts: { until_ms: Date.UTC(2025, 10, 3) } }] : []),
  ];
}
