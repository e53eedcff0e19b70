import { expect, it } from "vitest";
import { band_mm, mean, reach_mm } from "./residualRows";

const row = (claim_mm: number[], estimate_mm?: number[]) => ({ anchor_id: "A0", t_ms: claim_mm.map((_, i) => i), claim_mm, sigma_mm: 30, ...(estimate_mm && { estimate_mm }) });

it("one scale holds every anchor, a lie as well as the band", () => {
  expect(reach_mm([row([4_000, 4_010, 3_990], [0, 10, -10]), row([-20, 5, 0])])).toBeGreaterThan(4_000);
  const honest = [row([5, -8, 0])];
  expect(reach_mm(honest)).toBeGreaterThan(band_mm(row([])));
  expect(reach_mm([])).not.toBeNaN();
});

it("takes the mean with its sign", () => {
  expect(mean([-10, -20])).toBe(-15);
  expect(mean([])).toBe(0);
});
