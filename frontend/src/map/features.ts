import type { Feature, LineString, Point, Polygon, Position } from "geojson";
import type { Estimate, Frame, Judgement, Pad, Position as Place, Track, VerdictSummary } from "../shared/api/records";
import { TONE_OF, type Tone } from "../shared/design/symbols";
import type { Drone } from "../shared/drones";
import { length } from "../shared/format";
import { circle, ellipse, outline } from "../shared/geo/ellipse";
import { distance_mm, frameOf, lonLat, plainFrame, toGlobe, type Local, type LonLat } from "../shared/geo/frame";
import { latitude, longitude } from "../shared/geo/mercator";
import { leg, path } from "../shared/geo/geodesic";
import type { TrackTable } from "../shared/live/tracks";
import { broadcastApart, refutedBy } from "../shared/refuted";
import { inUse, padState } from "./padState";
import { mapTexts as t, padTexts } from "./texts";
import type { Cluster } from "./clusters";

/** A verified drone's evidence stays on the map this long; what needs the officer stays while it does. */
export const VERIFIED_SHOWN_MS = 60_000;

function point(at: LonLat, properties: Record<string, unknown>): Feature<Point> {
  return { type: "Feature", geometry: { type: "Point", coordinates: at }, properties };
}

function line(coordinates: Position[], properties: Record<string, unknown>): Feature<LineString> {
  return { type: "Feature", geometry: { type: "LineString", coordinates }, properties };
}

function area(frame: Frame, ring: readonly Local[], properties: Record<string, unknown>): Feature<Polygon> {
  return {
    type: "Feature",
    geometry: { type: "Polygon", coordinates: [ring.map((local) => toGlobe(frame, local))] },
    properties,
  };
}

/** The anchors' outline: in order of direction from their middle. */
export function hull(points: readonly Local[]): Local[] {
  const east = points.reduce((sum, { east_mm }) => sum + east_mm, 0) / points.length;
  const north = points.reduce((sum, { north_mm }) => sum + north_mm, 0) / points.length;
  const sorted = [...points].sort(
    (a, b) => Math.atan2(a.north_mm - north, a.east_mm - east) - Math.atan2(b.north_mm - north, b.east_mm - east),
  );
  const [first] = sorted;
  return first === undefined ? [] : [...sorted, first];
}

/** Pads as they are commissioned, and as they do at a time. */
export function padFeatures(pads: Iterable<Pad>, now_ms: number): Feature[] {
  const features: Feature[] = [];
  for (const pad of pads) {
    if (pad.status === "retired") continue;
    const frame = frameOf(pad);
    const commissioning = pad.commissioning ?? undefined;
    const { tone, text } = padState(pad, now_ms);
    const reach = commissioning === undefined ? padTexts("notCommissioned") : t("rangesTo", { distance: length(commissioning.max_range_mm, true) });
    const note = { note: tone === "ok" ? (inUse(pad, now_ms) ?? reach) : text, tone };
    features.push(point(lonLat(pad), { kind: "pad", pad_id: pad.pad_id, name: pad.name, icon: tone === "ok" ? "pad" : `pad-${tone}`, ...note }));
    if (commissioning === undefined) continue;
    features.push(area(frame, circle(commissioning.max_range_mm, { east_mm: 0, north_mm: 0 }, 96), { kind: "reach" }));
    features.push(area(frame, hull(commissioning.anchors), { kind: "square" }));
    const south_mm = Math.min(...commissioning.anchors.map(({ north_mm }) => north_mm));
    const middle_mm = commissioning.anchors.reduce((sum, { east_mm }) => sum + east_mm, 0) / commissioning.anchors.length;
    features.push(point(toGlobe(frame, { east_mm: middle_mm, north_mm: south_mm }), { kind: "edge", pad_id: pad.pad_id, name: pad.name, ...note }));
    for (const anchor of commissioning.anchors) {
      const state = pad.health?.anchors.find(({ anchor_id }) => anchor_id === anchor.anchor_id)?.state;
      features.push(point(toGlobe(frame, anchor), { kind: "anchor", up: state === undefined || state === "up" }));
    }
  }
  return features;
}

