import type { VerdictSummary } from "../shared/api/records";
import { reading } from "../shared/i18n/locale";
import { FINNISH_REASONS } from "./finnishReasons";

type Reason = VerdictSummary["reasons"][number];

/**
 * The contract writes its reasons in English, with their figures; in Finnish each code has its sentence.
 *
 * A reason as the user reads it; its `original` where that says more.
 */
export function reasonText(reason: Reason): { text: string; original?: string } {
  const finnish = reading().locale === "fi" ? FINNISH_REASONS[reason.code] : undefined;
  return finnish === undefined ? { text: reason.text } : { text: finnish, original: reason.text };
}
