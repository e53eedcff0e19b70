import type { ExpressionSpecification, LayerSpecification } from "maplibre-gl";
import type { Locale } from "../shared/i18n/locale";
import type { Palette } from "./icons";
import type { NameLook } from "./labels";
import { MEDIUM } from "./scales";

/** The colours of tokens.css that the place needs: a few greys, water and a breath of green. */
export const PLACE_COLOURS = [
  "water",
  "shore",
  "park",
  "beach",
  "quay",
  "road",
  "road-edge",
  "path",
  "building",
  "building-edge",
  "roof",
  "roof-high",
  "place-ink",
  "water-ink",
  "sky",
] as const;

export const PLACE = "place";
/** Further away than this the archive says too little, and coasts and borders (baseLayers.ts) say it better. */
export const PLACE_ZOOM = 10.5;
const EDGES_PX = 1.6;
/** The shallows, from the outermost: metres to both sides of the coast, and how much of the shore's colour. */
const SHALLOWS = [
  [22, 0.35],
  [14, 0.6],
  [7, 0.9],
] as const;
const FADES = [0.2, 0.42, 0.62, 0.8, 0.92, 1] as const;

/** Metres on the ground as pixels, for a latitude: a street is as wide as it is, at any scale. */
function metres(width_m: number, lat: number, least = 0.5): ExpressionSpecification {
  const at = (zoom: number): number => (width_m * 512 * 2 ** zoom) / (40_075_016.686 * Math.cos((lat * Math.PI) / 180));
  return ["interpolate", ["exponential", 2], ["zoom"], 11, least, 13.5, Math.max(least, at(13.5)), 22, at(22)];
}

/** A street with its edge: that stays a thin line at any scale. */
function edged(width_m: number, lat: number): ExpressionSpecification {
  const [, , , ...stops] = metres(width_m, lat, 0.6) as unknown as [string, unknown, unknown, ...number[]];
  return ["interpolate", ["exponential", 2], ["zoom"], ...stops.map((each, i) => (i % 2 === 0 ? each : each + EDGES_PX))] as unknown as ExpressionSpecification;
}

/** Between two colours of the theme, which a share of 0 and 1 gives. */
function between(one: string, other: string, share: number): ExpressionSpecification {
  return ["interpolate", ["linear"], share, 0, one, 1, other];
}

function kinds(...names: string[]): ExpressionSpecification {
  return ["in", ["coalesce", ["get", "kind"], ""], ["literal", names]];
}

/** Streets from the narrowest to the widest: their kinds (ours and the Protomaps schema's), metres, and from which zoom. */
const STREETS: readonly { id: string; which: ExpressionSpecification; width_m: number; from: number }[] = [
  { id: "service", which: ["any", kinds("service"), ["==", ["get", "kind_detail"], "service"]], width_m: 3, from: 14 },
  { id: "pedestrian", which: ["any", kinds("pedestrian"), ["==", ["get", "kind_detail"], "pedestrian"]], width_m: 3, from: 14 },
  {
    id: "minor",
    which: ["all", kinds("minor_road"), ["!", ["in", ["coalesce", ["get", "kind_detail"], ""], ["literal", ["service", "pedestrian"]]]]],
    width_m: 5.5,
    from: 12.5,
  },
  { id: "medium", which: kinds("medium_road"), width_m: 7.5, from: 12 },
  { id: "major", which: kinds("major_road", "highway"), width_m: 9.5, from: 11 },
];

const GREEN = ["park", "garden", "grass", "wood", "forest", "scrub", "cemetery", "pitch", "playground", "golf_course", "meadow", "nature_reserve", "recreation_ground"];
const PAVED = ["pier", "pedestrian", "parking", "heliport", "helipad", "aerodrome", "runway", "taxiway", "quay", "platform"];

type Layer = LayerSpecification & { source: string };

function layer(id: string, type: "fill" | "line", from: string, filter: ExpressionSpecification | undefined, paint: Record<string, unknown>, more: Record<string, unknown> = {}): Layer {
  return { id: `place-${id}`, type, source: PLACE, "source-layer": from, ...(filter !== undefined && { filter }), paint, ...more };
}