/** Clusters as marks: what they hold, in two lines. */
export function siteFeatures(all: readonly Cluster[]): Feature<Point>[] {
  return all.map(({ x, y, pads, drones, needing, look, bounds }) => {
    const [first] = pads;
    const names = pads.length === 1 && first !== undefined ? first.name : t("padCount", { count: pads.length });
    const crowd = drones === 0 ? "" : t("droneCount", { count: drones, needing });
    return point([longitude(x), latitude(y)], {
      name: pads.length === 0 ? crowd : names,
      note: pads.length === 0 ? "" : crowd,
      icon: look !== undefined ? `look-${look}` : pads.length > 0 ? "pad" : "look-unproved",
      grave: needing > 0,
      bounds: bounds.join(" "),
    });
  });
}

/** More than so many trails nobody can follow. */
const MOST_TRAILS = 200;
const TRAIL_AGES = 4;

/** The way of those that were judged, and of the selected; in calm skies of everybody. */
export function trailFeatures(drones: readonly Drone[], tracks: TrackTable, selected: string | undefined): Feature[] {
  const features: Feature[] = [];
  for (const drone of drones) {
    const trail = tracks.trail(drone.uav_id);
    if (trail.length < 2 || (features.length >= MOST_TRAILS * TRAIL_AGES && drone.uav_id !== selected)) continue;
    const strong = drone.uav_id === selected || drone.group === "needs-you";
    const way = trail.map((place) => lonLat({ ...place }));
    // The older, the fainter: in parts that share their ends.
    const part = Math.ceil((way.length - 1) / TRAIL_AGES);
    for (let age = 0, end = way.length - 1; age < TRAIL_AGES && end > 0; age++, end -= part) {
      features.push(line(way.slice(Math.max(0, end - part), end + 1), { tone: TONE_OF[drone.look], strong, age }));
    }
  }
  return features;
}

/** What a drone says of its own accuracy, as a circle around where it says it is. */
export function accuracyFeatures(drones: readonly (Drone | undefined)[]): Feature[] {
  return drones.flatMap((drone) => {
    const { track } = drone ?? {};
    if (drone === undefined || track?.accuracy_mm === undefined || track.accuracy_mm === 0) return [];
    return [area(plainFrame(track), circle(track.accuracy_mm, { east_mm: 0, north_mm: 0 }), { kind: "accuracy", tone: TONE_OF[drone.look] })];
  });
}

/** The measure: its legs, each with its length and bearing, and the sum of all at the end. */
export function measureFeatures(points: readonly LonLat[]): Feature[] {
  const features: Feature[] = points.map((at) => point(at, { kind: "end" }));
  let total_m = 0;
  points.forEach((to, i) => {
    const from = points[i - 1];
    if (from === undefined) return;
    const { distance_m, bearing } = leg(from, to);
    total_m += distance_m;
    const way = path(from, to);
    features.push(line(way, { kind: "leg" }));
    const middle = way.length > 2 ? way[Math.floor(way.length / 2)] : ([(from[0] + to[0]) / 2, (from[1] + to[1]) / 2] as LonLat);
    features.push(point(middle ?? to, { kind: "word", label: t("leg", { distance: length(distance_m * 1000), bearing: Math.round(bearing) % 360 }) }));
  });
  const last = points.at(-1);
  if (points.length > 2 && last !== undefined) features.push(point(last, { kind: "word", label: t("inAll", { distance: length(total_m * 1000) }) }));
  return features;
}

/** How the signed claim is drawn. */
function toneOf(verdict: VerdictSummary, signed: Judgement): Tone {
  return TONE_OF[signed.outcome === "verified" ? "verified" : verdict.outcome];
}

type Claimed = { claim: Place; tone: Tone; words: string; radius_mm: number; foreign?: true };

function claimsOf(verdict: VerdictSummary): Claimed[] {
  const { signed, broadcast, buffer_mm } = verdict;
  const apart = broadcastApart(verdict);
  const told: Claimed[] = signed === undefined ? [] : [{ claim: signed.claim, tone: toneOf(verdict, signed), words: t(apart === undefined ? "saysHere" : "toldPad"), radius_mm: buffer_mm }];
  if (apart === undefined || broadcast?.claim === undefined) return told;
  // Both are shown where they differ; where they agree, one ring says it.
  const words = t(apart === "own" ? "tellsPublic" : "somebodyTells");
  return [...told, { claim: broadcast.claim, tone: apart === "own" ? "bad" : "none", words, radius_mm: broadcast.tolerance_mm ?? buffer_mm, ...(apart === "somebody" && { foreign: true as const }) }];
}

