import { describe, expect, it } from "vitest";
import type { VerdictSummary } from "../shared/api/records";
import { drones } from "../shared/drones";
import { PADS } from "../shared/fake/cast";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { LiveStore } from "../shared/live/store";
import { evidenceFeatures, gridFeatures, gridSpacing_m, hull, metresPerPixel, padFeatures, siteFeatures, trackPoints } from "./map/features";
import { BIN_MS, BINS, bins } from "./timeline";

const START_MS = 1_700_000_000_000;
const store = new LiveStore();
const world = new FakeWorld(START_MS, seeded(5));
store.merge({ pads: [...PADS] });
for (let t_s = 0; t_s < 58; t_s += 0.2) store.merge(world.tick(t_s));
const NOW_MS = START_MS + 58_000;
const all = drones(store, NOW_MS);
const kinds = (features: { properties: unknown }[]): string[] =>
  features.map(({ properties }) => (properties as { kind: string }).kind);

describe("what the map draws", () => {
  it("draws a refuted claim as ring, buffer, line, diamond and ellipse, in its colour", () => {
    const of = all.filter(({ uav_id }) => uav_id === "OH-DRN-0417");
    const features = evidenceFeatures(of, store.pads, "OH-DRN-0417", undefined, NOW_MS);
    expect(kinds(features).sort()).toEqual(["buffer", "claim", "difference", "ellipse", "measured", "sight", "sight", "sight", "sight"]);
    for (const { properties } of features) {
      if (properties?.["kind"] !== "sight") expect(properties?.["tone"]).toBe("bad");
    }
  });

  it("draws both claims where they differ, the told one green, the broadcast one red", () => {
    const of = all.filter(({ uav_id }) => uav_id === "OH-DRN-0640").map(({ track: _track, ...rest }) => rest);
    const rings = evidenceFeatures(of, store.pads, "OH-DRN-0640", undefined, NOW_MS).filter(({ properties }) => properties?.["kind"] === "claim");
    expect(rings.map(({ properties }) => properties?.["tone"] as string)).toEqual(["ok", "bad"]);
  });

  it("draws a running estimate hollow and unverified, with the line to the broadcast", () => {
    const of = all.filter(({ uav_id }) => uav_id === "OH-DRN-0925");
    const features = evidenceFeatures(of, store.pads, "OH-DRN-0925", undefined, NOW_MS);
    const diamond = features.find(({ properties }) => properties?.["kind"] === "measured");
    expect(diamond?.properties).toMatchObject({ icon: "measuring-accent", label: "measuring, unverified" });
    expect(kinds(features)).toContain("difference");
  });

  it("clears away a verified drone's evidence after a minute, keeps what needs the officer", () => {
    const shown = new Set(
      evidenceFeatures(all, store.pads, undefined, undefined, NOW_MS + 300_000).flatMap(({ properties }) =>
        properties?.["kind"] === "measured" ? [String(properties["tone"])] : [],
      ),
    );
    expect(shown).toEqual(new Set(["ok", "bad", "maybe", "accent"]));
    const verified = all.filter(({ group }) => group === "verified");
    expect(evidenceFeatures(verified, store.pads, undefined, undefined, NOW_MS + 300_000)).toEqual([]);
  });

  it("gives the selected drone the first rank for its label", () => {
    const points = trackPoints(all, "SE-UAS-7715");
    const least = points.reduce((a, b) => (Number(a.properties["rank"]) < Number(b.properties["rank"]) ? a : b));
    expect(least.id).toBe("SE-UAS-7715");
    expect(points.find(({ id }) => id === "OH-DRN-0417")?.properties["icon"]).toBe("look-refuted");
  });

  it("gathers pads of a town into one site with the gravest look", () => {
    const sites = siteFeatures(PADS, all);
    expect(sites).toHaveLength(1);
    expect(sites[0]?.properties).toMatchObject({ name: "3 pads", icon: "look-refuted", note: "12 drones, 5 need you" });
  });

  it("draws a pad as square, anchors and reach; a pad without survey as a mark only", () => {
    const [pad] = PADS;
    if (pad === undefined) expect.fail("no pads");
    expect(kinds(padFeatures([pad])).sort()).toEqual(["anchor", "anchor", "anchor", "anchor", "edge", "pad", "reach", "square"]);
    const { commissioning: _commissioning, ...bare } = pad;
    expect(kinds(padFeatures([bare]))).toEqual(["pad"]);
    expect(padFeatures([{ ...pad, status: "retired" }])).toEqual([]);
  });

  it("orders a hull's corners around, whatever their order in the record", () => {
    const corner = (east_mm: number, north_mm: number): { east_mm: number; north_mm: number } => ({ east_mm, north_mm });
    const ring = hull([corner(0, 0), corner(10, 10), corner(10, 0), corner(0, 10)]);
    expect(ring).toHaveLength(5);
    for (let i = 1; i < ring.length; i++) {
      const [a, b] = [ring[i - 1], ring[i]];
      expect(Math.hypot((a?.east_mm ?? 0) - (b?.east_mm ?? 0), (a?.north_mm ?? 0) - (b?.north_mm ?? 0))).toBe(10);
    }
  });
});

describe("the metre grid", () => {
  it("is never finer than can be told apart, and stops where metres say nothing", () => {
    expect(gridSpacing_m(20.3, 60)).toBe(2);
    expect(gridSpacing_m(5, 60)).toBeUndefined();
    for (let zoom = 12; zoom < 22; zoom += 0.37) {
      const spacing = gridSpacing_m(zoom, 60) ?? 0;
      expect(spacing / metresPerPixel(zoom, 60)).toBeGreaterThanOrEqual(56);
    }
  });

  it("lies in the pad's frame, with its axes marked", () => {
    const [pad] = PADS;
    if (pad === undefined) expect.fail("no pads");
    const view = { west: pad.lon_e7 / 1e7 - 0.0002, east: pad.lon_e7 / 1e7 + 0.0002, south: pad.lat_e7 / 1e7 - 0.0001, north: pad.lat_e7 / 1e7 + 0.0001 };
    const lines = gridFeatures(pad, view, 5);
    expect(lines.filter(({ properties }) => properties?.["axis"] === true)).toHaveLength(2);
    expect(lines.length).toBeGreaterThan(8);
    expect(lines.length).toBeLessThan(20);
  });
});

describe("the strip of the last hour", () => {
  const verdict = (outcome: VerdictSummary["outcome"], decided_ms: number): VerdictSummary =>
    ({ outcome, decided_ms, session_id: `${outcome}${decided_ms}` }) as VerdictSummary;

  it("counts by half minute and keeps the gravest for the press", () => {
    const now = 1_700_000_025_000;
    const found = bins([verdict("verified", now), verdict("refuted", now - 1), verdict("verified", now - 2), verdict("verified", now - 4_000_000)], now);
    expect(found).toHaveLength(BINS);
    const last = found.at(-1);
    expect(last).toMatchObject({ verified: 2, refuted: 1, inconclusive: 0 });
    expect(last?.gravest?.outcome).toBe("refuted");
    expect(found.reduce((sum, bin) => sum + bin.verified + bin.refuted, 0)).toBe(3);
  });

  it("does not shift its bars while a half minute lasts", () => {
    const now = 1_700_000_010_000;
    expect(bins([], now)[0]?.start_ms).toBe(bins([], now + 5_000)[0]?.start_ms);
    expect(bins([], now + BIN_MS)[0]?.start_ms).toBe((bins([], now)[0]?.start_ms ?? 0) + BIN_MS);
  });
});
