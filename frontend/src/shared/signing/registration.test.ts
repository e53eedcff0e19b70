import { describe, expect, it } from "vitest";
import { commitment, newSalt } from "./registration";
import vectors from "./registration-vectors.json";

describe("the commitment to a registration number", () => {
  it.each(vectors)("is the one that everybody computes: $uav_id", async ({ uav_id, registration, salt, sha256 }) => {
    expect(await commitment(uav_id, { registration, salt })).toBe(sha256);
  });

  it("has a fresh salt of 32 bytes each time", () => {
    const salts = new Set(Array.from({ length: 100 }, newSalt));
    expect(salts.size).toBe(100);
    for (const salt of salts) expect(salt).toMatch(/^[0-9a-f]{64}$/);
  });
});
