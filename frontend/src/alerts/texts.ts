import titlesEn from "@messages/en/alert-titles.json";
import alertsEn from "@messages/en/alerts.json";
import inboxEn from "@messages/en/console/inbox.json";
import severalEn from "@messages/en/console/several.json";
import titlesFi from "@messages/fi/alert-titles.json";
import alertsFi from "@messages/fi/alerts.json";
import inboxFi from "@messages/fi/console/inbox.json";
import severalFi from "@messages/fi/console/several.json";
import { texts } from "../shared/i18n/texts";

/** What an alert says, in one sentence; by its kind. */
export const alertTexts = texts({ en: alertsEn, fi: alertsFi });
export const alertTitles = texts({ en: titlesEn, fi: titlesFi });

/** The inbox around them. */
export const inboxTexts = texts({ en: inboxEn, fi: inboxFi });

/** Several alerts at once. */
export const severalTexts = texts({ en: severalEn, fi: severalFi });
