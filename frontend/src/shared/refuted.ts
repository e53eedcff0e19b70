import type { VerdictSummary } from "./api/records";

/** What a refutation rests on: four things that one tells an officer in four ways. */
export type RefutedBy = "ranges" | "leaving" | "stamps" | "broadcast";

/**
 * By what a verdict refuted; undefined where nothing did. The signed claim may be refuted although its ranges fit: by
 * time stamps that need no word of the drone's clock, or by its newest rounds, where it leaves the place. The error of
 * the ranges explains neither.
 */
export function refutedBy({ outcome, signed, broadcast, reasons }: VerdictSummary): RefutedBy | undefined {
  if (signed?.outcome === "refuted") {
    const codes = new Set([...signed.reasons, ...reasons].map(({ code }) => code));
    if (!codes.has("outside_buffer")) {
      if (codes.has("time_differences_contradict")) return "stamps";
      if (codes.has("leaving")) return "leaving";
    }
    return "ranges";
  }
  if (broadcast?.outcome === "refuted") return "broadcast";
  if (outcome !== "refuted") return undefined;
  return signed === undefined ? "ranges" : "stamps";
}
