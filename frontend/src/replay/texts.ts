import en from "@messages/en/console/replay.json";
import fi from "@messages/fi/console/replay.json";
import { texts } from "../shared/i18n/texts";

/** The room in which the past is played. */
export const replayTexts = texts({ en, fi });
