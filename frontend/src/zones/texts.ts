import en from "@messages/en/console/zone.json";
import fi from "@messages/fi/console/zone.json";
import { texts } from "../shared/i18n/texts";

/** Zones: where one may not fly, what that means for pads, and how the authority tells the ledger. */
export const zoneTexts = texts({ en, fi });
