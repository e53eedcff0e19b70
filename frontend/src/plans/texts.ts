import en from "@messages/en/console/plan.json";
import fi from "@messages/fi/console/plan.json";
import { texts } from "../shared/i18n/texts";

/** Site plans: what stands and is marked around a pad. */
export const planTexts = texts({ en, fi });