const RING_APART_MM = 1_500;

/** Metres above the pad, where the map's ground is. */
function upOf({ up_mm }: { up_mm?: number }): number {
  return Math.max(0, (up_mm ?? 0) / 1000);
}

/** The judged claim, the measurement and all between them. */
function verdictFeatures(verdict: VerdictSummary, pad: Pad, selected: boolean, track: Track | undefined): Feature[] {
  const { estimate, covariance } = verdict;
  if (estimate === undefined) return [];
  const frame = frameOf(pad);
  const measuredAt = toGlobe(frame, estimate);
  const tone = TONE_OF[verdict.outcome];
  const features: Feature[] = [];
  for (const { claim, tone: claimTone, words, radius_mm, foreign } of claimsOf(verdict)) {
    const claimAt = toGlobe(frame, claim);
    const up_m = upOf(claim);
    features.push(area(frame, circle(radius_mm, claim), { kind: "buffer", tone: claimTone, up_m, half_m: radius_mm / 1000 }));
    features.push(line([claimAt, measuredAt], { kind: "difference", tone: claimTone, up_m, to_m: upOf(estimate) }));
    if (foreign) {
      // Not the drone's: no name of its own, and its own symbol does not stand for it.
      features.push(point(claimAt, { kind: "claim", tone: claimTone, label: selected ? words : "", up_m }));
      continue;
    }
    // A drone that is heard has its own label, wherever it is by now.
    const label = [...(track === undefined ? [verdict.uav_id] : []), ...(selected ? [words] : [])].join("\n");
    // A drone that still is where it said is its own ring.
    if (track === undefined || distance_mm(track, claim) > RING_APART_MM) {
      features.push(point(claimAt, { kind: "claim", tone: claimTone, label, up_m }));
    }
  }
  if (covariance !== undefined) {
    features.push(area(frame, outline(ellipse(covariance), estimate), { kind: "ellipse", tone, up_m: upOf(estimate) }));
  }
  const label = selected ? measuredWords(verdict) : "";
  features.push(point(measuredAt, { kind: "measured", tone, icon: `measured-${tone}`, label, up_m: upOf(estimate) }));
  if (selected) features.push(...sights(frame, pad, measuredAt));
  return features;
}

function measuredWords(verdict: VerdictSummary): string {
  // Falsified time stamps bend the ranges to fit: where these meet, nothing was measured.
  if (refutedBy(verdict) === "stamps") return t("rangesMeet");
  const { signed, broadcast } = verdict;
  const off_mm = broadcast?.error_mm;
  if (off_mm !== undefined && broadcastApart(verdict) !== undefined) return t("measuredFromBroadcast", { distance: length(off_mm, true) });
  if (signed === undefined || signed.outcome === "verified") return t("measuredHere");
  return t("measuredAway", { distance: length(signed.error_mm, true) });
}

function sights(frame: Frame, pad: Pad, to: LonLat): Feature[] {
  return (pad.commissioning?.anchors ?? []).map((anchor) => line([toGlobe(frame, anchor), to], { kind: "sight" }));
}

/** What the pad measures while it ranges, and how far that is from the broadcast: nobody's verdict yet. */
function estimateFeatures(estimate: Estimate, drone: Drone, pad: Pad, selected: boolean): Feature[] {
  const frame = frameOf(pad);
  const at = toGlobe(frame, estimate);
  const tone: Tone = "accent";
  // A running estimate is of where, not of how high: for that the drone's word is taken.
  const up_m = upOf({ up_mm: (drone.track?.height_mm ?? pad.height_mm) - pad.height_mm });
  const features: Feature[] = [
    area(frame, outline(ellipse(estimate), estimate), { kind: "ellipse", tone, up_m }),
    point(at, {
      kind: "measured",
      up_m,
      tone,
      icon: `measuring-${tone}`,
      label: selected ? t("measuring") : "",
    }),
    ...sights(frame, pad, at),
  ];
  if (drone.track !== undefined) features.push(line([lonLat(drone.track), at], { kind: "difference", tone, up_m, to_m: up_m }));
  return features;
}

