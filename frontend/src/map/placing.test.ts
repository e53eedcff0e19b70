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
