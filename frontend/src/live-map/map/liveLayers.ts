import type { ExpressionSpecification, LayerSpecification } from "maplibre-gl";
import type { Palette } from "./icons";
import { CLOSE_ZOOM, MEDIUM, SEMIBOLD, SITE_ZOOM, SQUARE_ZOOM } from "./scales";

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

export function padLayers(colours: Palette): LayerSpecification[] {
  const ink3 = colours["ink3"] ?? "";
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
      paint: { "line-color": ink3, "line-opacity": 0.35, "line-width": 0.8 },
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
        "line-opacity": ["case", ["get", "strong"], 0.6, 0.3],
        "line-dasharray": [0.1, 2.6],
      },
    },
    {
      id: "ellipse",
      type: "fill",
      source: "evidence",
      filter: ["==", ["get", "kind"], "ellipse"],
      minzoom: 14,
      paint: { "fill-color": colour, "fill-opacity": 0.16 },
    },
    {
      id: "ellipse-edge",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "ellipse"],
      minzoom: 14,
      paint: { "line-color": colour, "line-width": 1.3 },
    },
    {
      id: "buffer",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "buffer"],
      minzoom: CLOSE_ZOOM,
      paint: { "line-color": colour, "line-width": 1.4, "line-dasharray": [4, 3] },
    },
    {
      id: "difference",
      type: "line",
      source: "evidence",
      filter: ["==", ["get", "kind"], "difference"],
      minzoom: 9,
      layout: { "line-cap": "round" },
      paint: { "line-color": colour, "line-width": 1.8 },
    },
  ];
}

export function siteLayers(colours: Palette): LayerSpecification[] {
  return [
    {
      id: "sites",
      type: "symbol",
      source: "sites",
      maxzoom: SITE_ZOOM,
      layout: {
        "icon-image": ["get", "icon"],
        "icon-size": 1.15,
        "icon-allow-overlap": true,
        "text-field": ["format", ["get", "name"], {}, "\n", {}, ["get", "note"], { "font-scale": 0.92, "text-font": ["literal", MEDIUM] }],
        "text-font": SEMIBOLD,
        "text-size": 12,
        "text-line-height": 1.25,
        "text-max-width": 24,
        "text-justify": "auto",
        "text-optional": true,
        "text-variable-anchor-offset": ["left", [1.3, 0], "right", [-1.3, 0], "top", [0, 1.3], "bottom", [0, -1.3]],
      },
      paint: { "text-color": colours["ink"] ?? "", "text-halo-color": colours["land"] ?? "", "text-halo-width": 1.8 },
    },
  ];
}

