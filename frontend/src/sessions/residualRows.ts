import type { AnchorResiduals } from "../shared/api/records";

/** Of normal errors 95 % lie within so many standard deviations. */
const BAND_SIGMAS = 2;

/** How far an anchor's residuals reach by noise, bias and survey alone. */
export function band_mm({ sigma_mm }: AnchorResiduals): number {
  return BAND_SIGMAS * sigma_mm;
}

export function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / Math.max(1, values.length);
}

/** How far from zero the plots reach: the same for all anchors, and never so near that the band fills them. */
export function reach_mm(rows: readonly AnchorResiduals[]): number {
  const sizes = rows.flatMap(({ claim_mm, estimate_mm }) => [...claim_mm, ...(estimate_mm ?? [])].map(Math.abs)).sort((a, b) => a - b);
  const most = sizes[Math.floor(0.99 * (sizes.length - 1))] ?? 0;
  return 1.15 * Math.max(most, ...rows.map((row) => 1.5 * band_mm(row)));
}
