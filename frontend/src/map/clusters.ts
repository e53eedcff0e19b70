import type { Pad } from "../shared/api/records";
import { LOOKS, type Look } from "../shared/drones";
import { HIDDEN, type Fleet } from "../shared/fleet";
import { latitude, longitude, mercatorX, mercatorY } from "../shared/geo/mercator";
import type { TrackTable } from "../shared/live/tracks";
import { TILE } from "./view";

/** What stands together, seen from afar: how many pads and drones, and the gravest of what they see. */
export type Cluster = {
  /** Web Mercator, 0 to 1: the middle of what it holds. */
  x: number;
  y: number;
  pads: Pad[];
  drones: number;
  needing: number;
  look: Look | undefined;
  /** Degrees: west, south, east, north. */
  bounds: [number, number, number, number];
};

/** Pixels between two clusters, at least; half of that is the square that is counted at once. */
export const APART = 72;
/** Grave in this order; the others have no word to say from afar. */
const GRAVE: readonly Look[] = ["refuted", "inconclusive", "proving", "verified"];

type Sum = { x: number; y: number; n: number; pads: Pad[]; drones: number; needing: number; gravest: number; west: number; east: number; north: number; south: number };

function empty(): Sum {
  return { x: 0, y: 0, n: 0, pads: [], drones: 0, needing: 0, gravest: GRAVE.length, west: 1, east: 0, north: 1, south: 0 };
}

function add(sum: Sum, x: number, y: number): void {
  sum.x += x;
  sum.y += y;
  sum.n += 1;
  sum.west = Math.min(sum.west, x);
  sum.east = Math.max(sum.east, x);
  sum.north = Math.min(sum.north, y);
  sum.south = Math.max(sum.south, y);
}

function merge(into: Sum, other: Sum): void {
  into.x += other.x;
  into.y += other.y;
  into.n += other.n;
  into.pads.push(...other.pads);
  into.drones += other.drones;
  into.needing += other.needing;
  into.gravest = Math.min(into.gravest, other.gravest);
  into.west = Math.min(into.west, other.west);
  into.east = Math.max(into.east, other.east);
  into.north = Math.min(into.north, other.north);
  into.south = Math.max(into.south, other.south);
}

/** Clusters at a zoom; those with pads first, then the fullest. In one pass over the drones and one over the squares. */
export function clusters(pads: Iterable<Pad>, tracks: TrackTable, fleet: Fleet, zoom: number): Cluster[] {
  const squares = (TILE * 2 ** Math.floor(zoom)) / (APART / 2);
  const sums = new Map<number, Sum>();
  const sumAt = (x: number, y: number): Sum => {
    const key = Math.floor(y * squares) * 2 ** 24 + Math.floor(x * squares);
    const known = sums.get(key);
    if (known !== undefined) return known;
    const made = empty();
    sums.set(key, made);
    return made;
  };
  for (const pad of pads) {
    if (pad.status === "retired") continue;
    const [x, y] = [mercatorX(pad.lon_e7 / 1e7), mercatorY(pad.lat_e7 / 1e7)];
    const sum = sumAt(x, y);
    add(sum, x, y);
    sum.pads.push(pad);
  }
  const grave = LOOKS.map((look) => (GRAVE.includes(look) ? GRAVE.indexOf(look) : GRAVE.length));
  for (let slot = 0; slot < fleet.looks.length; slot++) {
    const code = fleet.looks[slot] ?? HIDDEN;
    if (code === HIDDEN) continue;
    const [x = 0, y = 0] = [tracks.x[slot], tracks.y[slot]];
    const sum = sumAt(x, y);
    add(sum, x, y);
    sum.drones += 1;
    sum.gravest = Math.min(sum.gravest, grave[code] ?? GRAVE.length);
  }
  for (const { group, track } of fleet.judged) {
    if (group === "needs-you" && track !== undefined) sumAt(mercatorX(track.lon_e7 / 1e7), mercatorY(track.lat_e7 / 1e7)).needing += 1;
  }
  return gathered([...sums.values()].filter(({ n }) => n > 0), APART / (TILE * 2 ** zoom)).map(shown);
}

/** Squares that stand too near each other for two marks become one, the weightiest first. */
function gathered(sums: Sum[], apart: number): Sum[] {
  sums.sort((a, b) => b.pads.length - a.pads.length || b.n - a.n);
  const result: Sum[] = [];
  for (const sum of sums) {
    const near = result.find((other) => Math.hypot(other.x / other.n - sum.x / sum.n, other.y / other.n - sum.y / sum.n) < apart);
    if (near === undefined) result.push(sum);
    else merge(near, sum);
  }
  return result;
}

function shown(sum: Sum): Cluster {
  return {
    x: sum.x / sum.n,
    y: sum.y / sum.n,
    pads: sum.pads,
    drones: sum.drones,
    needing: sum.needing,
    look: GRAVE[sum.gravest],
    bounds: [longitude(sum.west), latitude(sum.south), longitude(sum.east), latitude(sum.north)],
  };
}
