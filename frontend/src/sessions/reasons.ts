import en from "@messages/en/reasons.json";
import fi from "@messages/fi/reasons.json";
import type { VerdictSummary } from "../shared/api/records";
import { shownFacts } from "../shared/i18n/facts";
import { texts } from "../shared/i18n/texts";

type Reason = VerdictSummary["reasons"][number];

const t = texts({ en, fi });

/** A reason as the user reads it; one of a newer contract by its code. */
export function reasonText({ code, facts }: Reason): string {
  return code in t.all.en ? t(code as keyof typeof en, shownFacts(en[code as keyof typeof en], facts)) : code;
}
