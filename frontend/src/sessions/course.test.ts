import { describe, expect, it } from "vitest";
import { bearing, heightOf, roundsForAxis } from "./course";
import { courseTexts } from "./courseTexts";

describe("the plot of a decision", () => {
  it("has even odds in the middle and both thresholds at the same distance from it", () => {
    expect(heightOf(500_000)).toBeCloseTo(0.5);
    expect(heightOf(990_000) + heightOf(10_000)).toBeCloseTo(1);
    expect(heightOf(1_000_000)).toBe(1);
    expect(heightOf(0)).toBe(0);
    expect(heightOf(990_000)).toBeGreaterThan(0.6);
  });

  it("names the first and the last round and a few between", () => {
    const points = (rounds: number[]) => rounds.map((each) => ({ rounds: each, t_ms: 0, outcome: "inconclusive" as const }));
    expect(roundsForAxis(points([1, 2, 160]))).toEqual([1, 50, 100, 160]);
    expect(roundsForAxis(points([1, 4]))).toEqual([1, 2, 3, 4]);
    expect(roundsForAxis(points([1, 38]))).toEqual([1, 10, 20, 30, 38]);
  });
});

describe("what a verdict can bear", () => {
  it("excludes more and leaves less open with each level, and never that keys are shared", () => {
    for (const level of [0, 1, 2, 3, 4]) {
      const { excluded, open } = bearing(level);
      expect(excluded).toHaveLength(Math.max(1, level));
      expect(open).toHaveLength(5 - level);
      expect(open.at(-1)).toBe("sharedKeys");
      for (const key of [...excluded, ...open]) expect(Object.keys(courseTexts.all.en)).toContain(key);
    }
    expect(bearing(2).open).toContain("falseStamps");
    expect(bearing(3).open).not.toContain("falseStamps");
  });
});
