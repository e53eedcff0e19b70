import mapEn from "@messages/en/console/map.json";
import padEn from "@messages/en/console/pad.json";
import mapFi from "@messages/fi/console/map.json";
import padFi from "@messages/fi/console/pad.json";
import { texts } from "../shared/i18n/texts";

/** What stands on the map and at its edge. */
export const mapTexts = texts({ en: mapEn, fi: mapFi });

/** How a pad does. */
export const padTexts = texts({ en: padEn, fi: padFi });
