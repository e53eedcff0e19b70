import { describe, expect, it } from "vitest";
import { between, dateInput, dayOf } from "./days";

describe("days", () => {
  it("are known by their date, and what is none", () => {
    const span = dayOf("2026-11-21");
    if (span === undefined) expect.fail();
    expect(dateInput(span.since_ms)).toBe("2026-11-21");
    expect(dateInput(span.until_ms - 1)).toBe("2026-11-21");
    for (const bad of ["", "2026-02-30", "2026-13-01", "21.11.2026", "1969-01-01"]) expect(dayOf(bad)).toBeUndefined();
  });

  it("limit a list, both included, each alone as well", () => {
    const { since_ms, until_ms } = between("2026-11-21", "2026-11-22");
    expect(dateInput(since_ms ?? 0)).toBe("2026-11-21");
    expect([dateInput(until_ms ?? 0), dateInput((until_ms ?? 0) + 1)]).toEqual(["2026-11-22", "2026-11-23"]);
    expect(between(undefined, "2026-11-22")).toEqual({ until_ms });
    expect(between("soon", undefined)).toEqual({});
  });
});
