/** What belongs into the picture, and from where it is looked at. */
import type { Map as MapLibre } from "maplibre-gl";
import type { Pad } from "../shared/api/records";
import type { Drone } from "../shared/drones";
import { HIDDEN, type Fleet } from "../shared/fleet";
import { distance_mm, frameOf, lonLat, toGlobe } from "../shared/geo/frame";
import { mercatorX, mercatorY } from "../shared/geo/mercator";
import type { LiveStore } from "../shared/live/store";
import { broadcastApart } from "../shared/refuted";
import { upOf } from "./heights";
import type { Selection } from "./picture";
import { slantedCamera, spotOf, viewOf, type Room, type Seen } from "./view";

/** How a place is looked at aslant: far enough over to see heights, not so far that streets close. */
export const PITCH = 52;
export const BEARING = -38;
/** All pads are looked at from where they are seen largest; from the usual side, unless another is this much better (zoom levels). */
const BEARINGS = [-70, -15, 10, 35, 60] as const;
const BETTER = 0.2;
/** Drones this far from every pad are not fitted into the first view, nor are those of a crowd. */
const NEAR_PAD_MM = 1_500_000;
const FITTED_DRONES = 150;
/** A broadcast claim further away than this is not fitted into the picture: the rest would be lost in it. */
const FITTED_MM = 400_000;

export function dronesNear(pads: readonly Pad[], store: LiveStore, fleet: Fleet): Seen[] {
  const { tracks } = store;
  if (fleet.counts.all > FITTED_DRONES) return [];
  return [...fleet.heard, ...fleet.judged.flatMap(({ uav_id }) => tracks.slot(uav_id) ?? [])].flatMap((slot) => {
    const track = tracks.get(tracks.nameAt(slot));
    if (track === undefined || fleet.looks[slot] === HIDDEN || !pads.some((pad) => distance_mm(track, pad) < NEAR_PAD_MM)) return [];
    return [{ at: lonLat(track), up_m: upOf(store, slot) }];
  });
}

export function bestBearing(places: readonly Seen[], room: Room, maxZoom: number): number {
  const zoomAt = (bearing: number): number => slantedCamera(places, { bearing, pitch: PITCH }, room, maxZoom).zoom;
  let [best, most] = [BEARING, zoomAt(BEARING) + BETTER];
  for (const bearing of BEARINGS) {
    const zoom = zoomAt(bearing);
    if (zoom > most) [best, most] = [bearing, zoom];
  }
  return best;
}

/** From the claim to the measurement. */
export type Lie = { east: number; north: number };

/** This much of a lie's length is to be seen, as a share. */
const SEEN = 0.7;

/** From where a lie is not seen end-on: from where the camera is, or else from the side that shows most of it. */
export function sideOn({ east, north }: Lie, bearing: number): number {
  const length = Math.hypot(east, north);
  const seen = (degrees: number): number => Math.abs(east * Math.cos((degrees * Math.PI) / 180) - north * Math.sin((degrees * Math.PI) / 180)) / length;
  if (length < 1 || seen(bearing) >= SEEN) return bearing;
  return [BEARING, ...BEARINGS].reduce((best, each) => (seen(each) > seen(best) ? each : best));
}

/** Whether all of them are in a part of the screen that nothing covers. */
export function inSight(map: MapLibre, places: readonly Seen[]): boolean {
  const view = viewOf(map);
  const { left = 0, right = 0, top = 0, bottom = 0 } = map.getPadding();
  return places.every(({ at, up_m }) => {
    const spot = spotOf(view, mercatorX(at[0]), mercatorY(at[1]), up_m);
    return spot !== undefined && spot.left >= left && spot.left <= view.width - right && spot.top >= top && spot.top <= view.height - bottom;
  });
}

/** What is free of the screen, less a margin. */
export function freeRoom(map: MapLibre, margin: number): Room {
  const { clientWidth, clientHeight } = map.getCanvas();
  const { left = 0, right = 0, top = 0, bottom = 0 } = map.getPadding();
  return { width: clientWidth - left - right - 2 * margin, height: clientHeight - top - bottom - 2 * margin, fov: map.getVerticalFieldOfView(), screenHeight: clientHeight };
}

/** The pad, the claim and the measurement of what is selected; else where the drone is. */
export function placesOf(drone: Drone | undefined, selection: Selection, store: LiveStore): { places: Seen[]; padded: boolean; lie?: Lie } {
  const own = drone?.verdict?.session_id === drone?.session?.session_id ? drone?.verdict : undefined;
  const verdict = selection.verdict ?? own;
  const pad = store.pads.get(verdict?.pad_id ?? drone?.session?.pad_id ?? "");
  const places: Seen[] = [];
  let lie: Lie | undefined;
  if (pad !== undefined) {
    places.push({ at: lonLat(pad) });
    const frame = frameOf(pad);
    const local = [
      verdict?.signed?.claim,
      verdict?.estimate,
      verdict !== undefined && broadcastApart(verdict) !== undefined ? verdict.broadcast?.claim : undefined,
      verdict === undefined ? drone?.estimate : undefined,
    ];
    const claim = local[2] ?? local[0];
    const measured = verdict?.estimate ?? drone?.estimate;
    if (claim !== undefined && measured !== undefined) lie = { east: measured.east_mm - claim.east_mm, north: measured.north_mm - claim.north_mm };
    for (const place of local) {
      if (place !== undefined && Math.hypot(place.east_mm, place.north_mm) < FITTED_MM) places.push({ at: toGlobe(frame, place), up_m: Math.max(0, ("up_mm" in place ? place.up_mm : 0) / 1000) });
    }
  }
  if (places.length < 2 && drone?.track !== undefined) {
    if (pad === undefined || distance_mm(drone.track, pad) < FITTED_MM) places.push({ at: lonLat(drone.track) });
  }
  return { places, padded: pad !== undefined, ...(lie !== undefined && { lie }) };
}
