import type { ExpressionSpecification, LayerSpecification } from "maplibre-gl";
import type { Palette } from "./icons";
import { PLACE_ZOOM } from "./placeLayers";
import { COAST_FADES, FINE_ZOOM, MEDIUM, NAMES_END, PLACE_FADES } from "./scales";

/**
 * The bundled base map: two greys, water, and the countries' names. `placed`: an archive is drawn over a part of it, and
 * around that part the sea is the archive's, until so close by that nothing else is in sight.
 */
export function baseLayers(colours: Palette, placed = false): LayerSpecification[] {
  const sea = colours["sea"] ?? "";
  const land = colours["land"] ?? "";
  const [from, to] = COAST_FADES;
  const end = placed ? to + PLACE_FADES : to;
  const seas = placed ? [from, sea, PLACE_ZOOM, colours["water"] ?? "", to, colours["water"] ?? "", end, land] : [from, sea, to, land];
  const fading: ExpressionSpecification = ["interpolate", ["linear"], ["zoom"], from, 1, to, 0];
  return [
    {
      id: "sea",
      type: "background",
      paint: { "background-color": ["interpolate", ["linear"], ["zoom"], ...seas] as ExpressionSpecification },
    },
    { id: "land-coarse", type: "fill", source: "land-coarse", maxzoom: to, paint: { "fill-color": land, "fill-antialias": false } },
    { id: "land-fine", type: "fill", source: "land-fine", minzoom: FINE_ZOOM, maxzoom: end, paint: { "fill-color": land } },
    {
      id: "coast",
      type: "line",
      source: "land-fine",
      minzoom: FINE_ZOOM,
      maxzoom: to,
      paint: { "line-color": colours["coast"] ?? "", "line-width": 1, "line-opacity": fading },
    },
    {
      id: "borders-coarse",
      type: "line",
      source: "borders-coarse",
      maxzoom: to,
      paint: { "line-color": colours["border"] ?? "", "line-width": 0.8, "line-opacity": fading },
    },
    {
      id: "borders-fine",
      type: "line",
      source: "borders-fine",
      minzoom: FINE_ZOOM,
      maxzoom: to,
      paint: { "line-color": colours["border"] ?? "", "line-width": 1.2, "line-opacity": fading },
    },
    {
      id: "country-names",
      type: "symbol",
      source: "country-names",
      maxzoom: NAMES_END,
      // Seen from far away, the smallest would stand in the way of the others.
      filter: [">=", ["get", "area"], ["step", ["zoom"], 4, 3.4, 1, 5, 0]],
      layout: {
        "text-field": ["get", "name"],
        "text-font": MEDIUM,
        "text-size": 11.5,
        "text-letter-spacing": 0.06,
        "symbol-sort-key": ["-", ["get", "area"]],
        "text-max-width": 7,
      },
      paint: { "text-color": colours["ink3"] ?? "", "text-halo-color": land, "text-halo-width": 1.2 },
    },
  ];
}
