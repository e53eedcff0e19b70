/** Zones as a layer of the live map: by type in colour and line, prohibited ones hatched, fainter while not in force. */
import type { FilterSpecification, LayerSpecification } from "maplibre-gl";
import type { Palette } from "../map/icons";
import type { Overlay } from "../map/overlays";
import type { LonLat } from "../shared/geo/frame";
import type { Zone, ZoneFeature, ZoneType } from "./calls";
import { hatching, holds, polygons } from "./geometry";
import { LOOKS, TYPES } from "./looks";

const ID = "zones";
const HATCH_LINES = 14;
/** A zone without a ceiling goes on up: it is drawn as high as drones may fly anyway, and a third more. */
const OPEN_TOP_M = 160;
/** Higher, a volume would stand between the camera and everything. */
const HIGHEST_M = 300;
const VOLUME = 0.16;

function layersOf(type: ZoneType, colours: Palette): LayerSpecification[] {
  const { colour, dash, width } = LOOKS[type];
  const paint = colours[colour] ?? "#888";
  const of = (kind: string): FilterSpecification => ["all", ["==", ["get", "type"], type], ["==", ["get", "part"], kind]];
  const lively = (active: number, not: number): ["case", ...unknown[]] => ["case", ["get", "active"], active, not];
  return [
    { id: `${ID}-${type}-fill`, type: "fill", source: ID, filter: of("area"), paint: { "fill-color": paint, "fill-opacity": lively(LOOKS[type].hatched ? 0.1 : 0.05, 0.02) as never } },
    {
      id: `${ID}-${type}-line`,
      type: "line",
      source: ID,
      filter: of("area"),
      paint: {
        "line-color": paint,
        "line-width": lively(width, 1) as never,
        "line-opacity": lively(0.95, 0.55) as never,
        ...(dash.length > 1 && { "line-dasharray": [...dash] }),
      },
    },
    ...(LOOKS[type].hatched
      ? [{ id: `${ID}-${type}-hatch`, type: "line" as const, source: ID, filter: of("hatch"), paint: { "line-color": paint, "line-width": 0.8, "line-opacity": 0.5 } }]
      : []),
    {
      id: `${ID}-${type}-volume`,
      type: "fill-extrusion",
      source: ID,
      filter: of("volume"),
      paint: { "fill-extrusion-color": paint, "fill-extrusion-opacity": VOLUME, "fill-extrusion-base": ["get", "floor_m"], "fill-extrusion-height": ["get", "ceiling_m"], "fill-extrusion-vertical-gradient": false },
    },
  ];
}

/**
 * From where to where each part of a zone reaches, above the map's ground. Heights above sea level count as above the
 * ground: the map has no terrain, and its pads stand by the water or are drawn as if they did.
 */
export function volumes({ layers }: Pick<Zone, "layers">): { floor_m: number; ceiling_m: number }[] {
  return layers.flatMap(({ lower, upper }) => {
    const floor_m = Math.max(0, lower?.metres ?? 0);
    const ceiling_m = Math.min(HIGHEST_M, upper?.metres ?? Math.max(OPEN_TOP_M, floor_m + OPEN_TOP_M));
    return ceiling_m > floor_m ? [{ floor_m, ceiling_m }] : [];
  });
}

function shapes({ geometry, properties }: ZoneFeature): GeoJSON.Feature[] {
  const { type, active } = properties;
  const areas = polygons(geometry);
  const area: GeoJSON.MultiPolygon = { type: "MultiPolygon", coordinates: areas as GeoJSON.Position[][][] };
  const found: GeoJSON.Feature[] = [{ type: "Feature", properties: { type, active, part: "area" }, geometry: area }];
  if (LOOKS[type].hatched && active) {
    const lines = areas.flatMap((rings) => hatching(rings, HATCH_LINES)) as unknown as GeoJSON.Position[][];
    found.push({ type: "Feature", properties: { type, part: "hatch" }, geometry: { type: "MultiLineString", coordinates: lines } });
  }
  // What holds at other times is drawn on the ground, and leaves the air to what holds now.
  if (active) for (const each of volumes(properties)) found.push({ type: "Feature", properties: { type, part: "volume", ...each }, geometry: area });
  return found;
}

/** The least restrictive lie below. */
export function zoneOverlay(zones: readonly ZoneFeature[]): Overlay {
  return { id: ID, layers: (colours) => [...TYPES].reverse().flatMap((type) => layersOf(type, colours)), features: zones.flatMap(shapes) };
}

/** The zones that hold a place on the map, the most restrictive first. */
export function zonesAt(zones: readonly ZoneFeature[], place: LonLat): ZoneFeature[] {
  const found = zones.filter(({ geometry, bbox, properties }) => {
    const [west, south, east, north] = bbox ?? properties.bbox;
    const inBox = west === undefined || south === undefined || east === undefined || north === undefined || (place[0] >= west && place[0] <= east && place[1] >= south && place[1] <= north);
    return inBox && polygons(geometry).some((rings) => holds(rings, place));
  });
  return found.sort((a, b) => TYPES.indexOf(a.properties.type) - TYPES.indexOf(b.properties.type));
}
