import en from "@messages/en/console/end.json";
import fi from "@messages/fi/console/end.json";
import { reading } from "../shared/i18n/locale";
import { texts } from "../shared/i18n/texts";

/** Why sessions end, and why steps fail, by the codes that the agents give (`end`, and the first word of a `detail`). */
export const endTexts = texts({ en, fi });

type Code = keyof typeof endTexts.all.en;

function isKnown(code: string): code is Code {
  return Object.hasOwn(endTexts.all.en, code);
}

/** A code in words; one that this console does not know loses its underscores. */
export function endText(code: string): string {
  return isKnown(code) ? endTexts(code) : code.replaceAll("_", " ");
}

/** "no_reply: the drone did not answer over UWB": the agent's own words in English, the catalogue's in other languages. */
export function detailText(detail: string): string {
  const [, code, said] = /^([a-z0-9_]+)(?:: (.*))?$/s.exec(detail) ?? [];
  if (code === undefined) return detail;
  return said === undefined || (reading().locale !== "en" && isKnown(code)) ? endText(code) : said;
}
