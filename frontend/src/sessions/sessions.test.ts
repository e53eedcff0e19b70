import { describe, expect, it } from "vitest";
import type { SessionSummary, VerdictSummary } from "../shared/api/records";
import { PADS } from "../shared/fake/cast";
import type { Phrase } from "../shared/i18n/texts";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { refutedBy } from "../shared/refuted";
import { signature } from "./broadcastTexts";
import { stepRows } from "./stepRows";
import { account, whereabouts } from "./words";

const world = new FakeWorld(1_700_000_000_000, seeded(3));
const sessions = new Map<string, SessionSummary>();
const verdicts = new Map<string, VerdictSummary>();
for (let t_s = 0; t_s < 60; t_s += 0.2) {
  const changes = world.tick(t_s);
  for (const session of changes.sessions ?? []) sessions.set(session.uav_id, session);
  for (const verdict of changes.verdicts ?? []) verdicts.set(verdict.uav_id, verdict);
}
const verdict = (id: string): VerdictSummary => verdicts.get(id) ?? expect.fail(`no verdict of ${id}`);
const session = (id: string): SessionSummary => sessions.get(id) ?? expect.fail(`no session of ${id}`);
const pad = (id: string): (typeof PADS)[number] | undefined => PADS.find(({ pad_id }) => pad_id === id);

function text(phrases: readonly Phrase[]): string {
  return phrases.map((phrase) => (typeof phrase === "string" ? phrase : phrase.strong)).join("").replaceAll("\u00a0", " ");
}

describe("the verdict in words", () => {
  const say = (value: VerdictSummary): string => {
    const { title, sentence } = account(value, pad(value.pad_id));
    return `${title}. ${text(sentence)}`;
  };

  it("says what was claimed, who measured, and how far it is off", () => {
    expect(say(verdict("OH-DRN-0417"))).toMatch(
      /^Refuted\. OH-DRN-0417 says it is 13\.2 m north of Aurajoki 2\. Four anchors measured it 4\.\d m from there\.$/,
    );
  });

  it("tells a lie to the public that the drone signed from a lie to the pad", () => {
    const liar = verdict("OH-DRN-0640");
    const broadcast = { ...(liar.broadcast ?? expect.fail("nothing was heard")), outcome: "own_contradicted" as const, attributed: 4 };
    const own = { ...liar, outcome: "refuted" as const, broadcast };
    expect(refutedBy(own)).toBe("broadcast");
    expect(say(own)).toMatch(
      /^Refuted\. OH-DRN-0640 tells the public that it is 23\.\d m north-east of Kupittaa, and signed for that\. Four anchors measured it 31 m from there\. With its stated accuracy and its age that can mean no more than 2 m\. What it told Kupittaa holds\.$/,
    );
  });

  it("convicts nobody by what anybody can broadcast", () => {
    const open = verdict("OH-DRN-0640");
    expect(refutedBy(open)).toBeUndefined();
    const somebody = / Somebody broadcasts its serial number 31 m from where it was measured: an impostor, or its own lie\./;
    expect(say(open)).toMatch(/^Inconclusive\. OH-DRN-0640 says it is .* its ranges fit that to within .* it is within 14 m of the pad\./);
    expect(say(open)).toMatch(somebody);
    expect(say(open)).toMatch(/ Not verified: No broadcast under its serial number was heard that the measurement supports\.$/);
    const honest = { ...open, outcome: "verified" as const, permission: "granted" as const };
    expect(say(honest)).toMatch(/^Verified\. OH-DRN-0640 says it is .* Four anchors measured it there/);
    expect(say(honest)).toMatch(somebody);
    expect(say(honest)).not.toContain("Not verified");
    // One that was led astray broadcasts what it signs: its own refutation says it.
    const astray = { ...verdict("OH-DRN-0417"), broadcast: open.broadcast ?? expect.fail("nothing was heard") };
    expect(say(astray)).not.toMatch(somebody);
  });

  it("says why a drone is refuted whose ranges fit", () => {
    const liar = verdict("OH-DRN-0417");
    const signed = { ...(liar.signed ?? expect.fail("it has no signed claim")), error_mm: 47, likelihood_ppm: 999_000 };
    const by = (code: string): VerdictSummary => ({ ...liar, reasons: [], signed: { ...signed, reasons: [{ code: "within_buffer", facts: {} }, { code, facts: {} }] } });
    const time_differences = { pad_id: "aurajoki-2", frames: 40, finding: "outside" as const, agrees: false, more_frames: -1, error_mm: 3_640 };
    const bent = { ...by("time_differences_contradict"), time_differences };
    expect(refutedBy(bent)).toBe("stamps");
    expect(say(bent)).toMatch(/its ranges fit: its own radio told their times\. The time stamps of the pad alone put it 3\.6 m from there\.$/);
    expect(say(by("time_differences_contradict"))).toMatch(/The time stamps of the pad alone contradict them\.$/);
    expect(say(by("leaving"))).toMatch(/and was, to within 0\.05 m over all rounds\. The newest of them exclude that place: it was leaving\.$/);
    for (const each of [bent, by("leaving")]) expect(say(each)).not.toContain("measured it");
    const height = { ...(liar.height ?? expect.fail("it has no height")), outcome: "contradicted" as const, claimed_mm: 11_000, measured_mm: 6_000 };
    const high = { ...by("height_contradicts"), height };
    expect(refutedBy(high)).toBe("height");
    expect(say(high)).toMatch(/measured it 5 m below the height that it claims\.$/);
    // Where the ranges refute as well, they are the plainer word.
    const both = { ...bent, signed: { ...signed, error_mm: 4_210, reasons: [{ code: "outside_buffer", facts: {} }, { code: "time_differences_contradict", facts: {} }] } };
    expect(say(both)).toContain("Four anchors measured it 4.2 m from there.");
  });

  it("says that a true position permits nothing by itself", () => {
    expect(say(verdict("OH-DRN-0512"))).toMatch(/^Verified, landing refused\. .* It may not land: it is not authorised\.$/);
  });

  it("says a distance, not a place, where two-way ranges prove no more", () => {
    const fine = verdict("OH-DRN-0512");
    expect(say(fine)).toContain("measured it there");
    const bounded = { ...fine, within_mm: 14_000, reasons: [{ code: "upper_bound", facts: {} }] };
    expect(say(bounded)).toContain("What they prove is that it is within 14 m of the pad.");
    expect(say(bounded)).not.toContain("measured it there");
  });

  it("says neither a place nor a distance where nothing binds the ranges", () => {
    const unbound = { ...verdict("OH-DRN-0512"), assurance: 0, reasons: [{ code: "ranges_unbound", facts: { measured_by: "pad" } }] };
    expect(say(unbound)).toContain("Nothing binds them to it: that is assurance 0");
    expect(say(unbound)).not.toMatch(/measured it there|What they prove/);
  });

  it("says what would settle an open case, or that nothing would, or what stood in the way", () => {
    const open = verdict("OH-DRN-0871");
    expect(say(open)).toContain("160 rounds of ranging neither confirm nor refute it. About 38 more would settle it.");
    expect(say({ ...open, more_rounds: -1 })).toContain("No further ranging would settle it.");
    const reasons = [{ code: "not_countersigned", facts: {} }];
    expect(say({ ...open, more_rounds: -1, reasons })).toContain("Not verified: The drone did not countersign the ranges.");
  });

  it("manages without claim, estimate and pad", () => {
    const { signed, broadcast, estimate, ...bare } = verdict("OH-DRN-0871");
    expect([signed, broadcast, estimate]).not.toContain(undefined);
    const { sentence } = account({ ...bare, rounds: 0 }, undefined);
    expect(text(sentence)).toContain("asked for landing at aurajoki-2");
  });

  it("names places as one would", () => {
    expect(whereabouts({ east_mm: 700, north_mm: -900 }, "P")).toBe("over P");
    expect(whereabouts({ east_mm: -4_000, north_mm: 0 }, "P").replaceAll("\u00a0", " ")).toBe("4 m west of P");
  });
});

