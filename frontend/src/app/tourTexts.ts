import en from "@messages/en/console/tour.json";
import fi from "@messages/fi/console/tour.json";
import { texts } from "../shared/i18n/texts";

export const tourTexts = texts({ en, fi });
