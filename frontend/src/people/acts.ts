/** What the audit log can say that was done. */
import type { paths } from "../shared/api/schema";
import { auditTexts as t } from "./texts";

export type Act = NonNullable<NonNullable<paths["/api/v1/audit"]["get"]["parameters"]["query"]>["act"]>;

/** All of them: one that the server knows and this does not, or the other way, does not compile. */
const KNOWN: Record<Act, true> = {
  sign_in: true,
  sign_in_failed: true,
  sign_out: true,
  sign_in_ended: true,
  step_up: true,
  step_up_failed: true,
  sign_in_link_made: true,
  display_link_made: true,
  passkey_added: true,
  passkey_renamed: true,
  passkey_removed: true,
  oidc_linked: true,
  person_active: true,
  person_invited: true,
  person_changed: true,
  person_suspended: true,
  person_restored: true,
  invitation_accepted: true,
  invitation_withdrawn: true,
  invitation_link_made: true,
  recovery_link_made: true,
  account_recovered: true,
  unmask: true,
  read_personal_data: true,
  read_contents: true,
  export: true,
  give_personal_data: true,
  erase_personal_data: true,
  give_number: true,
  take_number: true,
  acknowledge: true,
  reopen: true,
  assign: true,
  snooze: true,
  note: true,
  request_proof: true,
  cancel_proof_request: true,
  import_zones: true,
  end_zones: true,
  add_client: true,
  revoke_client: true,
  token_issued: true,
  add_subscription: true,
  active_subscription: true,
  paused_subscription: true,
  remove_subscription: true,
  test_subscription: true,
  bind_key: true,
  end_key: true,
  RegisterPad: true,
  UpdatePad: true,
  RetirePad: true,
  CommissionPad: true,
  SetSitePlan: true,
  SetClosures: true,
  RegisterUav: true,
  SetUavStatus: true,
  RecordMaintenance: true,
  WithdrawCalibration: true,
  GrantAuthorisation: true,
  RevokeAuthorisation: true,
  ProposePolicy: true,
  ProposeReinstatement: true,
  ApproveChange: true,
  WithdrawChange: true,
  GivePrecedence: true,
  RecordDeparture: true,
  ReservePad: true,
  CancelReservation: true,
  CancelProof: true,
  restore_database: true,
  refused: true,
  audit_verified: true,
  audit_anchored: true,
};
export const ACTS = Object.keys(KNOWN) as readonly Act[];

/** The act that somebody wrote into an address; undefined where it is none. */
export function actOf(text: string | undefined): Act | undefined {
  return ACTS.find((act) => act === text);
}

export function nameOf(act: string): string {
  return t("name", { act, plain: act.replaceAll("_", " ") });
}

/** For a list to choose from, in the order of the user's language. */
export function actsByName(): { act: Act; name: string }[] {
  return ACTS.map((act) => ({ act, name: nameOf(act) })).sort((a, b) => a.name.localeCompare(b.name));
}
