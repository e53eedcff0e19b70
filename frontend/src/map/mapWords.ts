import type { Feature, Point } from "geojson";
import { HIDDEN, type Fleet } from "../shared/fleet";
import { mercatorX, mercatorY } from "../shared/geo/mercator";
import { length, speed } from "../shared/format";
import type { LiveStore } from "../shared/live/store";
import { mapWishes } from "./mapWishes";
import { upOf } from "./heights";
import type { Line, Words } from "./labels";
import type { Occupied, Side } from "./placing";
import { CLOSE_ZOOM, SITE_ZOOM, SQUARE_ZOOM } from "./scales";
import { spotOf, type Spot, type View } from "./view";

/** From here on, drones of which only what is heard is known have their names. */
const NAMES_ZOOM = 11;
const PAD_NAMES_ZOOM = 10.5;
const PAD_NOTES_ZOOM = 15.5;
/** In a crowd, names would not be read; this many are tried. */
const MOST_HEARD = 400;
const HALF = 9;
/** Closer than this, and among no more drones than this, a drone's name has its height and so on below it. */
const BLOCKS_ZOOM = 14.5;
const BLOCKS_MOST = 150;
const LONGEST = 16;
const SHORT_HEAD = 6;
const SHORT_TAIL = 6;
const CLIMBING_MM_S = 400;
/** What a line takes to each side, and how far apart its points are, pixels. */
const LINE_HALF = 2;
const STEP_PX = 5;
const MOST_STEPS = 400;

/** Lower comes first. Negative stands in any case. */
const RANK = { measure: -3, selected: -2, chosen: -1, evidence: 1, site: 1, pad: 100, judged: 10, heard: 10_000 } as const;

const ABOVE: readonly Side[] = ["above", "left", "right", "below"];
const BELOW: readonly Side[] = ["below", "above", "left", "right"];
const BESIDE: readonly Side[] = ["right", "left", "below", "above"];

type Properties = { up_m?: number; to_m?: number; half_m?: number; kind?: string; label?: string; name?: string; note?: string; tone?: "ok" | "maybe" | "bad"; grave?: boolean; chosen?: boolean; faint?: boolean };

function at({ geometry }: Feature<Point>): { x: number; y: number } {
  const [lon = 0, lat = 0] = geometry.coordinates;
  return { x: mercatorX(lon), y: mercatorY(lat) };
}

function isPoint(feature: Feature): feature is Feature<Point> {
  return feature.geometry.type === "Point";
}

const lines = (text: string): Line[] => text.split("\n").filter((each) => each !== "").map((each) => ({ text: each }));

/** The names of pads; close by, under their squares, and with what is to be known of them. */
export function padWords(features: readonly Feature[]): Words[] {
  return features.filter(isPoint).flatMap((feature, i): Words[] => {
    const { kind, name = "", note = "", tone } = (feature.properties ?? {}) as Properties;
    const place = { ...at(feature), rank: RANK.pad };
    const named: Line = { text: name, strong: true };
    const noted: Line = { text: note, ...(tone !== undefined && tone !== "ok" && { tone }) };
    if (kind === "edge") return [{ ...place, id: `edge ${i}`, lines: [named, noted], fewer: [named], clear: 6, sides: ["below", "above"], from: SQUARE_ZOOM }];
    if (kind !== "pad") return [];
    const troubled = tone !== undefined && tone !== "ok";
    const notes = troubled ? PAD_NAMES_ZOOM : PAD_NOTES_ZOOM;
    return [
      { ...place, id: `pad ${i}`, lines: [named], clear: 13, sides: BELOW, from: PAD_NAMES_ZOOM, to: notes },
      { ...place, id: `pad ${i}`, lines: [named, noted], fewer: [named], clear: 13, sides: BELOW, from: notes, to: SQUARE_ZOOM },
    ];
  });
}

