import en from "@messages/en/console/client.json";
import fi from "@messages/fi/console/client.json";
import { texts } from "../shared/i18n/texts";

/** Machines that read the API. */
export const clientTexts = texts({ en, fi });

/** A scope as people read it; by its own name where it has no words yet. */
export function scopeWord(scope: string): string {
  return clientTexts("scope", { scope: scope.replaceAll(/[.-]/g, "_") }) || scope;
}
