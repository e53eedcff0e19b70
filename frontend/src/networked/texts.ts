import en from "@messages/en/console/networked.json";
import fi from "@messages/fi/console/networked.json";
import { texts } from "../shared/i18n/texts";

/** Flights that other service providers tell of (Network Remote ID): their word, nothing that we measured. */
export const networkedTexts = texts({ en, fi });