/** What stands at claims and measurements. */
export function evidenceWords(features: readonly Feature[]): Words[] {
  return features.filter(isPoint).flatMap((feature, i) => {
    const { kind, label = "", up_m = 0, chosen } = (feature.properties ?? {}) as Properties;
    if (label === "" || (kind !== "claim" && kind !== "measured")) return [];
    const sides = kind === "claim" ? ABOVE : BELOW;
    return [{ ...at(feature), up_m, id: `${kind} ${i}`, lines: lines(label), rank: chosen === true ? RANK.chosen : RANK.evidence + i, clear: 10, sides, from: CLOSE_ZOOM }];
  });
}

export function siteWords(features: readonly Feature[]): Words[] {
  return features.filter(isPoint).map((feature, i) => {
    const { name = "", note = "", grave } = (feature.properties ?? {}) as Properties;
    const second: Line[] = note === "" ? [] : [{ text: note }];
    const rank = RANK.site + (grave === true ? 0 : 1_000) + i;
    return { ...at(feature), id: `site ${i}`, lines: [{ text: name, strong: true }, ...second], rank, clear: 11, sides: BESIDE, to: SITE_ZOOM };
  });
}

export function measureWords(features: readonly Feature[]): Words[] {
  return features.filter(isPoint).flatMap((feature, i) => {
    const { kind, label = "" } = (feature.properties ?? {}) as Properties;
    if (kind !== "word") return [];
    return [{ ...at(feature), id: `measure ${i}`, lines: [{ text: label, strong: true }], rank: RANK.measure, clear: 8, sides: ABOVE }];
  });
}

/** The drones' names, those first that somebody should look at. */
export function* droneWords(view: View, fleet: Fleet, store: LiveStore, selected: string | undefined): Generator<Words> {
  if (view.zoom < SITE_ZOOM) return;
  const { tracks } = store;
  const told = view.zoom >= BLOCKS_ZOOM && fleet.counts.all <= BLOCKS_MOST;
  const words = (uav_id: string, slot: number, rank: number, strong: boolean): Words => ({
    id: uav_id,
    x: tracks.x[slot] ?? 0,
    y: tracks.y[slot] ?? 0,
    up_m: view.tilt === undefined ? 0 : upOf(store, slot),
    ...named(uav_id, strong, told ? block(store, slot) : []),
    rank: uav_id === selected ? RANK.selected : rank,
    clear: uav_id === selected ? 16 : HALF,
    sides: ABOVE,
  });
  let rank = RANK.judged;
  for (const { uav_id } of fleet.judged) {
    const slot = tracks.slot(uav_id);
    // Who is selected has one label, below.
    if (slot !== undefined && uav_id !== selected) yield words(uav_id, slot, rank++, true);
  }
  const chosen = selected === undefined ? undefined : tracks.slot(selected);
  if (selected !== undefined && chosen !== undefined) yield words(selected, chosen, RANK.selected, true);
  if (view.zoom < NAMES_ZOOM) return;
  let tried = 0;
  for (const slot of fleet.heard) {
    if (slot === chosen || !within(view, store, slot)) continue;
    if (++tried > MOST_HEARD) return;
    yield words(tracks.nameAt(slot), slot, RANK.heard + slot, false);
  }
}

/** A name as long as most are; of a longer one the beginning, which says whose it is, and the end, which says which. */
export function shortName(name: string): string {
  return name.length <= LONGEST ? name : `${name.slice(0, SHORT_HEAD)}…${name.slice(-SHORT_TAIL)}`;
}

/** Where there is no room for a name, its height at least has one. */
function named(uav_id: string, strong: boolean, below: Line[]): Pick<Words, "lines" | "fewer"> {
  return { lines: [{ text: shortName(uav_id), strong, ...(!strong && { tone: "ink2" as const }) }, ...below], ...(below.length > 0 && { fewer: below }) };
}

