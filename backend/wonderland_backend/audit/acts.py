"""What the log can say that was done: the one list, which the console's filter and its names follow."""

from __future__ import annotations

from typing import Final, Literal, get_args

Act = Literal[
    # Signing in.
    "sign_in",
    "sign_in_failed",
    "sign_out",
    "sign_in_ended",
    "step_up",
    "step_up_failed",
    "sign_in_link_made",
    "display_link_made",
    "passkey_added",
    "passkey_renamed",
    "passkey_removed",
    "oidc_linked",
    # People.
    "person_active",
    "person_invited",
    "person_changed",
    "person_suspended",
    "person_restored",
    "invitation_accepted",
    "invitation_withdrawn",
    "invitation_link_made",
    "recovery_link_made",
    "account_recovered",
    # Reading what not everybody may.
    "unmask",
    "read_personal_data",
    "read_contents",
    "export",
    # Personal data, by the server's administrator.
    "give_personal_data",
    "erase_personal_data",
    "give_number",
    "take_number",
    # Alerts.
    "acknowledge",
    "reopen",
    "assign",
    "snooze",
    "note",
    # Proofs, zones, machines.
    "request_proof",
    "cancel_proof_request",
    "import_zones",
    "end_zones",
    "add_client",
    "revoke_client",
    "token_issued",
    "add_subscription",
    "active_subscription",
    "paused_subscription",
    "remove_subscription",
    "test_subscription",
    # Keys, and the transactions that are signed with them (`wonderland_backend.transactions.functions`).
    "bind_key",
    "end_key",
    "RegisterPad",
    "UpdatePad",
    "RetirePad",
    "CommissionPad",
    "SetSitePlan",
    "SetClosures",
    "RegisterUav",
    "SetUavStatus",
    "RecordMaintenance",
    "WithdrawCalibration",
    "GrantAuthorisation",
    "RevokeAuthorisation",
    "ProposePolicy",
    "ProposeReinstatement",
    "ApproveChange",
    "WithdrawChange",
    "GivePrecedence",
    "RecordDeparture",
    "ReservePad",
    "CancelReservation",
    "CancelProof",
    "restore_database",
    # What was refused (401, 403, 413, 422, 429).
    "refused",
    # The log itself.
    "audit_verified",
    "audit_anchored",
]
ACTS: Final[frozenset[str]] = frozenset(get_args(Act))
