import en from "@messages/en/console/settings.json";
import fi from "@messages/fi/console/settings.json";
import { texts } from "../shared/i18n/texts";

export const settingsTexts = texts({ en, fi });
