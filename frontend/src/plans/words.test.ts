import { expect, test } from "vitest";
import type { PlanFeature } from "./plan";
import { LINE, planWords, type Paper } from "./words";

const paper: Paper = { size: 420, x: (east_m) => 210 + 10 * east_m, y: (north_m) => 210 - 10 * north_m };
const mast = (name: string, east: number, north: number): PlanFeature => ({ kind: "obstacle", name, height_m: 6, shape: "Point", rings: [[[east, north]]] });

test("names of things that stand side by side cover each other nowhere", () => {
  const words = planWords([mast("Lamp", 0, 0), mast("Crane", 0.5, 0.5), mast("Shed with a long name", 1, 0), mast("Pole", 0, 1)], paper);
  expect(words).toHaveLength(4);
  for (const a of words) for (const b of words) if (a !== b) expect(a.left + a.width <= b.left || b.left + b.width <= a.left || a.top + LINE <= b.top || b.top + LINE <= a.top, `${a.text} and ${b.text}`).toBe(true);
});

test("what lies beyond the drawing, or has no name, has no words; a mast without one has its height", () => {
  expect(planWords([mast("Far", 500, 0), { ...mast("", 0, 0), kind: "marking" }, mast("", 2, 2)], paper).map(({ text }) => text)).toEqual(["6\u00a0m"]);
});

test("a marking that is a point has its name beside it, not at the pad's middle", () => {
  const [word] = planWords([{ ...mast("Gate", 12, 0), kind: "marking" }], paper);
  expect((word?.left ?? 0) + (word?.width ?? 0) / 2).toBeCloseTo(330, -1);
});
