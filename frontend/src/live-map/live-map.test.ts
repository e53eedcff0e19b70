import { describe, expect, it } from "vitest";
import type { VerdictSummary } from "../shared/api/records";
import { Fleet } from "../shared/fleet";
import { PADS } from "../shared/fake/cast";
import { seeded } from "../shared/fake/random";
import { FakeWorld } from "../shared/fake/world";
import { LiveStore } from "../shared/live/store";
import { leg } from "../shared/geo/geodesic";
import { announcement } from "./Announcer";
import { clusters } from "../map/clusters";
import { accuracyFeatures, evidenceFeatures, gridFeatures, gridSpacing_m, hull, measureFeatures, metresPerPixel, padFeatures, siteFeatures, trailFeatures } from "../map/features";
import { evidenceWords, shortName } from "../map/mapWords";
import { Occupied, place, type Label } from "../map/placing";
import { padsByNeed, padState } from "../map/padState";
import { BIN_MS, BINS, bins } from "./timelineBins";

const START_MS = 1_700_000_000_000;
const store = new LiveStore();
const world = new FakeWorld(START_MS, seeded(5));
store.merge({ pads: [...PADS] });
for (let t_s = 0; t_s < 58; t_s += 0.2) store.merge(world.tick(t_s));
const NOW_MS = START_MS + 58_000;
const fleet = new Fleet(store, NOW_MS);
const all = fleet.judged;
const kinds = (features: { properties: unknown }[]): string[] =>
  features.map(({ properties }) => (properties as { kind: string }).kind);

describe("the counts of the wall", () => {
  it("count under each symbol only what has it", () => {
    const refuted = all.filter(({ look }) => look === "refuted").length;
    expect(fleet.looking("refuted")).toBe(refuted);
    expect(refuted).toBeGreaterThan(0);
    // What is undecided needs the officer as well, and is not refuted.
    expect(fleet.looking("inconclusive")).toBeGreaterThan(0);
    expect(fleet.counts["needs-you"]).toBeGreaterThan(refuted);
  });
});