/** The ground: sea, land, greens, quays, streets, the outlines of buildings; for maps whose middle is at `lat`. */
export function groundLayers(colours: Palette, lat: number): LayerSpecification[] {
  const c = (name: string): string => colours[name] ?? "";
  const round = { layout: { "line-cap": "round", "line-join": "round" } };
  const open: ExpressionSpecification = ["all", ["!", ["has", "is_tunnel"]]];
  const water = kinds("ocean", "lake", "river", "water", "other", "basin", "canal", "stream", "swimming_pool", "fountain");
  return [
    layer("water", "fill", "water", water, { "fill-color": c("water"), "fill-antialias": false }),
    // Bands on both sides of the coast, of which the land above covers its half. Opaque: blurred, their joins would show as stars.
    ...SHALLOWS.map(([reach_m, share], band) =>
      layer(`shore-${band}`, "line", "earth", kinds("coast"), { "line-color": between(c("water"), c("shore"), share), "line-width": metres(2 * reach_m, lat) }, round),
    ),
    layer("land", "fill", "earth", kinds("earth"), { "fill-color": c("land") }),
    layer("green", "fill", "landuse", kinds(...GREEN), { "fill-color": c("park") }, { minzoom: PLACE_ZOOM }),
    layer("beach", "fill", "landuse", kinds("beach", "sand"), { "fill-color": c("beach") }),
    layer("paved", "fill", "landuse", kinds(...PAVED), { "fill-color": c("quay"), "fill-outline-color": c("road-edge") }, { minzoom: 12 }),
    layer("pool", "fill", "landuse", kinds("swimming_pool"), { "fill-color": c("water") }, { minzoom: 14 }),
    layer("lake", "fill", "water", ["all", water, ["!=", ["get", "kind"], "ocean"]], { "fill-color": c("water") }),
    layer("helipad", "line", "landuse", kinds("helipad"), { "line-color": c("building-edge"), "line-width": metres(0.8, lat) }, { minzoom: 14.5 }),
    layer("rail", "line", "roads", kinds("rail"), { "line-color": c("path"), "line-width": metres(2.4, lat), "line-dasharray": [3, 2] }, { minzoom: 13 }),
    layer("tunnel", "line", "roads", ["all", kinds("major_road", "medium_road", "minor_road", "highway"), ["has", "is_tunnel"]], { "line-color": c("road-edge"), "line-width": metres(6, lat), "line-opacity": 0.6, "line-dasharray": [1.6, 1.2] }, { minzoom: 14 }),
    layer("path", "line", "roads", ["all", open, ["any", kinds("path", "steps"), ["==", ["get", "kind_detail"], "steps"]]], { "line-color": c("path"), "line-width": metres(1.6, lat, 0.4), "line-dasharray": [2, 1.6] }, { minzoom: 15 }),
    ...STREETS.map(({ id, which, width_m, from }) =>
      layer(`${id}-edge`, "line", "roads", ["all", which, open], { "line-color": c("road-edge"), "line-width": edged(width_m, lat) }, { ...round, minzoom: from }),
    ),
    ...STREETS.map(({ id, which, width_m, from }) =>
      layer(id, "line", "roads", ["all", which, open], { "line-color": ["interpolate", ["linear"], ["zoom"], 16.5, c("road"), 18.5, between(c("road"), c("quay"), 0.6)], "line-width": metres(width_m, lat, 0.6) }, { ...round, minzoom: from }),
    ),
    layer("building", "fill", "buildings", undefined, { "fill-color": c("building"), "fill-outline-color": c("building-edge"), "fill-opacity": ["interpolate", ["linear"], ["zoom"], 13, 0.4, 15, 1] }, { minzoom: 13 }),
    ...fading(colours),
  ];
}

/** Slopes of the ground, lit from the north-west and so lightly that a street on them is as white as elsewhere. */
export function reliefLayer(colours: Palette, source: string): LayerSpecification {
  const c = (name: string): string => colours[name] ?? "";
  const paint = { "hillshade-exaggeration": 0.3, "hillshade-shadow-color": c("place-ink"), "hillshade-accent-color": c("place-ink"), "hillshade-highlight-color": c("road"), "hillshade-illumination-direction": 320 };
  return { id: `${source}-relief`, type: "hillshade", source, paint };
}

/** Beyond the data the place goes over into plain land. */
function fading(colours: Palette): Layer[] {
  return FADES.map((opacity, step) =>
    layer(`fade-${step}`, "fill", "fade", ["==", ["get", "step"], step], { "fill-color": colours["land"] ?? "", "fill-opacity": opacity, "fill-antialias": false }),
  );
}

/** A point that buildings step back from, and metres around it; undefined: from nothing. */
export type Stage = { lon: number; lat: number; radius_m: number };

