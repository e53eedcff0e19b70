import { describe, expect, it } from "vitest";
import { apart, ticks } from "./scale";

describe("an axis", () => {
  it.each([
    [0, [0, 1]],
    [1, [0, 1]],
    [7, [0, 2, 4, 6, 8]],
    [40, [0, 10, 20, 30, 40]],
    [1_234, [0, 500, 1_000, 1_500]],
  ])("to %d has round steps", (value, steps) => expect(ticks(value)).toEqual(steps));
});

describe("labels of bars", () => {
  it.each([
    ["as wished where there is room", 4, 36, 3, 4],
    ["fewer where they would meet", 2, 15, 8, 4],
    ["never none", 1, 0, 5, 390],
  ])("%s", (_name, wished, step_px, letters, every) => expect(apart(wished, step_px, letters)).toBe(every));
});
