import auditEn from "@messages/en/console/audit.json";
import peopleEn from "@messages/en/console/people.json";
import signInEn from "@messages/en/console/sign-in.json";
import auditFi from "@messages/fi/console/audit.json";
import peopleFi from "@messages/fi/console/people.json";
import signInFi from "@messages/fi/console/sign-in.json";
import { texts } from "../shared/i18n/texts";

/** Signing in, and accepting a link. */
export const signInTexts = texts({ en: signInEn, fi: signInFi });

/** The people room: accounts, one's own and others'. */
export const peopleTexts = texts({ en: peopleEn, fi: peopleFi });

/** The audit log, and showing what is masked. */
export const auditTexts = texts({ en: auditEn, fi: auditFi });