/** Buildings as volumes: those around the stage are glass, so that nobody hides behind them. */
export function volumeLayers(colours: Palette, stage: Stage | undefined, raised: boolean): LayerSpecification[] {
  const c = (name: string): string => colours[name] ?? "";
  const rising = (name: string): ExpressionSpecification => ["interpolate", ["linear"], ["zoom"], 13.6, 0, 14.4, ["coalesce", ["get", name], name === "height" ? 6 : 0]];
  const tall: ExpressionSpecification = [">", ["coalesce", ["get", "height"], 6], 0];
  const away: ExpressionSpecification | undefined = stage && ["distance", { type: "Point", coordinates: [stage.lon, stage.lat] }];
  const paint = {
    "fill-extrusion-color": ["interpolate", ["linear"], ["coalesce", ["get", "height"], 6], 4, c("roof"), 90, c("roof-high")],
    "fill-extrusion-height": rising("height"),
    "fill-extrusion-base": rising("min_height"),
    "fill-extrusion-vertical-gradient": true,
  };
  const of = (id: string, filter: ExpressionSpecification, more: Record<string, unknown>): LayerSpecification =>
    ({ id: `place-${id}`, type: "fill-extrusion", source: PLACE, "source-layer": id === "trees" ? "trees" : "buildings", minzoom: 13.6, filter, layout: { visibility: raised ? "visible" : "none" }, paint: { ...paint, ...more } }) as LayerSpecification;
  return [
    {
      ...of("trees", true as unknown as ExpressionSpecification, { "fill-extrusion-color": c("park"), "fill-extrusion-opacity": 0.85 }),
      minzoom: 15,
    },
    of("volumes", away === undefined ? tall : ["all", tall, [">", away, stage?.radius_m ?? 0]], { "fill-extrusion-opacity": 1 }),
    of("volumes-near", away === undefined ? ["boolean", false] : ["all", tall, ["<=", away, stage?.radius_m ?? 0]], { "fill-extrusion-opacity": 0.28 }),
  ];
}

/** The name in the reader's language, where there is one. */
function nameIn(locale: Locale): ExpressionSpecification {
  return ["coalesce", ["get", `name:${locale}`], ["get", "name"], ""];
}

/** Names of points, the most important first, and how they look: `placeNames.ts` draws those that MapLibre finds room for. */
export const NAME_LAYERS: readonly { id: string; look: NameLook }[] = [
  { id: "place-towns", look: "town" },
  { id: "place-harbours", look: "water" },
  { id: "place-quarters", look: "quarter" },
  { id: "place-landmarks", look: "landmark" },
];

/** The words of the place: quarters, harbours, streets. Smaller and paler than anything that flies. */
export function placeWordLayers(colours: Palette, locale: Locale): LayerSpecification[] {
  const ink = colours["place-ink"] ?? "";
  const words = (id: string, from: string, filter: ExpressionSpecification, layout: Record<string, unknown>, paint: Record<string, unknown>, zooms: Record<string, number>): LayerSpecification =>
    ({ id: `place-${id}`, type: "symbol", source: PLACE, "source-layer": from, filter, layout: { "text-font": MEDIUM, "text-field": nameIn(locale), ...layout }, paint, ...zooms });
  // Placed among one another and the streets' names, drawn elsewhere.
  const unseen = { "text-opacity": 0 };
  const streets = kinds("major_road", "medium_road", "minor_road", "highway", "pedestrian");
  return [
    words(
      "street-names",
      "roads",
      ["all", streets, ["!", ["has", "is_tunnel"]]],
      { "symbol-placement": "line", "text-size": ["interpolate", ["linear"], ["zoom"], 15, 9.5, 18, 12], "text-max-angle": 28, "text-padding": 12, "symbol-spacing": 420 },
      { "text-color": ink, "text-halo-color": colours["land"] ?? "", "text-halo-width": 1.4, "text-opacity": 0.85 },
      { minzoom: 15.4 },
    ),
    words("harbours", "pois", kinds("harbour", "marina"), { "text-size": 12, "text-letter-spacing": 0.08, "text-max-width": 8 }, unseen, { minzoom: 13 }),
    words(
      "landmarks",
      "pois",
      kinds("station", "hospital", "heliport", "museum", "casino", "theatre", "townhall", "stadium", "park", "beach"),
      { "text-size": 10.5, "text-max-width": 8, "text-padding": 10 },
      unseen,
      { minzoom: 15.2 },
    ),
    words("quarters", "places", kinds("neighbourhood", "macrohood"), { "text-size": 11, "text-letter-spacing": 0.14, "text-max-width": 8, "text-padding": 14 }, unseen, { minzoom: 12.5, maxzoom: 17 }),
    words("towns", "places", kinds("locality"), { "text-size": 13, "text-letter-spacing": 0.04 }, unseen, { minzoom: PLACE_ZOOM, maxzoom: 13 }),
  ];
}
