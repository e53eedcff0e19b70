import en from "@messages/en/console/live.json";
import fi from "@messages/fi/console/live.json";
import { texts } from "../shared/i18n/texts";

/** The live page alone: the last hour, the wall display, what is announced. */
export const liveTexts = texts({ en, fi });
