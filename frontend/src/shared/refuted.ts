import type { VerdictSummary } from "./api/records";

/** What a refutation rests on: five things that one tells an officer in five ways. */
export type RefutedBy = "ranges" | "height" | "leaving" | "stamps" | "broadcast";

/**
 * By what a verdict refuted; undefined where nothing did. The signed claim may be refuted although its ranges fit: by
 * time stamps that need no word of the drone's clock, by its newest rounds, where it leaves the place, or by its height.
 * The error of the ranges on the map explains none of these.
 */
export function refutedBy({ outcome, signed, broadcast, reasons }: VerdictSummary): RefutedBy | undefined {
  if (signed?.outcome === "refuted") {
    const codes = new Set([...signed.reasons, ...reasons].map(({ code }) => code));
    if (!codes.has("outside_buffer")) {
      if (codes.has("time_differences_contradict")) return "stamps";
      if (codes.has("leaving")) return "leaving";
      if (codes.has("height_contradicts")) return "height";
    }
    return "ranges";
  }
  // Only what the drone signed for; anybody can broadcast its serial number.
  if (broadcast?.outcome === "own_contradicted") return "broadcast";
  if (outcome !== "refuted") return undefined;
  return signed === undefined ? "ranges" : "stamps";
}

/** How far the drone was measured above the height that it claims (below: negative), mm. */
export function heightOff({ height }: VerdictSummary): number | undefined {
  return height === undefined ? undefined : height.measured_mm - height.claimed_mm;
}

/** Somebody broadcasts the drone's serial number from elsewhere: an impostor, or the drone's own lie. No verdict on it. */
export function isContradicted({ broadcast }: VerdictSummary): boolean {
  return broadcast?.outcome === "contradicted";
}

/**
 * Whether a broadcast puts the drone elsewhere than what it signed, and whose that broadcast is: its own by its
 * signature, or somebody's. A drone that broadcasts what it signs tells one lie, not two.
 */
export function broadcastApart(verdict: VerdictSummary): "own" | "somebody" | undefined {
  const { signed, broadcast } = verdict;
  if (broadcast?.claim === undefined || signed?.outcome === "refuted") return undefined;
  if (broadcast.outcome === "own_contradicted") return "own";
  return isContradicted(verdict) ? "somebody" : undefined;
}
