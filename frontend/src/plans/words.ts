import { Occupied, place, type Label } from "../map/placing";
import { length } from "../shared/format";
import type { Metres, PlanFeature } from "./plan";

/** Of the drawing, in its own units. */
export type Paper = { size: number; x: (east_m: number) => number; y: (north_m: number) => number };
export type Word = { text: string; left: number; top: number; width: number };

export const LINE = 13;
/** A cautious mean of Inter at 10.5 px. */
const LETTER = 5.9;
/** Half of a mast's square. */
const MAST = 4;

function middle(points: readonly Metres[]): Metres {
  const sum = (axis: 0 | 1): number => points.reduce((found, point) => found + point[axis], 0) / Math.max(1, points.length);
  return [sum(0), sum(1)];
}

/** Where the name of something large stands: inside, at the middle of its longest edge. */
function besideEdge(points: readonly Metres[]): Metres {
  if (points.length < 2) return middle(points);
  const edges = points.slice(1).map((to, i) => [points[i] ?? to, to] as const);
  const long = edges.reduce((best, edge) => (Math.hypot(edge[1][0] - edge[0][0], edge[1][1] - edge[0][1]) > Math.hypot(best[1][0] - best[0][0], best[1][1] - best[0][1]) ? edge : best), edges[0] ?? [[0, 0], [0, 0]]);
  const [at, inside] = [middle(long), middle(points)];
  return [at[0] + 0.16 * (inside[0] - at[0]), at[1] + 0.16 * (inside[1] - at[1])];
}

const stands = (kind: PlanFeature["kind"]): boolean => kind === "obstacle" || kind === "charger";

/** Names and heights, each where it covers no other and nothing that stands there; obstacles come first. */
export function planWords(features: readonly PlanFeature[], { size, x, y }: Paper): Word[] {
  const occupied = new Occupied(size, size);
  const texts = new Map<string, string>();
  const labels = features.flatMap(({ kind, name, height_m, rings }, i): Label[] => {
    const [ring = []] = rings;
    const [east, north] = (stands(kind) ? middle : besideEdge)(ring);
    const [left, top] = [x(east), y(north)];
    const half = (values: readonly number[]): number => (Math.max(...values) - Math.min(...values)) / 2;
    const clear = stands(kind) ? Math.max(MAST, Math.min(half(ring.map(([e]) => x(e))), half(ring.map(([, n]) => y(n))))) : 0;
    if (stands(kind)) occupied.take(left - clear, top - clear, 2 * clear, 2 * clear);
    const text = [name, ...(height_m === undefined ? [] : [length(height_m * 1000, true)])].filter((each) => each !== "").join(" · ");
    if ((name === "" && kind !== "obstacle") || text === "" || left < 0 || left > size || top < 0 || top > size) return [];
    texts.set(String(i), text);
    return [{ id: String(i), left, top, width: text.length * LETTER, height: LINE, rank: stands(kind) ? 0 : 1, clear, sides: ["above", "below", "right", "left"] }];
  });
  return place(labels, occupied, new Map(), labels.length).map(({ label, left, top }) => ({ text: texts.get(label.id) ?? "", left, top, width: label.width }));
}
