import en from "@messages/en/console/ledger.json";
import fi from "@messages/fi/console/ledger.json";
import { texts } from "../shared/i18n/texts";

export const ledgerTexts = texts({ en, fi });
