import formatEn from "@messages/en/console/format.json";
import lookEn from "@messages/en/console/look.json";
import sharedEn from "@messages/en/console/shared.json";
import formatFi from "@messages/fi/console/format.json";
import lookFi from "@messages/fi/console/look.json";
import sharedFi from "@messages/fi/console/shared.json";
import { texts } from "./i18n/texts";

/** Numbers and times in words. */
export const formatTexts = texts({ en: formatEn, fi: formatFi });

/** The states of a drone, wherever its symbol stands. */
export const lookTexts = texts({ en: lookEn, fi: lookFi });

/** Words of the parts that every page shares. */
export const sharedTexts = texts({ en: sharedEn, fi: sharedFi });