export function evidenceFeatures(
  drones: readonly Drone[],
  pads: ReadonlyMap<string, Pad>,
  selected: string | undefined,
  shown: VerdictSummary | undefined,
  now_ms: number,
): Feature[] {
  const chosen: Feature[] = [];
  const others: Feature[] = [];
  for (const drone of drones) {
    // A verdict that is shown by itself is what was chosen, not whatever its drone does now.
    const isSelected = drone.uav_id === selected && shown === undefined;
    const features = isSelected ? chosen : others;
    const { session, verdict, estimate } = drone;
    if (session === undefined) continue;
    const pad = pads.get(session.pad_id);
    if (pad === undefined) continue;
    if (session.state === "requested") {
      if (estimate?.session_id === session.session_id) features.push(...estimateFeatures(estimate, drone, pad, isSelected));
    } else if (verdict?.session_id === session.session_id && verdict.session_id !== shown?.session_id) {
      const fresh = now_ms - verdict.decided_ms < VERIFIED_SHOWN_MS;
      if (isSelected || fresh || drone.group === "needs-you") {
        features.push(...verdictFeatures(verdict, pad, isSelected, drone.track));
      }
    }
  }
  const pad = shown === undefined ? undefined : pads.get(shown.pad_id);
  if (shown !== undefined && pad !== undefined) {
    chosen.push(...verdictFeatures(shown, pad, true, drones.find(({ uav_id }) => uav_id === shown.uav_id)?.track));
  }
  // Where one is looked at, the others step back.
  return chosen.length === 0 ? others : [...others.map((each) => marked(each, "faint")), ...chosen.map((each) => marked(each, "chosen"))];
}

function marked(feature: Feature, as: "faint" | "chosen"): Feature {
  return { ...feature, properties: { ...feature.properties, [as]: true } };
}

const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] as const;
/** Grid lines are at least this far apart on the screen. */
const GRID_PIXELS = 56;

/** Metres of one screen pixel (MapLibre's zoom: a world of 512 · 2^zoom pixels). */
export function metresPerPixel(zoom: number, lat: number): number {
  return (40_075_016.686 * Math.cos((lat * Math.PI) / 180)) / (512 * 2 ** zoom);
}

/** The spacing of the metre grid at a scale; undefined where a metre grid says nothing. */
export function gridSpacing_m(zoom: number, lat: number): number | undefined {
  const least = metresPerPixel(zoom, lat) * GRID_PIXELS;
  return STEPS_M.find((step) => step >= least);
}

export type View = { west: number; east: number; south: number; north: number };

/** A metre grid in a pad's frame over a view. */
export function gridFeatures(pad: Pad, view: View, spacing_m: number): Feature[] {
  const origin = lonLat(pad);
  const frame = frameOf(pad);
  const perLat = distance_mm(pad, { lat_e7: pad.lat_e7 + 10_000, lon_e7: pad.lon_e7 }) / 0.001;
  const perLon = distance_mm(pad, { lat_e7: pad.lat_e7, lon_e7: pad.lon_e7 + 10_000 }) / 0.001;
  const step = spacing_m * 1000;
  const lines = (from: number, to: number): number[] => {
    const first = Math.floor(from / step);
    const count = Math.min(200, Math.ceil(to / step) - first);
    return Array.from({ length: count + 1 }, (_, i) => (first + i) * step);
  };
  const east = lines((view.west - origin[0]) * perLon, (view.east - origin[0]) * perLon);
  const north = lines((view.south - origin[1]) * perLat, (view.north - origin[1]) * perLat);
  const [west_mm = 0, east_mm = 0] = [east[0], east.at(-1)];
  const [south_mm = 0, north_mm = 0] = [north[0], north.at(-1)];
  const globe = (e: number, n: number): LonLat => toGlobe(frame, { east_mm: e, north_mm: n });
  return [
    ...east.map((e) => line([globe(e, south_mm), globe(e, north_mm)], { axis: e === 0 })),
    ...north.map((n) => line([globe(west_mm, n), globe(east_mm, n)], { axis: n === 0 })),
  ];
}
