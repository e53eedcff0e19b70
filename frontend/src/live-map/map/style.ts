import type { ExpressionSpecification, LayerSpecification, StyleSpecification } from "maplibre-gl";
import { borders10, borders50, land10, land50, names } from "virtual:base-map";
import { baseLayers } from "./baseLayers";
import type { Palette } from "./icons";
import { COAST_FADES, FINE_ZOOM, NAMES_END } from "./scales";
import { evidenceLayers, padLayers, pointLayers, siteLayers } from "./liveLayers";

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

const EMPTY: GeoJSON.FeatureCollection = { type: "FeatureCollection", features: [] };

function layers(colours: Palette): LayerSpecification[] {
  return [...baseLayers(colours), ...padLayers(colours), ...evidenceLayers(colours), ...pointLayers(colours), ...siteLayers(colours)];
}

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
      tracks: { type: "geojson", data: EMPTY, maxzoom: 20, promoteId: "id" },
    },
    layers: layers(colours),
    transition: { duration: 0, delay: 0 },
  };
}

/** What each layer is painted with in these colours, to change the theme without loading the style again. */
export function paints(colours: Palette): { id: string; paint: Record<string, unknown> }[] {
  return layers(colours).map((layer) => ({ id: layer.id, paint: (layer.paint ?? {}) }));
}

/** The pads' label names a colour within its text. */
export function padLabel(colours: Palette): ExpressionSpecification {
  const layer = pointLayers(colours).find(({ id }) => id === "pad-names");
  const layout = (layer?.type === "symbol" ? layer.layout : undefined) ?? {};
  return layout["text-field"] as ExpressionSpecification;
}
