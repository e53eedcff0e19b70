import type { Feature, Point } from "geojson";
import { HIDDEN, type Fleet } from "../../shared/fleet";
import { mercatorX, mercatorY } from "../../shared/geo/mercator";
import type { TrackTable } from "../../shared/live/tracks";
import type { Line, Words } from "./labels";
import type { Occupied, Side } from "./placing";
import { CLOSE_ZOOM, SITE_ZOOM, SQUARE_ZOOM } from "./scales";
import { pixelX, pixelY, type View } from "./view";

/** From here on, drones of which only what is heard is known have their names. */
const NAMES_ZOOM = 11;
const PAD_NAMES_ZOOM = 10.5;
const PAD_NOTES_ZOOM = 15.5;
/** In a crowd, names would not be read; this many are tried. */
const MOST_HEARD = 400;
const HALF = 9;

/** Lower comes first. Negative stands in any case. */
const RANK = { measure: -3, selected: -2, evidence: 1, site: 1, pad: 100, judged: 10, heard: 10_000 } as const;

const ABOVE: readonly Side[] = ["above", "left", "right", "below"];
const BELOW: readonly Side[] = ["below", "above", "left", "right"];
const BESIDE: readonly Side[] = ["right", "left", "below", "above"];

type Properties = { kind?: string; label?: string; name?: string; note?: string; tone?: "ok" | "maybe" | "bad"; grave?: boolean };

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
    if (kind === "edge") return [{ ...place, id: `edge ${i}`, lines: [named, noted], clear: 6, sides: ["below"], from: SQUARE_ZOOM }];
    if (kind !== "pad") return [];
    const troubled = tone !== undefined && tone !== "ok";
    const notes = troubled ? PAD_NAMES_ZOOM : PAD_NOTES_ZOOM;
    return [
      { ...place, id: `pad ${i}`, lines: [named], clear: 13, sides: BELOW, from: PAD_NAMES_ZOOM, to: notes },
      { ...place, id: `pad ${i}`, lines: [named, noted], clear: 13, sides: BELOW, from: notes, to: SQUARE_ZOOM },
    ];
  });
}

/** What stands at claims and measurements. */
export function evidenceWords(features: readonly Feature[]): Words[] {
  return features.filter(isPoint).flatMap((feature, i) => {
    const { kind, label = "" } = (feature.properties ?? {}) as Properties;
    if (label === "" || (kind !== "claim" && kind !== "measured")) return [];
    const sides = kind === "claim" ? ABOVE : BELOW;
    return [{ ...at(feature), id: `${kind} ${i}`, lines: lines(label), rank: RANK.evidence + i, clear: 10, sides, from: CLOSE_ZOOM }];
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
export function* droneWords(view: View, fleet: Fleet, tracks: TrackTable, selected: string | undefined): Generator<Words> {
  if (view.zoom < SITE_ZOOM) return;
  const words = (uav_id: string, slot: number, rank: number, strong: boolean): Words => ({
    id: uav_id,
    x: tracks.x[slot] ?? 0,
    y: tracks.y[slot] ?? 0,
    lines: [{ text: uav_id, strong, ...(!strong && { tone: "ink2" as const }) }],
    rank: uav_id === selected ? RANK.selected : rank,
    clear: uav_id === selected ? 16 : HALF,
    sides: ABOVE,
  });
  let rank = RANK.judged;
  for (const { uav_id } of fleet.judged) {
    const slot = tracks.slot(uav_id);
    if (slot !== undefined) yield words(uav_id, slot, rank++, true);
  }
  const chosen = selected === undefined ? undefined : tracks.slot(selected);
  if (selected !== undefined && chosen !== undefined) yield words(selected, chosen, RANK.selected, true);
  if (view.zoom < NAMES_ZOOM) return;
  let tried = 0;
  for (const slot of fleet.heard) {
    if (slot === chosen || !within(view, tracks, slot)) continue;
    if (++tried > MOST_HEARD) return;
    yield words(tracks.nameAt(slot), slot, RANK.heard + slot, false);
  }
}

function within(view: View, tracks: TrackTable, slot: number): boolean {
  const left = pixelX(view, tracks.x[slot] ?? 0);
  const top = pixelY(view, tracks.y[slot] ?? 0);
  return left >= 0 && top >= 0 && left <= view.width && top <= view.height;
}

/** Takes the room of everything that words must not cover: the drones, and these points. */
export function takeMarks(occupied: Occupied, view: View, fleet: Fleet, tracks: TrackTable, points: readonly Feature[]): void {
  const take = (x: number, y: number, half: number): void => occupied.take(pixelX(view, x) - half, pixelY(view, y) - half, 2 * half, 2 * half);
  for (const feature of points) {
    if (!isPoint(feature)) continue;
    const { x, y } = at(feature);
    take(x, y, HALF);
  }
  if (view.zoom < SITE_ZOOM) return;
  for (let slot = 0; slot < fleet.looks.length; slot++) {
    if (fleet.looks[slot] !== HIDDEN) take(tracks.x[slot] ?? 0, tracks.y[slot] ?? 0, HALF - 2);
  }
}
