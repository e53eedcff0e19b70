import { expect, it } from "vitest";
import type { ZoneFeature } from "./calls";
import { volumes, zoneOverlay } from "./overlay";

const limit = (metres: number): { metres: number; reference: "AGL" } => ({ metres, reference: "AGL" });

it("has a volume for each layer of a zone, from its floor to its ceiling", () => {
  expect(volumes({ layers: [{ lower: limit(30), upper: limit(90) }, { upper: limit(50) }] })).toEqual([
    { floor_m: 30, ceiling_m: 90 },
    { floor_m: 0, ceiling_m: 50 },
  ]);
});

it("draws a zone without a ceiling higher than its floor, none higher than 300 m, and none that ends below the ground", () => {
  const [open] = volumes({ layers: [{ lower: limit(120) }] });
  expect(open?.ceiling_m).toBeGreaterThan(120);
  expect(volumes({ layers: [{ upper: limit(5_000) }] })).toEqual([{ floor_m: 0, ceiling_m: 300 }]);
  expect(volumes({ layers: [{ upper: limit(-3) }] })).toEqual([]);
});

it("raises only what holds now, in its type's colour", () => {
  const square: GeoJSON.Polygon = { type: "Polygon", coordinates: [[[7, 43], [7.1, 43], [7.1, 43.1], [7, 43]]] };
  const zone = (active: boolean): ZoneFeature => ({ type: "Feature", geometry: square, properties: { type: "PROHIBITED", active, layers: [{ upper: limit(90) }] } as unknown as ZoneFeature["properties"] });
  const raised = (active: boolean): number => zoneOverlay([zone(active)]).features.filter(({ properties }) => properties?.["part"] === "volume").length;
  expect([raised(true), raised(false)]).toEqual([1, 0]);
  const layer = zoneOverlay([zone(true)]).layers({ bad: "#b00" }).find(({ id }) => id === "zones-PROHIBITED-volume");
  expect(layer?.paint).toMatchObject({ "fill-extrusion-color": "#b00", "fill-extrusion-base": ["get", "floor_m"] });
});
