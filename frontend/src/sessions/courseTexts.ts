import en from "@messages/en/console/course.json";
import fi from "@messages/fi/console/course.json";
import { texts } from "../shared/i18n/texts";

/** How the decision came about, and what it can bear. */
export const courseTexts = texts({ en, fi });
