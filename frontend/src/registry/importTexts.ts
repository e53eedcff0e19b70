import en from "@messages/en/console/import.json";
import fi from "@messages/fi/console/import.json";
import { texts } from "../shared/i18n/texts";

/** Lists by CSV. */
export const importTexts = texts({ en, fi });
