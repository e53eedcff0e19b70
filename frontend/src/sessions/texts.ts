import filterEn from "@messages/en/console/filter.json";
import proofEn from "@messages/en/console/proof.json";
import rowEn from "@messages/en/console/row.json";
import sessionEn from "@messages/en/console/session.json";
import stepEn from "@messages/en/console/step.json";
import filterFi from "@messages/fi/console/filter.json";
import proofFi from "@messages/fi/console/proof.json";
import rowFi from "@messages/fi/console/row.json";
import sessionFi from "@messages/fi/console/session.json";
import stepFi from "@messages/fi/console/step.json";
import { texts } from "../shared/i18n/texts";

/** A proof in words: what was claimed, what was measured, what follows. */
export const proofTexts = texts({ en: proofEn, fi: proofFi });

/** A row of the list: what is known, and where. */
export const rowTexts = texts({ en: rowEn, fi: rowFi });

/** The panel of a session, and its page. */
export const sessionTexts = texts({ en: sessionEn, fi: sessionFi });

/** The eight steps. */
export const stepTexts = texts({ en: stepEn, fi: stepFi });

/** What lists of sessions and verdicts are filtered by. */
export const filterTexts = texts({ en: filterEn, fi: filterFi });
