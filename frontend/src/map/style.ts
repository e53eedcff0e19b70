import type { LayerSpecification, StyleSpecification } from "maplibre-gl";
import { borders10, borders50, land10, land50, names } from "virtual:base-map";
import { baseLayers } from "./baseLayers";
import type { Palette } from "./icons";
import { PLACE_COLOURS } from "./placeLayers";
import { COAST_FADES, FINE_ZOOM, NAMES_END } from "./scales";
import { evidenceLayers, gridLayers, measureLayers, padLayers, pointLayers, siteLayers } from "./liveLayers";

/** The colours of tokens.css that the map needs. */
export const MAP_COLOURS = [
  "ok",
  "bad",
  "maybe",
  "none",
  "accent",
  "panel",
  "line",
  "land",
  "sea",
  "coast",
  "border",
  "grid",
  "ink",
  "ink2",
  "ink3",
  ...PLACE_COLOURS,
] as const;

type BaseFile = { id: string; url: string; from: number; to: number; replaces?: string };

/**
 * The base map's files, megabytes the finer ones: each fetched only once somebody looks from where it can be seen.
 * The coarse layers stand in for the finer ones until those are there.
 */
export const BASE_FILES: readonly BaseFile[] = [
  { id: "land-coarse", url: land50, from: 0, to: COAST_FADES[1] },
  { id: "borders-coarse", url: borders50, from: 0, to: COAST_FADES[1] },
  { id: "country-names", url: names, from: 0, to: NAMES_END },
  { id: "land-fine", url: land10, from: FINE_ZOOM - 0.5, to: COAST_FADES[1], replaces: "land-coarse" },
  { id: "borders-fine", url: borders10, from: FINE_ZOOM - 0.5, to: COAST_FADES[1], replaces: "borders-coarse" },
];

export const EMPTY: GeoJSON.FeatureCollection = { type: "FeatureCollection", features: [] };

/**
 * From the bottom to the top, a function for each: base map, metre grid, what others lay over it (overlays.ts), pads,
 * evidence, measure, marks, clusters; above all of them the drones (droneLayer.ts) and the words (labels.ts).
 */
function layers(colours: Palette, placed = false): LayerSpecification[] {
  return [
    ...baseLayers(colours, placed),
    ...gridLayers(colours),
    ...padLayers(colours),
    ...evidenceLayers(colours),
    ...measureLayers(colours),
    ...pointLayers(),
    ...siteLayers(),
  ];
}

/** The lowest layer of the pads: overlays go under it. */
export const OVERLAYS_BELOW = "reach";

/** The whole style: bundled base map, pad grid, evidence and tracks. */
export function style(colours: Palette): StyleSpecification {
  const base = (maxzoom: number): StyleSpecification["sources"][string] => ({
    type: "geojson",
    data: EMPTY,
    maxzoom,
    tolerance: 0.3,
  });
  // Tiles of zoom 20 are cut to a thousandth of a pixel there: millimetres.
  const own = (): StyleSpecification["sources"][string] => ({ type: "geojson", data: EMPTY, maxzoom: 20, tolerance: 0 });
  return {
    version: 8,
    sources: {
      "land-coarse": base(5),
      "land-fine": base(9),
      "borders-coarse": base(5),
      "borders-fine": base(9),
      "country-names": base(7),
      grid: own(),
      pads: own(),
      sites: own(),
      trails: own(),
      evidence: own(),
      measure: own(),
    },
    layers: layers(colours),
    transition: { duration: 0, delay: 0 },
  };
}

/** What each layer is painted with in these colours, to change the theme without loading the style again. */
export function paints(colours: Palette, placed: boolean): { id: string; paint: Record<string, unknown> }[] {
  return layers(colours, placed).map((layer) => ({ id: layer.id, paint: (layer.paint ?? {}) }));
}
