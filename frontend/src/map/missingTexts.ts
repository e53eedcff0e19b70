import missingEn from "@messages/en/console/missing.json";
import whyEn from "@messages/en/maps.json";
import missingFi from "@messages/fi/console/missing.json";
import whyFi from "@messages/fi/maps.json";
import { texts } from "../shared/i18n/texts";
import type { BaseMap } from "./place";

export type MissingMap = BaseMap["missing"][number];

/** What of the map's ground is missing, and why. */
export const missingTexts = texts({ en: missingEn, fi: missingFi });

/** By the server's codes. */
const whyTexts = texts({ en: whyEn, fi: whyFi });

function isKnown(code: string): code is keyof typeof whyTexts.all.en {
  return Object.hasOwn(whyTexts.all.en, code);
}

/** In the reader's language; a reason that this console does not know yet in the server's words. */
export function whyMissing({ code, facts, why }: MissingMap): string {
  return isKnown(code) ? whyTexts(code, facts) : why;
}
