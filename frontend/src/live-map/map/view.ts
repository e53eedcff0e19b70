import type { Map as MapLibre } from "maplibre-gl";
import { latitude, longitude, mercatorX, mercatorY } from "../../shared/geo/mercator";
import type { LonLat } from "../../shared/geo/frame";

/** What the camera sees, in numbers: the map is never turned or tilted, so that a place is a scale and a shift away. */
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
};

export const TILE = 512;

export function viewOf(map: MapLibre): View {
  const centre = map.getCenter();
  const at = map.project(centre);
  const zoom = map.getZoom();
  const { clientWidth, clientHeight } = map.getContainer();
  return {
    x: mercatorX(centre.lng),
    y: mercatorY(centre.lat),
    left: at.x,
    top: at.y,
    scale: TILE * 2 ** zoom,
    zoom,
    width: clientWidth,
    height: clientHeight,
  };
}

/** To the nearest copy of the world. */
function near(dx: number): number {
  return dx - Math.round(dx);
}

export function pixelX(view: View, x: number): number {
  return near(x - view.x) * view.scale + view.left;
}

export function pixelY(view: View, y: number): number {
  return (y - view.y) * view.scale + view.top;
}

export function placeAt(view: View, left: number, top: number): LonLat {
  return [longitude(view.x + (left - view.left) / view.scale), latitude(view.y + (top - view.top) / view.scale)];
}

/** The slot of the drone that is drawn nearest to a point of the screen, within a reach in pixels. */
export function slotAt(view: View, x: Float64Array, y: Float64Array, slots: Uint32Array, left: number, top: number, reach: number): number | undefined {
  let best: number | undefined;
  let nearest = reach * reach;
  for (const slot of slots) {
    const dx = pixelX(view, x[slot] ?? 0) - left;
    if (dx > reach || dx < -reach) continue;
    const dy = pixelY(view, y[slot] ?? 0) - top;
    const distance = dx * dx + dy * dy;
    // Of several in one place the last is on top.
    if (distance <= nearest) {
      nearest = distance;
      best = slot;
    }
  }
  return best;
}
