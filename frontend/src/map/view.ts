import type { Map as MapLibre } from "maplibre-gl";
import { latitude, longitude, mercatorX, mercatorY } from "../shared/geo/mercator";
import type { LonLat } from "../shared/geo/frame";

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

/** A place to have in the picture; `up_m` above the ground. */
export type Seen = { at: LonLat; up_m?: number };
/** The screen as a camera has it (degrees, pixels), and how much of it is free around the point that the camera looks at. */
export type Room = { width: number; height: number; fov: number; screenHeight: number };

const HALVINGS = 24;
const CENTRINGS = 8;
const LEAST_ZOOM = 3;

/** The camera that has all places in a room of the screen as large as they can be, looking aslant. Degrees; pixels. */
export function slantedCamera(places: readonly Seen[], { bearing, pitch }: { bearing: number; pitch: number }, room: Room, maxZoom: number): { center: LonLat; zoom: number } {
  let [least, most] = [LEAST_ZOOM, maxZoom];
  let best = centred(places, { bearing, pitch }, room, maxZoom);
  if (best !== undefined && fits(best, room)) return { center: best.center, zoom: maxZoom };
  for (let i = 0; i < HALVINGS; i++) {
    const zoom = (least + most) / 2;
    const found = centred(places, { bearing, pitch }, room, zoom);
    if (found !== undefined && fits(found, room)) [least, best] = [zoom, found];
    else most = zoom;
  }
  return { center: best?.center ?? places[0]?.at ?? [0, 0], zoom: least };
}

type Framed = { center: LonLat; wide: number; high: number };

function fits({ wide, high }: Framed, room: Room): boolean {
  return wide <= room.width && high <= room.height;
}

/** With what lies far away smaller than what is near, the middle of the picture is not the middle of the places. */
function centred(places: readonly Seen[], { bearing, pitch }: { bearing: number; pitch: number }, { fov, screenHeight }: Room, zoom: number): Framed | undefined {
  const all = places.map(({ at, up_m = 0 }) => ({ x: mercatorX(at[0]), y: mercatorY(at[1]), up_m }));
  const span = (values: readonly number[]): [middle: number, size: number] => {
    const [least, most] = [Math.min(...values), Math.max(...values)];
    return [(least + most) / 2, most - least];
  };
  let center: LonLat = [longitude(span(all.map(({ x }) => x))[0]), latitude(span(all.map(({ y }) => y))[0])];
  let framed: Framed | undefined;
  for (let i = 0; i < CENTRINGS; i++) {
    const scale = TILE * 2 ** zoom;
    const tilt = tiltOf(bearing, pitch, { fov, height: screenHeight, scale, lat: center[1] });
    const view: View = { x: mercatorX(center[0]), y: mercatorY(center[1]), left: 0, top: 0, scale, zoom, width: 0, height: screenHeight, ...(tilt !== undefined && { tilt }) };
    const spots = all.map(({ x, y, up_m }) => spotOf(view, x, y, up_m));
    if (spots.some((spot) => spot === undefined)) return undefined;
    const [across, wide] = span(spots.map((spot) => spot?.left ?? 0));
    const [down, high] = span(spots.map((spot) => spot?.top ?? 0));
    framed = { center, wide, high };
    if (Math.hypot(across, down) < 0.5) break;
    center = placeAt(view, across, down);
  }
  return framed;
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
