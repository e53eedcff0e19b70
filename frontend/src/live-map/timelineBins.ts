import type { VerdictSummary } from "../shared/api/records";

export const SPAN_MS = 3_600_000;
export const BIN_MS = 30_000;
export const BINS = SPAN_MS / BIN_MS;

export type Bin = {
  start_ms: number;
  verified: number;
  inconclusive: number;
  refuted: number;
  /** The gravest verdict of the bin, the newest of those. */
  gravest?: VerdictSummary;
};

const GRAVITY = { refuted: 2, inconclusive: 1, verified: 0 } as const;

/** The last hour's verdicts in half minutes, oldest first; bins lie on whole half minutes, so that they do not flicker. */
export function bins(verdicts: readonly VerdictSummary[], now_ms: number): Bin[] {
  const end_ms = (Math.floor(now_ms / BIN_MS) + 1) * BIN_MS;
  const start_ms = end_ms - SPAN_MS;
  const result = Array.from(
    { length: BINS },
    (_, i): Bin => ({ start_ms: start_ms + i * BIN_MS, verified: 0, inconclusive: 0, refuted: 0 }),
  );
  for (const verdict of verdicts) {
    const bin = result[Math.floor((verdict.decided_ms - start_ms) / BIN_MS)];
    if (bin === undefined) continue;
    bin[verdict.outcome] += 1;
    const known = bin.gravest;
    const graver =
      known === undefined ||
      GRAVITY[verdict.outcome] > GRAVITY[known.outcome] ||
      (verdict.outcome === known.outcome && verdict.decided_ms > known.decided_ms);
    if (graver) bin.gravest = verdict;
  }
  return result;
}