/** What stands under a drone's name, by the user's wish: height with climb, speed, operator. */
function block(store: LiveStore, slot: number): Line[] {
  const { tracks } = store;
  const wishes = mapWishes();
  const words: string[] = [];
  const climb_mm_s = tracks.climbAt(slot) ?? 0;
  const arrow = climb_mm_s > CLIMBING_MM_S ? " ↑" : climb_mm_s < -CLIMBING_MM_S ? " ↓" : "";
  if (wishes.height && tracks.heightAt(slot) !== undefined) words.push(`${length(Math.round(upOf(store, slot)) * 1000, true)}${arrow}`);
  const speed_mm_s = tracks.speedAt(slot);
  if (wishes.speed && speed_mm_s !== undefined) words.push(speed(speed_mm_s));
  const operator = tracks.operatorAt(slot);
  if (wishes.operator && operator !== undefined) words.push(operator);
  return words.length === 0 ? [] : [{ text: words.join(" · "), tone: "ink2" }];
}

function spotOfDrone(view: View, store: LiveStore, slot: number): ReturnType<typeof spotOf> {
  return spotOf(view, store.tracks.x[slot] ?? 0, store.tracks.y[slot] ?? 0, view.tilt === undefined ? 0 : upOf(store, slot));
}

function within(view: View, store: LiveStore, slot: number): boolean {
  const { left = -1, top = -1 } = spotOfDrone(view, store, slot) ?? {};
  return left >= 0 && top >= 0 && left <= view.width && top <= view.height;
}

/** What no word may stand on: a verdict's lines and rings, the lines of sight to it, and a pad's square. */
const DRAWN = ["difference", "buffer", "ellipse", "sight", "square"];

/** They, as points so near to each other that no word fits between them. */
function alongLines(view: View, { geometry, properties }: Feature): Spot[] {
  const { kind = "", up_m = 0, to_m = up_m, half_m = 0, faint } = (properties ?? {}) as Properties;
  if (!DRAWN.includes(kind) || faint === true || (kind === "sight" && view.tilt !== undefined)) return [];
  const way = geometry.type === "LineString" ? geometry.coordinates : geometry.type === "Polygon" ? (geometry.coordinates[0] ?? []) : [];
  // Aslant, a buffer is a cylinder.
  const heights = kind === "buffer" && view.tilt !== undefined ? [Math.max(0, up_m - half_m), up_m + half_m] : [up_m];
  return heights.flatMap((from_m) => along(way.flatMap(([lon = 0, lat = 0], i) => spotOf(view, mercatorX(lon), mercatorY(lat), i === 0 || to_m === up_m ? from_m : to_m) ?? [])));
}

function along(spots: readonly Spot[]): Spot[] {
  return spots.flatMap((to, i) => {
    const from = spots[i - 1];
    if (from === undefined) return [];
    const steps = Math.min(MOST_STEPS, Math.ceil(Math.hypot(to.left - from.left, to.top - from.top) / STEP_PX));
    return Array.from({ length: steps }, (_, step) => ({ left: from.left + ((to.left - from.left) * step) / steps, top: from.top + ((to.top - from.top) * step) / steps }));
  });
}

/** Takes the room of everything that words must not cover: the drones, and these points. */
export function takeMarks(occupied: Occupied, view: View, fleet: Fleet, store: LiveStore, points: readonly Feature[]): void {
  const take = (spot: ReturnType<typeof spotOf>, half: number): void => {
    if (spot !== undefined) occupied.take(spot.left - half, spot.top - half, 2 * half, 2 * half);
  };
  for (const feature of points) {
    if (!isPoint(feature)) {
      for (const spot of alongLines(view, feature)) take(spot, LINE_HALF);
      continue;
    }
    const { x, y } = at(feature);
    const { up_m = 0 } = (feature.properties ?? {}) as Properties;
    take(spotOf(view, x, y, up_m), HALF);
  }
  if (view.zoom < SITE_ZOOM) return;
  for (let slot = 0; slot < fleet.looks.length; slot++) {
    if (fleet.looks[slot] !== HIDDEN) take(spotOfDrone(view, store, slot), HALF - 2);
  }
}