describe("what the map draws", () => {
  it("draws a refuted claim as ring, buffer, line, diamond and ellipse, in its colour", () => {
    const of = all.filter(({ uav_id }) => uav_id === "OH-DRN-0417");
    const features = evidenceFeatures(of, store.pads, "OH-DRN-0417", undefined, NOW_MS);
    expect(kinds(features).sort()).toEqual(["buffer", "claim", "difference", "ellipse", "measured", "sight", "sight", "sight", "sight"]);
    for (const { properties } of features) {
      if (properties?.["kind"] !== "sight") expect(properties?.["tone"]).toBe("bad");
    }
  });

  it("draws what was told and what is broadcast where they differ; whose the broadcast is not known has no verdict's colour", () => {
    const of = all.filter(({ uav_id }) => uav_id === "OH-DRN-0640").map(({ track: _track, ...rest }) => rest);
    const rings = evidenceFeatures(of, store.pads, "OH-DRN-0640", undefined, NOW_MS).filter(({ properties }) => properties?.["kind"] === "claim");
    expect(rings.map(({ properties }) => properties?.["tone"] as string)).toEqual(["ok", "none"]);
    const own = of.map(({ verdict, ...rest }) => ({ ...rest, ...(verdict?.broadcast && { verdict: { ...verdict, outcome: "refuted" as const, broadcast: { ...verdict.broadcast, outcome: "own_contradicted" as const } } }) }));
    const signed = evidenceFeatures(own, store.pads, "OH-DRN-0640", undefined, NOW_MS).filter(({ properties }) => properties?.["kind"] === "claim");
    expect(signed.map(({ properties }) => properties?.["tone"] as string)).toEqual(["ok", "bad"]);
  });

  it("steps back with the evidence of others where one is chosen, whose words must stand", () => {
    const features = evidenceFeatures(all, store.pads, "OH-DRN-0417", undefined, NOW_MS);
    const chosen = features.filter(({ properties }) => properties?.["chosen"] === true);
    expect(chosen.map(({ properties }) => properties?.["label"] as string | undefined)).toEqual(expect.arrayContaining([expect.stringMatching(/^measured here/)]));
    expect(features.filter(({ properties }) => properties?.["faint"] === true)).toHaveLength(features.length - chosen.length);
    expect(evidenceWords(features).filter(({ rank }) => rank < 0).length).toBeGreaterThan(0);
    expect(evidenceFeatures(all, store.pads, undefined, undefined, NOW_MS).some(({ properties }) => properties?.["faint"] === true)).toBe(false);
  });

  it("names a drone once where its verdict is shown by itself", () => {
    const shown = all.find(({ uav_id }) => uav_id === "OH-DRN-0417")?.verdict;
    const labels = evidenceFeatures(all, store.pads, "OH-DRN-0417", shown, NOW_MS).map(({ properties }) => String(properties?.["label"] ?? ""));
    expect(labels.filter((each) => each.includes("OH-DRN-0417"))).toEqual([]);
  });

  it("shortens a long name in its middle", () => {
    expect(shortName("OH-DRN-0417")).toBe("OH-DRN-0417");
    expect(shortName("1596F3A4B5C6D7E8F9G0")).toBe("1596F3…E8F9G0");
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

  it("gathers what stands together in a town into one mark with the gravest look, and takes it apart closer by", () => {
    const features = siteFeatures(clusters(PADS, store.tracks, fleet, 5));
    expect(features).toHaveLength(1);
    expect(features[0]?.properties).toMatchObject({ name: "3 pads", icon: "look-refuted", note: "12 drones, 5 need you" });
    const closer = clusters(PADS, store.tracks, fleet, 12);
    expect(closer.length).toBeGreaterThan(2);
    expect(closer.reduce((sum, { drones }) => sum + drones, 0)).toBe(12);
  });

  it("counts ten thousand drones into marks that stand apart", () => {
    const crowd = new LiveStore();
    const tracks = Array.from({ length: 10_000 }, (_, i) => ({
      uav_id: `d${i}`,
      lat_e7: 600_000_000 + Math.round(9e7 * Math.sin(i)),
      lon_e7: 240_000_000 + Math.round(9e7 * Math.cos(i * 1.7)),
      t_ms: NOW_MS,
      pad_id: "p",
      transport: "wifi",
      verified: false as const,
    }));
    crowd.merge({ tracks });
    const marks = clusters([], crowd.tracks, new Fleet(crowd, NOW_MS), 5);
    expect(marks.reduce((sum, { drones }) => sum + drones, 0)).toBe(10_000);
    expect(marks.length).toBeLessThan(400);
  });

  it("draws the selected drone's own accuracy and way, as large as it says", () => {
    const drone = fleet.find("SE-UAS-7715");
    const [circle] = accuracyFeatures([drone]);
    if (circle?.geometry.type !== "Polygon") expect.fail("no circle");
    const north = Math.max(...(circle.geometry.coordinates[0] ?? []).map(([, lat = 0]) => lat));
    expect((north * 1e7 - (drone?.track?.lat_e7 ?? 0)) * 0.01114).toBeCloseTo(1, 1);
    expect(accuracyFeatures([undefined])).toEqual([]);
    expect(trailFeatures(drone === undefined ? [] : [drone], store.tracks, "SE-UAS-7715")[0]?.geometry).toMatchObject({ type: "LineString" });
  });

  it("draws a pad as square, anchors and reach; a pad without survey as a mark only", () => {
    const [pad] = PADS;
    if (pad === undefined) expect.fail("no pads");
    expect(kinds(padFeatures([pad], NOW_MS)).sort()).toEqual(["anchor", "anchor", "anchor", "anchor", "edge", "pad", "reach", "square"]);
    const { commissioning: _commissioning, ...bare } = pad;
    expect(kinds(padFeatures([bare], NOW_MS))).toEqual(["pad"]);
    expect(padFeatures([{ ...pad, status: "retired" }], NOW_MS)).toEqual([]);
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

describe("the labels", () => {
  const label = (id: string, left: number, top: number, rank: number): Label => ({ id, left, top, rank, width: 60, height: 14, clear: 9, sides: ["above", "left", "right", "below"] });

  it("cover neither each other nor a symbol, the most important first", () => {
    const occupied = new Occupied(400, 300);
    const labels = Array.from({ length: 60 }, (_, i) => label(String(i), 40 + (i % 10) * 35, 40 + Math.floor(i / 10) * 40, i));
    for (const { left, top } of labels) occupied.take(left - 8, top - 8, 16, 16);
    const placed = place([...labels].reverse(), occupied, new Map(), 100);
    expect(placed[0]?.label.id).toBe("0");
    expect(placed.length).toBeGreaterThan(8);
    for (const [i, a] of placed.entries()) {
      for (const b of placed.slice(i + 1)) {
        const apart = a.left >= b.left + 60 || b.left >= a.left + 60 || a.top >= b.top + 14 || b.top >= a.top + 14;
        expect(apart).toBe(true);
      }
      for (const { left, top } of labels) {
        expect(left + 8 <= a.left || left - 8 >= a.left + 60 || top + 8 <= a.top || top - 8 >= a.top + 14).toBe(true);
      }
    }
  });

  it("stay on their side while they can, and the selected one's stands in any case", () => {
    const one = (): Label => label("a", 200, 150, 1);
    expect(place([one()], new Occupied(400, 300), new Map([["a", "right"]]), 9)[0]?.side).toBe("right");
    const full = (): Occupied => {
      const occupied = new Occupied(400, 300);
      occupied.take(0, 0, 400, 300);
      return occupied;
    };
    expect(place([one()], full(), new Map(), 9)).toEqual([]);
    expect(place([{ ...one(), rank: -1 }], full(), new Map(), 9)).toHaveLength(1);
  });
});

describe("a measure", () => {
  it("agrees with geodesics that are known", () => {
    // Vincenty 1975: Flinders Peak to Buninyong, on its own ellipsoid; on WGS-84 by Geographic Lib.
    const found = leg([144.42486788, -37.95103341], [143.92649552, -37.65282113]);
    expect(found.distance_m).toBeCloseTo(54_972.27, 1);
    expect(found.bearing).toBeCloseTo(306.868, 2);
    expect(leg([0, 0], [0, 90]).distance_m).toBeCloseTo(10_001_965.729, 1);
    expect(leg([179.9, 0], [-179.9, 0]).distance_m).toBeCloseTo(22_263.9, 0);
    expect(leg([5, 5], [5, 5])).toEqual({ distance_m: 0, bearing: 0 });
    expect(leg([0, 0.3], [179.9, -0.3]).distance_m).toBeGreaterThan(19_900_000);
  });

  it("has a word for each leg and one for all", () => {
    const words = measureFeatures([[22, 60], [22.01, 60], [22.01, 60.01]]).filter(({ properties }) => properties?.["kind"] === "word");
    expect(words.map(({ properties }) => String(properties?.["label"]).replaceAll("\u00a0", " "))).toEqual([
      expect.stringMatching(/^55[78] m · 90°$/),
      expect.stringMatching(/^1\.1 km · 0°$/),
      expect.stringMatching(/^1\.7 km in all$/),
    ]);
    expect(measureFeatures([])).toEqual([]);
  });
});

describe("a pad's state", () => {
  const [pad] = PADS;
  if (pad?.health === undefined) throw new Error("no pads");
  const { health } = pad;
  const told = (change: object, now_ms = 1_000): string => padState({ ...pad, health: { ...health, t_ms: 0, ...change } }, now_ms).text.replaceAll("\u00a0", " ");

  it("is the gravest of what is known", () => {
    expect(told({})).toBe("all well");
    expect(told({ connected: false, anchors: [] }, 90_000)).toBe("disconnected, last word 1 min ago");
    expect(told({ anchors: [{ anchor_id: "A", state: "down" }, { anchor_id: "B", state: "up" }] })).toBe("1 of 2 anchors silent");
    expect(told({}, 40_000)).toBe("last word 40 s ago");
    expect(told({ spool: { records: 900, bytes: 1, dropped: 0 } })).toBe("lagging, 900 reports wait");
    expect(told({ spool: { records: 900, bytes: 1, dropped: 12 } })).toBe("congested, 12 reports dropped");
    expect(told({ drift: { state: "moved" } })).toBe("an anchor has moved");
    expect(told({ prekeys: 0 })).toBe("no one-time keys left");
  });

  it("brings those to the top that somebody should look at", () => {
    const [a, b, c] = PADS;
    if (a === undefined || b === undefined || c === undefined) expect.fail("too few pads");
    const silent = { ...c, health: { ...health, connected: false } };
    expect(padsByNeed([a, { ...b, status: "retired" as const }, silent], 1_000).map(({ pad: { pad_id } }) => pad_id)).toEqual([c.pad_id, a.pad_id]);
  });
});

describe("what screen readers are told", () => {
  const verdict = (uav_id: string, outcome: VerdictSummary["outcome"]): VerdictSummary => ({ uav_id, outcome, pad_id: "p" }) as VerdictSummary;

  it("is each verdict by name while they are few, else their number and who was refuted", () => {
    expect(announcement([verdict("a", "refuted"), verdict("b", "verified")], () => "Pad")).toBe("a: refuted at Pad. b: verified at Pad.");
    const many = [...Array.from({ length: 9 }, (_, i) => verdict(`v${i}`, "verified")), verdict("liar", "refuted")];
    expect(announcement(many, () => "Pad")).toBe("10 verdicts: 9 verified, 0 inconclusive, 1 refuted. Refuted: liar.");
  });
});
