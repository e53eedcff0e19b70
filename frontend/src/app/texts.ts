import en from "@messages/en/console/app.json";
import fi from "@messages/fi/console/app.json";
import { texts } from "../shared/i18n/texts";

/** The frame around the rooms: header, rail, banner, sign-in, help. */
export const appTexts = texts({ en, fi });
