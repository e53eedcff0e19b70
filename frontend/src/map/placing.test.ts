import { expect, it } from "vitest";
import { Occupied, place, type Label } from "./placing";

const label: Label = { id: "a", left: 150, top: 150, width: 60, height: 18, rank: 10, clear: 9, sides: ["above", "left", "right", "below"] };

it("moves a label further away where all that is beside its place is taken", () => {
  const occupied = new Occupied(300, 300);
  occupied.take(80, 122, 140, 56);
  const [placed] = place([{ ...label }], occupied, new Map(), 10);
  expect(placed?.side).toBe("above");
  expect((placed?.top ?? 0) + 18).toBeLessThan(122);
});

it("leaves a label out where even there is no room", () => {
  const occupied = new Occupied(300, 300);
  occupied.take(0, 0, 300, 300);
  expect(place([{ ...label }], occupied, new Map(), 10)).toEqual([]);
});

it("puts what must stand where it covers nothing, however far that is, and on the screen in any case", () => {
  const occupied = new Occupied(300, 300);
  occupied.take(40, 70, 220, 170);
  const [far] = place([{ ...label, rank: -1 }], occupied, new Map(), 10);
  expect(far === undefined || occupied.isFree(far.left, far.top, 1, 1)).toBe(false);
  expect((far?.top ?? 99) + 18).toBeLessThan(70);
  const full = new Occupied(300, 300);
  full.take(0, 0, 300, 300);
  const [anyway] = place([{ ...label, top: 8, rank: -1 }], full, new Map(), 10);
  expect(anyway?.top).toBeGreaterThanOrEqual(0);
});

it("leaves of a label what there is room for", () => {
  const narrow = new Occupied(300, 300);
  narrow.take(0, 0, 130, 300);
  narrow.take(174, 0, 126, 300);
  const [placed] = place([{ ...label, fewer: { width: 30, height: 14 } }], narrow, new Map(), 10);
  expect(placed?.isLess).toBe(true);
});
