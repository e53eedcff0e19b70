// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { recent } from "./spans";

describe("spans of time", () => {
  it.each(["hour", "day", "week", "month"] as const)("%s ends with the present bin and has few enough of them", (name) => {
    const now = 1_795_244_118_499;
    const { since_ms, until_ms, bin_ms } = recent(name, now);
    expect(until_ms).toBeGreaterThan(now);
    expect(until_ms - now).toBeLessThanOrEqual(bin_ms);
    expect((until_ms - since_ms) / bin_ms).toBeLessThanOrEqual(60);
  });
});
