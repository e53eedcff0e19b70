import en from "@messages/en/console/verdict.json";
import fi from "@messages/fi/console/verdict.json";
import { texts } from "../shared/i18n/texts";

export const verdictTexts = texts({ en, fi });
