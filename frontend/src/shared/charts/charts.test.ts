import { describe, expect, it } from "vitest";
import { ticks } from "./scale";

describe("an axis", () => {
  it.each([
    [0, [0, 1]],
    [1, [0, 1]],
    [7, [0, 2, 4, 6, 8]],
    [40, [0, 10, 20, 30, 40]],
    [1_234, [0, 500, 1_000, 1_500]],
  ])("to %d has round steps", (value, steps) => expect(ticks(value)).toEqual(steps));
});
