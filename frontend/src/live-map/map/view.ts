import type { Map as MapLibre } from "maplibre-gl";
import { latitude, longitude, mercatorX, mercatorY } from "../../shared/geo/mercator";
import type { LonLat } from "../../shared/geo/frame";

/** What the camera sees, in numbers. Looked at from straight above, with north up, a place is a scale and a shift away. */
export type View = {
  /** The centre, Web Mercator 0 to 1, and where on the screen it is, CSS pixels from the top left. */
  x: number;
  y: number;
  left: number;
  top: number;
  /** Pixels of the whole world's width. */
  scale: number;
  zoom: number;
  width: number;
  height: number;
  /** Undefined where the camera looks straight down with north up. */
  tilt?: Tilt;
};

/** How the camera is turned and tilted. */
export type Tilt = {
  /** Clockwise from north, and from straight down: cosine and sine. */
  turn: readonly [cos: number, sin: number];
  pitch: readonly [cos: number, sin: number];
  /** From the camera to the centre, pixels. */
  away: number;
  /** Pixels of a metre of height. */
  perMetre: number;
};

export type Spot = { left: number; top: number };

export const TILE = 512;
/** Nearer to the camera's eye than this share of its distance, nothing is drawn. */
const EYE = 0.05;
const EQUATOR_M = 40_075_016.686;

export function viewOf(map: MapLibre): View {
  const centre = map.getCenter();
  const at = map.project(centre);
  const zoom = map.getZoom();
  const { clientWidth, clientHeight } = map.getContainer();
  const scale = TILE * 2 ** zoom;
  const tilt = tiltOf(map.getBearing(), map.getPitch(), { fov: map.getVerticalFieldOfView(), height: clientHeight, scale, lat: centre.lat });
  return {
    x: mercatorX(centre.lng),
    y: mercatorY(centre.lat),
    left: at.x,
    top: at.y,
    scale,
    zoom,
    width: clientWidth,
    height: clientHeight,
    ...(tilt !== undefined && { tilt }),
  };
}

/** Degrees throughout; undefined for a camera that looks straight down with north up. */
export function tiltOf(bearing: number, pitch: number, { fov, height, scale, lat }: { fov: number; height: number; scale: number; lat: number }): Tilt | undefined {
  if (bearing === 0 && pitch === 0) return undefined;
  const radians = Math.PI / 180;
  return {
    turn: [Math.cos(bearing * radians), Math.sin(bearing * radians)],
    pitch: [Math.cos(pitch * radians), Math.sin(pitch * radians)],
    away: (0.5 * height) / Math.tan((fov * radians) / 2),
    perMetre: scale / (EQUATOR_M * Math.cos(lat * radians)),
  };
}

/** To the nearest copy of the world. */
function near(dx: number): number {
  return dx - Math.round(dx);
}

/** Where on the screen a place is (Web Mercator, and metres above the ground); undefined behind the camera. */
export function spotOf(view: View, x: number, y: number, up_m = 0): Spot | undefined {
  const east = near(x - view.x) * view.scale;
  const south = (y - view.y) * view.scale;
  const { tilt } = view;
  if (tilt === undefined) return { left: east + view.left, top: south + view.top };
  const [cosTurn, sinTurn] = tilt.turn;
  const [cosPitch, sinPitch] = tilt.pitch;
  const across = east * cosTurn + south * sinTurn;
  const down = south * cosTurn - east * sinTurn;
  const up = up_m * tilt.perMetre;
  const depth = tilt.away - (down * sinPitch + up * cosPitch);
  if (depth < EYE * tilt.away) return undefined;
  const size = tilt.away / depth;
  return { left: view.left + across * size, top: view.top + (down * cosPitch - up * sinPitch) * size };
}

/** The place on the ground under a point of the screen; of the sky, the place far away in that direction. */
export function placeAt(view: View, left: number, top: number): LonLat {
  const { tilt } = view;
  let [east, south] = [left - view.left, top - view.top];
  if (tilt !== undefined) {
    const [cosTurn, sinTurn] = tilt.turn;
    const [cosPitch, sinPitch] = tilt.pitch;
    const slope = Math.max(0.05, cosPitch + ((top - view.top) / tilt.away) * sinPitch);
    const down = (top - view.top) / slope;
    const across = ((left - view.left) * (tilt.away - down * sinPitch)) / tilt.away;
    [east, south] = [across * cosTurn - down * sinTurn, across * sinTurn + down * cosTurn];
  }
  return [longitude(view.x + east / view.scale), latitude(view.y + south / view.scale)];
}

/** What stands in front and behind takes room: a slanted view keeps this much further away, zoom levels. */
const SLANTED_BACK = 0.12;

/** The camera that has all places in a room of the screen, looking aslant. Degrees; pixels. */
export function slantedCamera(
  places: readonly LonLat[],
  { bearing, pitch }: { bearing: number; pitch: number },
  room: { width: number; height: number },
  maxZoom: number,
): { center: LonLat; zoom: number } {
  const radians = Math.PI / 180;
  const [cos, sin] = [Math.cos(bearing * radians), Math.sin(bearing * radians)];
  const turned = places.map(([lon, lat]) => {
    const [east, south] = [mercatorX(lon), mercatorY(lat)];
    return { across: east * cos + south * sin, down: south * cos - east * sin };
  });
  const span = (values: readonly number[]): [middle: number, size: number] => {
    const [least, most] = [Math.min(...values), Math.max(...values)];
    return [(least + most) / 2, most - least];
  };
  const [across, wide] = span(turned.map((each) => each.across));
  const [down, deep] = span(turned.map((each) => each.down));
  const scale = Math.min(room.width / wide, room.height / (deep * Math.cos(pitch * radians)));
  const zoom = Math.min(maxZoom, Math.log2(scale / TILE) - SLANTED_BACK);
  return { center: [longitude(across * cos - down * sin), latitude(across * sin + down * cos)], zoom };
}

/** Columns of who is where: Web Mercator, and (where the view is tilted) metres above the ground. */
export type Columns = { x: Float64Array; y: Float64Array; up_m: (slot: number) => number };

/** The slot of the drone that is drawn nearest to a point of the screen, within a reach in pixels. */
export function slotAt(view: View, columns: Columns, slots: Uint32Array, left: number, top: number, reach: number): number | undefined {
  let best: number | undefined;
  let nearest = reach * reach;
  for (const slot of slots) {
    const spot = spotOf(view, columns.x[slot] ?? 0, columns.y[slot] ?? 0, view.tilt === undefined ? 0 : columns.up_m(slot));
    if (spot === undefined) continue;
    const dx = spot.left - left;
    if (dx > reach || dx < -reach) continue;
    const dy = spot.top - top;
    const distance = dx * dx + dy * dy;
    // Of several in one place the last is on top.
    if (distance <= nearest) {
      nearest = distance;
      best = slot;
    }
  }
  return best;
}
