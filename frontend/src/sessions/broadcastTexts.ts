import en from "@messages/en/console/broadcast.json";
import findingsEn from "@messages/en/findings.json";
import fi from "@messages/fi/console/broadcast.json";
import findingsFi from "@messages/fi/findings.json";
import type { Track } from "../shared/api/records";
import { shownFacts, type Facts } from "../shared/i18n/facts";
import { texts } from "../shared/i18n/texts";

/** What was odd about a drone's broadcasts, and who signed them. */
export const broadcastTexts = texts({ en, fi });

const findings = texts({ en: findingsEn, fi: findingsFi });

/** One finding of a receiver in words, as part of a sentence; a kind that is not known by its name. */
export function oddity(kind: string, facts: Facts): string {
  return kind in findings.all.en ? findings(kind as keyof typeof findingsEn, shownFacts(findingsEn[kind as keyof typeof findingsEn], facts, true)) : kind;
}

/** Who signed a drone's broadcasts in words: an endorsement alone, or a signature over no position, says less. */
export function signature(drip: NonNullable<Track["drip"]>): string {
  return broadcastTexts("signed", {
    state: drip.state,
    signer: drip.signer ?? drip.det,
    reason: drip.reason ?? "",
    position: String(drip.covers_location),
    bound: String(drip.bound),
  });
}
