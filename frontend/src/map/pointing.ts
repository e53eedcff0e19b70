import { LngLatBounds, type Map as MapLibre, type Point } from "maplibre-gl";
import { HIDDEN, type Fleet } from "../shared/fleet";
import type { LiveStore } from "../shared/live/store";
import { upOf } from "./heights";
import { SITE_ZOOM } from "./scales";
import { slotAt, viewOf } from "./view";

/** How far from a symbol's middle it is still pressed, pixels. */
const DRONE_REACH = 11;
const SITE_REACH = 8;

/** The drone that is drawn at this place of the screen. */
export function droneAt(map: MapLibre, store: LiveStore, { looks, judged, heard }: Fleet, point: Point): string | undefined {
  if (map.getZoom() < SITE_ZOOM) return undefined;
  const { tracks } = store;
  const shown = Uint32Array.from([...heard, ...judged.flatMap(({ uav_id }) => tracks.slot(uav_id) ?? [])].filter((slot) => looks[slot] !== HIDDEN));
  const slot = slotAt(viewOf(map), { x: tracks.x, y: tracks.y, up_m: (each) => upOf(store, each) }, shown, point.x, point.y, DRONE_REACH);
  return slot === undefined ? undefined : tracks.nameAt(slot);
}

/** What the sites that are drawn as one here reach over, where the map is looked at from afar. */
export function siteAt(map: MapLibre, point: Point): LngLatBounds | undefined {
  if (map.getZoom() >= SITE_ZOOM) return undefined;
  const [found] = map.queryRenderedFeatures(
    [
      [point.x - SITE_REACH, point.y - SITE_REACH],
      [point.x + SITE_REACH, point.y + SITE_REACH],
    ],
    { layers: ["sites"] },
  );
  const { bounds } = (found?.properties ?? {}) as { bounds?: string };
  const [west = 0, south = 0, east = 0, north = 0] = (bounds ?? "").split(" ").map(Number);
  return bounds === undefined ? undefined : new LngLatBounds([west, south], [east, north]);
}
