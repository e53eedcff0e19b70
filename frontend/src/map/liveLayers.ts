import type { ExpressionSpecification, LayerSpecification } from "maplibre-gl";
import type { Palette } from "./icons";
import { CLOSE_ZOOM, SITE_ZOOM, SQUARE_ZOOM } from "./scales";

function toned(colours: Palette): ExpressionSpecification {
  return [
    "match",
    ["get", "tone"],
    "ok",
    colours["ok"] ?? "",
    "bad",
    colours["bad"] ?? "",
    "maybe",
    colours["maybe"] ?? "",
    "accent",
    colours["accent"] ?? "",
    colours["none"] ?? "",
  ];
}

/** The evidence of others is as faint as this where one is selected. */
export const FAINT = 0.25;

/** So opaque, or faint. */
function opaque(share: number): ExpressionSpecification {
  return ["*", share, ["case", ["==", ["get", "faint"], true], FAINT, 1]];
}

/** The metre grid of the nearest pad. */
export function gridLayers(colours: Palette): LayerSpecification[] {
  return [
    {
      id: "grid",
      type: "line",
      source: "grid",
      paint: {
        "line-color": colours["grid"] ?? "",
        "line-width": ["case", ["get", "axis"], 1.6, 0.8],
      },
    },
  ];
}

/** Pads close by: reach, square, anchors. */
export function padLayers(colours: Palette): LayerSpecification[] {
  const ink3 = colours["ink3"] ?? "";
  return [
    {
      id: "reach",
      type: "line",
      source: "pads",
      filter: ["==", ["get", "kind"], "reach"],
      minzoom: 14,
      paint: { "line-color": ink3, "line-opacity": 0.5, "line-width": 1, "line-dasharray": [2, 4] },
    },
    {
      id: "square",
      type: "fill",
      source: "pads",
      filter: ["==", ["get", "kind"], "square"],
      minzoom: CLOSE_ZOOM,
      paint: { "fill-color": colours["panel"] ?? "", "fill-opacity": 0.75 },
    },
    {
      id: "square-edge",
      type: "line",
      source: "pads",
      filter: ["==", ["get", "kind"], "square"],
      minzoom: CLOSE_ZOOM,
      paint: { "line-color": colours["ink2"] ?? "", "line-width": 1.4 },
    },
    {
      id: "sight",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "sight"],
      minzoom: CLOSE_ZOOM,
      paint: { "line-color": ink3, "line-opacity": opaque(0.35), "line-width": 0.8 },
    },
    {
      id: "anchors",
      type: "circle",
      source: "pads",
      filter: ["==", ["get", "kind"], "anchor"],
      minzoom: 18,
      paint: {
        "circle-radius": ["interpolate", ["linear"], ["zoom"], 18, 2, 21, 4],
        "circle-color": ["case", ["get", "up"], colours["ink"] ?? "", colours["bad"] ?? ""],
        "circle-stroke-color": colours["land"] ?? "",
        "circle-stroke-width": 1,
      },
    },
  ];
}

/** What was claimed, what was measured, and what lies between. */
export function evidenceLayers(colours: Palette): LayerSpecification[] {
  const colour = toned(colours);
  return [
    {
      id: "trails",
      type: "line",
      source: "trails",
      minzoom: 9,
      layout: { "line-cap": "round" },
      paint: {
        "line-color": colour,
        "line-width": 1.6,
        "line-opacity": ["*", ["case", ["get", "strong"], 0.85, 0.5], ["-", 1, ["*", 0.22, ["get", "age"]]]],
        "line-dasharray": [0.1, 2.6],
      },
    },
    {
      id: "accuracy",
      type: "fill",
      source: "evidence",
      filter: ["==", ["get", "kind"], "accuracy"],
      minzoom: 13,
      paint: { "fill-color": colour, "fill-opacity": 0.07 },
    },
    {
      id: "accuracy-edge",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "accuracy"],
      minzoom: 13,
      paint: { "line-color": colour, "line-opacity": 0.7, "line-width": 1, "line-dasharray": [1, 3] },
    },
    {
      id: "ellipse",
      type: "fill",
      source: "evidence",
      filter: ["==", ["get", "kind"], "ellipse"],
      minzoom: 14,
      paint: { "fill-color": colour, "fill-opacity": opaque(0.16) },
    },
    {
      id: "ellipse-edge",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "ellipse"],
      minzoom: 14,
      paint: { "line-color": colour, "line-opacity": opaque(1), "line-width": 1.3 },
    },
    {
      id: "buffer",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "buffer"],
      minzoom: CLOSE_ZOOM,
      paint: { "line-color": colour, "line-opacity": opaque(1), "line-width": 1.4, "line-dasharray": [4, 3] },
    },
    {
      id: "difference",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "difference"],
      minzoom: 9,
      layout: { "line-cap": "round" },
      paint: { "line-color": colour, "line-opacity": opaque(1), "line-width": 1.8 },
    },
  ];
}

/** The measure: legs and their ends. */
export function measureLayers(colours: Palette): LayerSpecification[] {
  return [
    {
      id: "measure-legs",
      type: "line",
      source: "measure",
      filter: ["==", ["get", "kind"], "leg"],
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": colours["accent"] ?? "", "line-width": 2 },
    },
    {
      id: "measure-ends",
      type: "circle",
      source: "measure",
      filter: ["==", ["get", "kind"], "end"],
      paint: { "circle-radius": 4, "circle-color": colours["panel"] ?? "", "circle-stroke-color": colours["accent"] ?? "", "circle-stroke-width": 2 },
    },
  ];
}

/** Clusters, seen from afar. */
export function siteLayers(): LayerSpecification[] {
  return [
    {
      id: "sites",
      type: "symbol",
      source: "sites",
      maxzoom: SITE_ZOOM,
      layout: { "icon-image": ["get", "icon"], "icon-size": 1.15, "icon-allow-overlap": true },
    },
  ];
}

/** Marks of single places. Words beside them are the labels' business (labels.ts), drones the drone layer's. */
export function pointLayers(): LayerSpecification[] {
  return [
    {
      id: "pads",
      type: "symbol",
      source: "pads",
      filter: ["==", ["get", "kind"], "pad"],
      minzoom: SITE_ZOOM,
      maxzoom: SQUARE_ZOOM,
      layout: {
        "icon-image": ["get", "icon"],
        "icon-size": ["interpolate", ["linear"], ["zoom"], SITE_ZOOM, 0.75, 15, 1],
        "icon-allow-overlap": true,
      },
    },
    {
      id: "claims",
      type: "symbol",
      source: "evidence",
      filter: ["==", ["get", "kind"], "claim"],
      minzoom: CLOSE_ZOOM,
      layout: { "icon-image": ["concat", "claim-", ["get", "tone"]], "icon-size": 0.8, "icon-allow-overlap": true },
      paint: { "icon-opacity": opaque(1) },
    },
    {
      id: "measured",
      type: "symbol",
      source: "evidence",
      filter: ["==", ["get", "kind"], "measured"],
      minzoom: 14,
      layout: { "icon-image": ["get", "icon"], "icon-size": 0.95, "icon-allow-overlap": true },
      paint: { "icon-opacity": opaque(1) },
    },
  ];
}
