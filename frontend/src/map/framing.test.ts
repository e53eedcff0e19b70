import { expect, it } from "vitest";
import { PADS } from "../shared/fake/cast";
import { isElsewhere } from "./baseMap";
import { BEARING, sideOn } from "./framing";
import type { BaseMap } from "./place";

const seen = ({ east, north }: { east: number; north: number }, bearing: number): number =>
  Math.abs(east * Math.cos((bearing * Math.PI) / 180) - north * Math.sin((bearing * Math.PI) / 180)) / Math.hypot(east, north);

it("stays where it is when a lie is seen from its side, and never looks at it end-on", () => {
  expect(sideOn({ east: 4_000, north: 0 }, 20)).toBe(20);
  expect(sideOn({ east: 0, north: 0 }, BEARING)).toBe(BEARING);
  for (let degrees = 0; degrees < 360; degrees += 15) {
    const lie = { east: 4_000 * Math.sin((degrees * Math.PI) / 180), north: 4_000 * Math.cos((degrees * Math.PI) / 180) };
    expect(seen(lie, sideOn(lie, degrees))).toBeGreaterThan(0.65);
  }
});

it("knows an archive that covers no pad", () => {
  const base = (bounds: number[]): BaseMap => ({ archive: { bounds }, missing: [] }) as unknown as BaseMap;
  expect(isElsewhere(base([-180, -90, 180, 90]), PADS)).toBe(false);
  expect(isElsewhere(base([100, 10, 101, 11]), PADS)).toBe(true);
  expect(isElsewhere(base([100, 10, 101, 11]), [])).toBe(false);
  expect(isElsewhere({ missing: [] }, PADS)).toBe(false);
});
