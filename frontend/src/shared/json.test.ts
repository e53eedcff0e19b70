import { describe, expect, it } from "vitest";
import { laidOut } from "./json";

describe("JSON for reading", () => {
  it("keeps what is short on one line", () => expect(laidOut({ a: [1, 2], b: "x" })).toBe('{"a":[1,2],"b":"x"}'));

  it("says the same, whatever its length", () => {
    const value = { ranges: Array.from({ length: 200 }, (_, i) => i * 37), claims: Array.from({ length: 9 }, (_, t_ms) => ({ t_ms, text: "a\nb<i>" })), deep: { er: { still: "y".repeat(90) } } };
    const text = laidOut(value);
    expect(JSON.parse(text)).toEqual(value);
    expect(Math.max(...text.split("\n").map((line) => line.length))).toBeLessThan(125);
  });
});
