import en from "@messages/en/console/room.json";
import fi from "@messages/fi/console/room.json";
import { texts } from "./i18n/texts";

/** The names of the rooms. */
export const roomTexts = texts({ en, fi });
