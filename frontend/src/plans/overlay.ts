/** Site plans on the map: lines and pale faces in the greys of the place, since colour means a verdict. */
import type { ExpressionSpecification, LayerSpecification } from "maplibre-gl";
import type { Palette } from "../map/icons";
import type { Overlay } from "../map/overlays";
import type { Frame } from "../shared/api/records";
import { planFeatures, type Plan } from "./plan";

const ID = "site-plans";
/** Further away, a plan would be a smudge. */
const FROM_ZOOM = 15.5;
const SECTORS = ["approach_sector", "departure_sector"];

function layers(colours: Palette): LayerSpecification[] {
  const c = (name: string): string => colours[name] ?? "#888";
  const kinds = (...names: string[]): ExpressionSpecification => ["in", ["get", "kind"], ["literal", names]];
  const areas = (...names: string[]): ExpressionSpecification => ["all", ["==", ["geometry-type"], "Polygon"], kinds(...names)];
  const of = (id: string, type: "fill" | "line" | "fill-extrusion", filter: ExpressionSpecification, paint: Record<string, unknown>): LayerSpecification => ({ id: `${ID}-${id}`, type, source: ID, minzoom: FROM_ZOOM, filter, paint });
  return [
    of("sector", "fill", areas(...SECTORS), { "fill-color": c("ink3"), "fill-opacity": 0.06 }),
    of("sector-line", "line", areas(...SECTORS), { "line-color": c("ink3"), "line-width": 0.8, "line-opacity": 0.5, "line-dasharray": [4, 3] }),
    of("surface", "fill", areas("surface"), { "fill-color": c("quay"), "fill-outline-color": c("road-edge") }),
    of("safety", "line", areas("safety_area"), { "line-color": c("ink3"), "line-width": 1, "line-dasharray": [3, 3] }),
    of("fato", "line", areas("fato"), { "line-color": c("ink2"), "line-width": 1.6, "line-dasharray": [5, 3] }),
    of("tlof", "fill", areas("tlof"), { "fill-color": c("panel"), "fill-opacity": 0.7 }),
    of("tlof-line", "line", areas("tlof"), { "line-color": c("ink2"), "line-width": 1.6 }),
    of("marking", "line", kinds("marking"), { "line-color": c("ink2"), "line-width": 1.2 }),
    of("fence", "line", kinds("fence"), { "line-color": c("ink3"), "line-width": 1, "line-dasharray": [1, 1.5] }),
    of("obstacle", "fill", areas("obstacle", "charger"), { "fill-color": c("building-edge"), "fill-outline-color": c("ink3") }),
    of("volume", "fill-extrusion", ["all", areas("obstacle", "charger"), [">", ["get", "height_m"], 0]], { "fill-extrusion-color": c("building-edge"), "fill-extrusion-opacity": 0.9, "fill-extrusion-height": ["get", "height_m"] }),
  ];
}

/** All plans that are known, as one layer of the map. */
export function planOverlay(plans: readonly { plan: Plan; frame: Frame }[]): Overlay {
  return { id: ID, layers, features: plans.flatMap(({ plan, frame }) => planFeatures(plan, frame)) };
}
