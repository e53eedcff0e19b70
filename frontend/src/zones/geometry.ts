/** Polygons on the map: which hold a place, and the hatching of those that are prohibited. */
import type { LonLat } from "../shared/geo/frame";

type Ring = readonly (readonly number[])[];
export type Rings = readonly Ring[];

/** The polygons of a geometry, each as its rings. */
export function polygons(geometry: GeoJSON.Geometry): Rings[] {
  if (geometry.type === "Polygon") return [geometry.coordinates];
  if (geometry.type === "MultiPolygon") return geometry.coordinates;
  return geometry.type === "GeometryCollection" ? geometry.geometries.flatMap(polygons) : [];
}

/** Where a horizontal line crosses the edges of the rings, from west to east. */
function crossings(rings: Rings, height: (point: readonly number[]) => number, at: number, along: (point: readonly number[]) => number): number[] {
  const found: number[] = [];
  for (const ring of rings) {
    for (let i = 1; i < ring.length; i++) {
      const [a, b] = [ring[i - 1], ring[i]];
      if (a === undefined || b === undefined) continue;
      const [from, to] = [height(a), height(b)];
      // Half-open: a line through a corner crosses one of its two edges.
      if (from <= at === to <= at) continue;
      found.push(along(a) + ((at - from) / (to - from)) * (along(b) - along(a)));
    }
  }
  return found.sort((one, other) => one - other);
}

const x = (point: readonly number[]): number => point[0] ?? 0;
const y = (point: readonly number[]): number => point[1] ?? 0;

/** Whether a place lies inside; in a hole it does not. */
export function holds(rings: Rings, [lon, lat]: LonLat): boolean {
  return crossings(rings, y, lat, x).filter((each) => each > lon).length % 2 === 1;
}

/** Slanting lines inside of a polygon, this many across it. */
export function hatching(rings: Rings, count: number): [LonLat, LonLat][] {
  // On a map a degree of latitude is longer than one of longitude: slanted by that, lines look the same everywhere.
  const outer = rings[0] ?? [];
  const middle = outer.length === 0 ? 0 : (Math.min(...outer.map(y)) + Math.max(...outer.map(y))) / 2;
  const narrow = Math.max(0.05, Math.cos((middle * Math.PI) / 180));
  const slant = (point: readonly number[]): number => y(point) - x(point) * narrow;
  const heights = outer.map(slant);
  const [least, most] = [Math.min(...heights), Math.max(...heights)];
  const lines: [LonLat, LonLat][] = [];
  for (let i = 0; i < count; i++) {
    const at = least + ((i + 0.5) / count) * (most - least);
    const ends = crossings(rings, slant, at, x);
    for (let k = 1; k < ends.length; k += 2) {
      const [from, to] = [ends[k - 1], ends[k]];
      if (from !== undefined && to !== undefined) lines.push([[from, at + from * narrow], [to, at + to * narrow]]);
    }
  }
  return lines;
}
