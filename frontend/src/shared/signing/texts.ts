import en from "@messages/en/console/signing.json";
import fi from "@messages/fi/console/signing.json";
import { texts } from "../i18n/texts";

/** Signing a change, and the keys that one signs with. */
export const signingTexts = texts({ en, fi });

const ROLES: ReadonlySet<string> = new Set(["admin", "inspector", "pad_operator", "fleet_operator", "pad", "uav", "mirror"]);

/** A role of the ledger in words; one that is not known as it is. */
export function roleName(role: string): string {
  return ROLES.has(role) ? signingTexts("role", { role }) : role;
}
