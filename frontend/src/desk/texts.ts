import en from "@messages/en/console/desk.json";
import fi from "@messages/fi/console/desk.json";
import { texts } from "../shared/i18n/texts";

/** What stands round the map, live and in the replay: list, legend, table, tools. */
export const deskTexts = texts({ en, fi });
