import { describe, expect, it } from "vitest";
import { typedTime } from "./typedTime";

const NOW = new Date(2026, 10, 22, 9, 30, 15).getTime();
const at = (year: number, month: number, day: number, hours: number, minutes: number, seconds = 0): number => new Date(year, month, day, hours, minutes, seconds).getTime();

describe("a typed time", () => {
  it.each([
    ["yesterday 14:00", at(2026, 10, 21, 14, 0)],
    ["  Yesterday   at 14:00 ", at(2026, 10, 21, 14, 0)],
    ["eilen 14.00", at(2026, 10, 21, 14, 0)],
    ["eilen klo 14.00", at(2026, 10, 21, 14, 0)],
    ["yesterday", at(2026, 10, 21, 0, 0)],
    ["9:05", at(2026, 10, 22, 9, 5)],
    ["9.05.20", at(2026, 10, 22, 9, 5, 20)],
    ["14:00", at(2026, 10, 21, 14, 0)],
    ["20.11. 9.00", at(2026, 10, 20, 9, 0)],
    ["20.11.2026 9.00", at(2026, 10, 20, 9, 0)],
    ["2026-11-20 09:00:30", at(2026, 10, 20, 9, 0, 30)],
    ["2026-11-20T09:00:00Z", Date.UTC(2026, 10, 20, 9)],
    ["−10 min", NOW - 600_000],
    ["-1,5 h", NOW - 5_400_000],
    ["2 h ago", NOW - 7_200_000],
    ["3 pv sitten", NOW - 3 * 86_400_000],
  ])("%s", (text, expected) => {
    expect(typedTime(text, NOW)).toBe(expected);
  });

  it.each(["", "soon", "25:00", "12:61", "31.2.2026 10.00", "tomorrow 10:00", "10 parsecs", "<script>", "2026-13-01T10:00Z"])("refuses %s", (text) => {
    expect(typedTime(text, NOW)).toBeUndefined();
  });
});