export function pointLayers(colours: Palette): LayerSpecification[] {
  const land = colours["land"] ?? "";
  const label = {
    "text-font": SEMIBOLD,
    "text-size": 12,
    "text-optional": true,
    "text-padding": 3,
  } as const;
  const halo = { "text-halo-color": land, "text-halo-width": 1.8, "text-halo-blur": 0.4 } as const;
  return [
    {
      id: "pads",
      type: "symbol",
      source: "pads",
      filter: ["==", ["get", "kind"], "pad"],
      minzoom: SITE_ZOOM,
      maxzoom: SQUARE_ZOOM,
      layout: {
        "icon-image": "pad",
        "icon-size": ["interpolate", ["linear"], ["zoom"], SITE_ZOOM, 0.75, 15, 1],
        "icon-allow-overlap": true,
      },
    },
    {
      // The pad's own square takes over close by; its name stands under it.
      id: "pad-edges",
      type: "symbol",
      source: "pads",
      filter: ["==", ["get", "kind"], "edge"],
      minzoom: SQUARE_ZOOM,
      layout: {
        ...label,
        "text-field": ["get", "name"],
        "text-anchor": "top",
        "text-offset": [0, 0.6],
      },
      paint: { ...halo, "text-color": colours["ink"] ?? "" },
    },
    {
      id: "selected",
      type: "circle",
      source: "tracks",
      minzoom: SITE_ZOOM,
      filter: ["get", "selected"],
      paint: {
        "circle-radius": 15,
        "circle-color": colours["accent"] ?? "",
        "circle-opacity": 0.12,
        "circle-stroke-color": colours["accent"] ?? "",
        "circle-stroke-width": 1.5,
      },
    },
    {
      id: "claims",
      type: "symbol",
      source: "evidence",
      filter: ["==", ["get", "kind"], "claim"],
      minzoom: CLOSE_ZOOM,
      layout: {
        ...label,
        "icon-image": ["concat", "claim-", ["get", "tone"]],
        "icon-size": 0.8,
        "icon-allow-overlap": true,
        "text-field": ["get", "label"],
        "text-font": MEDIUM,
        "text-size": 11.5,
        "text-variable-anchor-offset": ["right", [-1.3, 0], "left", [1.3, 0], "bottom", [0, -1.2], "top", [0, 1.2]],
      },
      paint: { ...halo, "text-color": colours["ink2"] ?? "" },
    },
    {
      id: "measured",
      type: "symbol",
      source: "evidence",
      filter: ["==", ["get", "kind"], "measured"],
      minzoom: 14,
      layout: {
        ...label,
        "icon-image": ["get", "icon"],
        "icon-size": 0.95,
        "icon-allow-overlap": true,
        "text-field": ["step", ["zoom"], "", CLOSE_ZOOM, ["get", "label"]],
        "text-font": MEDIUM,
        "text-size": 11.5,
        "text-variable-anchor-offset": ["top", [0, 1.3], "left", [1.3, 0], "right", [-1.3, 0], "bottom", [0, -1.3]],
      },
      paint: { ...halo, "text-color": colours["ink2"] ?? "" },
    },
    {
      id: "track-labels",
      type: "symbol",
      source: "tracks",
      minzoom: 11,
      layout: {
        ...label,
        "text-field": ["get", "label"],
        "text-variable-anchor-offset": [
          "bottom",
          [0, -1.1],
          "left",
          [1.2, 0],
          "right",
          [-1.2, 0],
          "top",
          [0, 1.1],
          "bottom-left",
          [0.9, -0.9],
          "top-left",
          [0.9, 0.9],
        ],
        "symbol-sort-key": ["get", "rank"],
      },
      paint: {
        ...halo,
        "text-color": ["case", ["get", "strong"], colours["ink"] ?? "", colours["ink2"] ?? ""],
      },
    },
    {
      // MapLibre places the topmost layer first: the drones' symbols, around them the pads' names, then the drones'.
      id: "pad-names",
      type: "symbol",
      source: "pads",
      filter: ["==", ["get", "kind"], "pad"],
      minzoom: 10.5,
      maxzoom: SQUARE_ZOOM,
      layout: {
        ...label,
        "text-field": [
          "step",
          ["zoom"],
          ["get", "name"],
          15.5,
          ["format", ["get", "name"], {}, "\n", {}, ["get", "note"], { "font-scale": 0.9, "text-font": ["literal", MEDIUM], "text-color": colours["ink2"] ?? "" }],
        ],
        "text-variable-anchor-offset": ["top", [0, 1.2], "bottom", [0, -1.2], "left", [1.3, 0], "right", [-1.3, 0]],
        "text-line-height": 1.25,
      },
      paint: { ...halo, "text-color": colours["ink"] ?? "" },
    },
    {
      id: "tracks",
      type: "symbol",
      source: "tracks",
      minzoom: SITE_ZOOM,
      layout: {
        "icon-image": ["step", ["zoom"], ["get", "icon"], CLOSE_ZOOM, ["get", "closeIcon"]],
        "icon-size": ["interpolate", ["linear"], ["zoom"], SITE_ZOOM, 0.8, 12, 1],
        "icon-allow-overlap": true,
        "symbol-sort-key": ["-", ["get", "rank"]],
      },
    },
  ];
}