describe("the eight steps", () => {
  it("are all there with times and transactions once decided", () => {
    const rows = stepRows(session("OH-DRN-0417"));
    expect(rows.map(({ number }) => number)).toEqual([1, 2, 3, 4, 5, 6, 7, 8]);
    expect(rows.map(({ state }) => state)).toEqual(["done", "done", "done", "done", "done", "done", "failed", "refused"]);
    expect(rows[4]).toMatchObject({ name: "Range, 24 rounds", took_ms: 3_500 });
    expect(rows[0]?.tx_id).toMatch(/^[0-9a-f]{64}$/);
    expect(rows[6]?.tx_id).toBe(verdict("OH-DRN-0417").tx_id);
  });

  it("show what is under way and what is to come", () => {
    const running: SessionSummary = { ...session("OH-DRN-0417"), state: "requested", steps: session("OH-DRN-0417").steps.slice(0, 4) };
    delete running.outcome;
    delete running.permission;
    delete running.verdict_tx;
    expect(stepRows(running).map(({ state }) => state)).toEqual(["done", "done", "done", "done", "now", "waiting", "waiting", "waiting"]);
  });

  it("say what a cancelled session never reached", () => {
    const rows = stepRows(session("OH-DRN-0733"));
    expect(rows.map(({ state }) => state)).toEqual(["done", "done", "failed", "never", "never", "never", "never", "never"]);
  });

  it("take no negative time where two clocks disagree", () => {
    const skewed = { ...session("OH-DRN-0417") };
    skewed.steps = skewed.steps.map((step) => (step.source === "pad" ? { ...step, t_ms: step.t_ms - 90_000 } : step));
    for (const row of stepRows(skewed)) expect(row.took_ms ?? 0).toBeGreaterThanOrEqual(0);
  });
});

describe("who signed a drone's broadcasts", () => {
  const drip = { det: "2001:30::1", format: "wrapper", t_ms: 1, signer: "HDA 20", covers_location: true, bound: true } as const;

  it("says verified only of positions that were signed", () => {
    expect(signature({ ...drip, state: "verified" })).toMatch(/^Positions signed by a drone of HDA 20\..*not that it is true\.$/);
    expect(signature({ ...drip, state: "verified", covers_location: false })).toMatch(/^Signed, but no position/);
    expect(signature({ ...drip, state: "verified", bound: false })).toMatch(/not tied to this serial number/);
    expect(signature({ ...drip, state: "endorsed", format: "link" })).toMatch(/nothing was signed.*Anybody can repeat/);
    expect(signature({ ...drip, state: "refused", reason: "the signature is wrong" })).toBe("Signature refused: the signature is wrong.");
  });
});
