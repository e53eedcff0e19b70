/** The registry's forms: which transaction each makes, and what is asked for. Bounds come from the contract's records. */
import type { JsonObject } from "../shared/signing/canonical";
import { typedTime, type Kind, type Typed } from "./values";

export type FieldSpec = { path: string; kind: Kind; wide?: true; optional?: true };
export type FormName =
  | "register-drone"
  | "suspend"
  | "reactivate"
  | "retire-drone"
  | "grant"
  | "revoke"
  | "withdraw-calibration"
  | "maintenance"
  | "register-pad"
  | "edit-pad"
  | "retire-pad"
  | "commission"
  | "site-plan"
  | "withdraw-change"
  | "put-first"
  | "departed"
  | "turn-away"
  | "reserve"
  | "cancel-reservation"
  | "policy";
export type FormSpec = { transaction: string; fields: readonly FieldSpec[]; danger?: true };

const REASON: FieldSpec = { path: "reason", kind: "note", wide: true };

export const FORMS: Readonly<Record<FormName, FormSpec>> = {
  "register-drone": {
    transaction: "RegisterUav",
    fields: [
      { path: "uav_id", kind: "text" },
      { path: "model", kind: "text" },
      { path: "operator_id", kind: "text" },
      { path: "registration", kind: "registration", optional: true },
    ],
  },
  suspend: { transaction: "SetUavStatus", fields: [REASON], danger: true },
  reactivate: { transaction: "ProposeReinstatement", fields: [REASON] },
  "retire-drone": { transaction: "SetUavStatus", fields: [REASON], danger: true },
  grant: {
    transaction: "GrantAuthorisation",
    fields: [
      { path: "pad_id", kind: "pad" },
      { path: "actions", kind: "actions" },
      { path: "valid_from_ms", kind: "time" },
      { path: "valid_until_ms", kind: "time" },
      { path: "authorisation_id", kind: "text" },
    ],
  },
  revoke: { transaction: "RevokeAuthorisation", fields: [REASON], danger: true },
  "withdraw-calibration": { transaction: "WithdrawCalibration", fields: [REASON], danger: true },
  maintenance: {
    transaction: "RecordMaintenance",
    fields: [
      { path: "performed_ms", kind: "time" },
      { path: "valid_until_ms", kind: "time" },
      { path: "work", kind: "note", wide: true },
    ],
  },
  "register-pad": {
    transaction: "RegisterPad",
    fields: [
      { path: "pad_id", kind: "text" },
      { path: "name", kind: "text" },
      { path: "operator_id", kind: "text" },
      { path: "lat_e7", kind: "degrees" },
      { path: "lon_e7", kind: "degrees" },
      { path: "height_mm", kind: "metres" },
      { path: "note", kind: "note", wide: true, optional: true },
    ],
  },
  "edit-pad": {
    transaction: "UpdatePad",
    fields: [
      { path: "name", kind: "text" },
      { path: "operator_id", kind: "text" },
      { path: "note", kind: "note", wide: true, optional: true },
    ],
  },
  "retire-pad": { transaction: "RetirePad", fields: [REASON], danger: true },
  commission: { transaction: "CommissionPad", fields: [] },
  "site-plan": { transaction: "SetSitePlan", fields: [] },
  "withdraw-change": { transaction: "WithdrawChange", fields: [REASON], danger: true },
  "put-first": { transaction: "GivePrecedence", fields: [REASON] },
  departed: { transaction: "RecordDeparture", fields: [{ path: "note", kind: "note", wide: true, optional: true }] },
  "turn-away": { transaction: "CancelProof", fields: [{ path: "note", kind: "note", wide: true }], danger: true },
  reserve: {
    transaction: "ReservePad",
    fields: [
      { path: "uav_id", kind: "text" },
      { path: "from_ms", kind: "time" },
      { path: "until_ms", kind: "time" },
    ],
  },
  "cancel-reservation": { transaction: "CancelReservation", fields: [{ path: "note", kind: "note", wide: true, optional: true }], danger: true },
  policy: {
    transaction: "ProposePolicy",
    fields: [
      { path: "policy.buffer_mm", kind: "metres" },
      { path: "policy.min_assurance", kind: "integer" },
      { path: "policy.verify_ppm", kind: "share" },
      { path: "policy.refute_ppm", kind: "share" },
      { path: "policy.min_rounds", kind: "integer" },
      { path: "policy.max_rounds", kind: "integer" },
      { path: "policy.height_buffer_mm", kind: "metres" },
      { path: "policy.max_claim_accuracy_mm", kind: "metres" },
      { path: "policy.max_claim_age_ms", kind: "seconds" },
      { path: "policy.max_clock_skew_ms", kind: "seconds" },
      { path: "policy.session_ttl_ms", kind: "seconds" },
      { path: "policy.min_request_gap_ms", kind: "seconds" },
      { path: "policy.broadcast_required", kind: "choice" },
      { path: "policy.witness_pad_id", kind: "text", optional: true },
      { path: "policy.occupied_ms", kind: "seconds", optional: true },
      { path: "policy.reservation_ms", kind: "seconds", optional: true },
      { path: "policy.height_required", kind: "flag" },
      { path: "policy.require_authorisation", kind: "flag" },
      { path: "policy.require_maintenance", kind: "flag" },
      { path: "policy.cancel_hopeless", kind: "flag" },
      { path: "note", kind: "note", wide: true, optional: true },
    ],
  },
};

/** A form's name as the selectors of messages are spelt. */
export function formKey(name: FormName): string {
  return name.replaceAll("-", "_");
}

const FIXED: Partial<Record<FormName, JsonObject>> = {
  suspend: { status: "suspended" },
  "retire-drone": { status: "retired" },
  "turn-away": { reason: "turned_away" },
};

/** What the form itself adds to the argument: of whom it is, and what it does. */
export function fixedPart(form: FormName, about: JsonObject): JsonObject {
  return { ...about, ...FIXED[form] };
}

/** What a new form begins with. */
export function initial(form: FormName, now_ms: number): Readonly<Record<string, Typed>> {
  const day_ms = 86_400_000;
  if (form === "grant") {
    return {
      pad_id: "*",
      actions: ["land", "takeoff"],
      valid_from_ms: typedTime(now_ms),
      valid_until_ms: typedTime(now_ms + 365 * day_ms),
      // Distinct, sortable, and short enough to say over the phone.
      authorisation_id: `a-${Math.floor(now_ms / 1000).toString(36)}`,
    };
  }
  if (form === "reserve") return { from_ms: typedTime(now_ms + 30 * 60_000), until_ms: typedTime(now_ms + 45 * 60_000) };
  if (form === "maintenance") return { performed_ms: typedTime(now_ms), valid_until_ms: typedTime(now_ms + 365 * day_ms) };
  return {};
}
