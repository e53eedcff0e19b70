// @vitest-environment happy-dom
import { describe, expect, it } from "vitest";
import { dateInput, dayOf, recent } from "./spans";

describe("spans of time", () => {
  it.each(["hour", "day", "week", "month"] as const)("%s ends with the present bin and has few enough of them", (name) => {
    const now = 1_795_244_118_499;
    const { since_ms, until_ms, bin_ms } = recent(name, now);
    expect(until_ms).toBeGreaterThan(now);
    expect(until_ms - now).toBeLessThanOrEqual(bin_ms);
    expect((until_ms - since_ms) / bin_ms).toBeLessThanOrEqual(60);
  });

  it("knows days by their date, and what is none", () => {
    const span = dayOf("2026-11-21");
    if (span === undefined) expect.fail();
    expect(dateInput(span.since_ms)).toBe("2026-11-21");
    expect(dateInput(span.until_ms - 1)).toBe("2026-11-21");
    for (const bad of ["", "2026-02-30", "2026-13-01", "21.11.2026", "1969-01-01"]) expect(dayOf(bad)).toBeUndefined();
  });
});
