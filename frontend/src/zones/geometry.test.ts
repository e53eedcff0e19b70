import { describe, expect, it } from "vitest";
import { hatching, holds, polygons, type Rings } from "./geometry";

const SQUARE: Rings = [
  [[22, 60], [23, 60], [23, 61], [22, 61], [22, 60]],
  [[22.4, 60.4], [22.4, 60.6], [22.6, 60.6], [22.6, 60.4], [22.4, 60.4]],
];

describe("a zone on the map", () => {
  it.each([
    [22.1, 60.1, true],
    [22.5, 60.5, false],
    [22.45, 60.2, true],
    [21.9, 60.5, false],
    [23.1, 60.5, false],
    [22.5, 61.5, false],
    [22.4, 60, true],
  ])("holds [%d, %d]: %s", (lon, lat, expected) => expect(holds(SQUARE, [lon, lat])).toBe(expected));

  it("is hatched inside, and not in its hole", () => {
    const lines = hatching(SQUARE, 12);
    expect(lines.length).toBeGreaterThanOrEqual(12);
    for (const [from, to] of lines) {
      for (const part of [0.02, 0.5, 0.98]) {
        const at: [number, number] = [from[0] + part * (to[0] - from[0]), from[1] + part * (to[1] - from[1])];
        expect(holds(SQUARE, at)).toBe(true);
      }
    }
  });

  it("has the polygons of all its parts", () => {
    const polygon: GeoJSON.Polygon = { type: "Polygon", coordinates: SQUARE.map((ring) => ring.map((point) => [...point])) };
    const several: GeoJSON.Geometry = {
      type: "GeometryCollection",
      geometries: [polygon, { type: "MultiPolygon", coordinates: [polygon.coordinates, polygon.coordinates] }, { type: "Point", coordinates: [0, 0] }],
    };
    expect(polygons(several)).toHaveLength(3);
    expect(hatching([], 5)).toEqual([]);
  });
});
