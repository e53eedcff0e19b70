import en from "@messages/en/console/statistics.json";
import fi from "@messages/fi/console/statistics.json";
import { texts } from "../shared/i18n/texts";

export const statisticsTexts = texts({ en, fi });
