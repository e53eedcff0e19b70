"""Every transaction: its argument, who may send it, and the event that it emits.

Each takes one argument, a JSON object of the record named here, and returns one JSON object. Events carry the stored
record (or, for assets, all but the value) under the name given here, with ``kind`` first among what they say, so that
a listener needs to know nothing in advance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records import assets, calibrations, pads, sessions, uavs
from wonderland.proofs.records.audit import AnchorAuditLog, AuditHeadsOf
from wonderland.proofs.records.changes import PolicyAction, PolicyChange, Reinstatement, require_one
from wonderland.proofs.records.closures import MAX_CLOSURES, Closure
from wonderland.proofs.records.fields import (
    Action,
    HeightMm,
    LatE7,
    LonE7,
    Name,
    Note,
    OperatorId,
    PadId,
    PrekeyId,
    PublicKey,
    SessionId,
    Sha256Hex,
    TimeMs,
    UavId,
)
from wonderland.proofs.records.landings import LandingCause
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.reservations import ReservationId
from wonderland.proofs.records.schema import Choice, Integer, Items, Record, Text

ADMIN, INSPECTOR, MIRROR = "admin", "inspector", "mirror"
PAD_OPERATOR, PAD = "pad_operator", "pad"
FLEET_OPERATOR, UAV = "fleet_operator", "uav"
ROLES: Final = (ADMIN, INSPECTOR, MIRROR, PAD_OPERATOR, PAD, FLEET_OPERATOR, UAV)
MSP_OF_ROLE: Final = {
    ADMIN: "AuthorityMSP",
    INSPECTOR: "AuthorityMSP",
    MIRROR: "AuthorityMSP",
}
"""Roles that only one organisation can give; pads and fleets may have several organisations each."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RegisterPad(Record):
    """Makes a pad known; its operator's organisation owns it."""

    pad_id: PadId
    name: Name
    operator_id: OperatorId
    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class UpdatePad(Record):
    """Changes what people read of a pad; where it stands only commissioning can change."""

    pad_id: PadId
    name: Name | None = None
    operator_id: OperatorId | None = None
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class RetirePad(Record):
    """Takes a pad out of service for good."""

    pad_id: PadId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class CommissionPad(Record):
    """Records the survey and calibration of a pad's anchors."""

    pad_id: PadId
    commissioning: pads.Commissioning


@dataclass(frozen=True, kw_only=True, slots=True)
class SetSitePlan(Record):
    """Names the plan of a pad's site by the SHA-256 of its file; without one, the pad has no plan any more."""

    pad_id: PadId
    site_plan_sha256: Sha256Hex | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class PublishPrekeys(Record):
    """Offers one-time keys for coming sessions."""

    pad_id: PadId
    prekeys: Annotated[tuple[pads.OfferedPrekey, ...], Items(1, 100)]


@dataclass(frozen=True, kw_only=True, slots=True)
class RegisterUav(Record):
    """Makes a drone known; its operator's organisation owns it."""

    REFUSED: ClassVar = uavs.NO_NUMBER

    uav_id: UavId
    operator_id: OperatorId
    model: Name
    registration_commitment: uavs.RegistrationCommitment | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class SetUavStatus(Record):
    """Suspends or retires a drone. `active` is refused: it takes two people to lift a suspension."""

    uav_id: UavId
    status: Annotated[str, Choice(uavs.STATUSES)]
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class GrantAuthorisation(Record):
    """Permits a drone some actions at a pad for a time."""

    authorisation_id: uavs.AuthorisationId
    uav_id: UavId
    pad_id: uavs.PadPattern
    actions: Annotated[tuple[str, ...], Items(1, 3, of=Choice(("land", "takeoff", "dock")))]
    valid_from_ms: TimeMs
    valid_until_ms: TimeMs

    def validate(self, path: str) -> None:
        """The time must not be empty."""
        if self.valid_until_ms <= self.valid_from_ms:
            raise RecordError(f"{path}.valid_until_ms" if path else "valid_until_ms", "must be after valid_from_ms")


@dataclass(frozen=True, kw_only=True, slots=True)
class RevokeAuthorisation(Record):
    """Withdraws an authorisation."""

    uav_id: UavId
    authorisation_id: uavs.AuthorisationId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordMaintenance(Record):
    """Records that a drone was maintained, and until when that is good."""

    uav_id: UavId
    performed_ms: TimeMs
    valid_until_ms: TimeMs
    work: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class CalibrateUav(Record):
    """Records what a drone's node adds to every range at a pad; never by the drone's own organisation."""

    uav_id: UavId
    pad_id: PadId
    offset_mm: calibrations.OffsetMm
    sigma_mm: calibrations.OffsetSigmaMm
    sessions: calibrations.CalibrationSessions
    valid_until_ms: TimeMs
    node: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class WithdrawCalibration(Record):
    """Says that a drone's calibration at a pad holds no longer: its node or antenna was changed."""

    uav_id: UavId
    pad_id: PadId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class ProposePolicy(Record):
    """Proposes the policy of a pad (or *) and an action (or *); it holds once another person has approved it."""

    pad_id: uavs.PadPattern
    action: PolicyAction
    policy: Policy
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ProposeReinstatement(Record):
    """Proposes to lift a drone's suspension; it is lifted once another person has approved it."""

    uav_id: UavId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class ApproveChange(Record):
    """Puts a proposed change into force. It says again what is approved, so that this is what is signed."""

    change_id: Sha256Hex
    policy: PolicyChange | None = None
    reinstatement: Reinstatement | None = None

    def validate(self, path: str) -> None:
        """It approves one thing."""
        require_one(self.policy, self.reinstatement, path)


@dataclass(frozen=True, kw_only=True, slots=True)
class WithdrawChange(Record):
    """Takes a proposed change back, or turns it down: it can be approved no longer."""

    change_id: Sha256Hex
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class ChangeById(Record):
    """Names a proposed change."""

    change_id: Sha256Hex


@dataclass(frozen=True, kw_only=True, slots=True)
class SetClosures(Record):
    """Says when zones forbid what at a pad, until a time; it replaces what was said before."""

    pad_id: PadId
    closures: Annotated[tuple[Closure, ...], Items(0, MAX_CLOSURES)]
    valid_until_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class RequestProof(Record):
    """Step 1: a drone asks a pad to prove its location."""

    pad_id: PadId
    action: Action
    prekey_id: PrekeyId
    uav_key: PublicKey
    claim: sessions.Claim
    witness_prekey_id: PrekeyId | None = None
    """One of the prekeys of the pad that the policy names as witness; required where it names one."""
    node: NodeAbility | None = None
    """What the drone's node can do: with the pad's nodes it decides the radio plan."""
    priority: sessions.Priority | None = None
    """Left out: none. It is signed, and counted: who claims it too often is served without it (``proofs.queue``)."""
    battery_percent: sessions.BatteryPercent | None = None

    def validate(self, path: str) -> None:
        """A low battery has a figure."""
        if self.priority == "low_battery" and self.battery_percent is None:
            raise RecordError(
                f"{path}.battery_percent" if path else "battery_percent", "low_battery says how much is left"
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class SubmitProof(Record):
    """Step 7: the pad brings its evidence; the contract decides."""

    session_id: SessionId
    evidence: sessions.Evidence


@dataclass(frozen=True, kw_only=True, slots=True)
class WitnessProof(Record):
    """Step 7 for the witness: its own time stamps of the drone's frames, before the pad submits."""

    session_id: SessionId
    radio: sessions.Radio
    time_stamps: sessions.TimeStamps


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteInteraction(Record):
    """Step 8: the drone or the pad says how the permitted interaction ended."""

    session_id: SessionId
    result: Annotated[str, Choice(("done", "aborted"))]
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ReportLanding(Record):
    """A drone says of itself that it came down at a pad without a permission, and who flew it. It changes nothing."""

    pad_id: PadId
    cause: LandingCause
    claim: sessions.Claim


@dataclass(frozen=True, kw_only=True, slots=True)
class GivePrecedence(Record):
    """Puts a waiting request before all others of its pad. A pad itself may do so for an emergency only."""

    session_id: SessionId
    reason: Note


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordDeparture(Record):
    """Says that a drone that had landed has left the pad: the next one may land.

    Not by the drone's own word: it proves its take-off.
    """

    session_id: SessionId
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class ReservePad(Record):
    """Keeps a pad for a drone's landing: by the drone, its operator, or the authority.

    The pad's policy for landings says for how long at most (``reservation_ms``).
    """

    pad_id: PadId
    uav_id: UavId
    from_ms: TimeMs
    until_ms: TimeMs

    def validate(self, path: str) -> None:
        """The span must not be empty."""
        if self.until_ms <= self.from_ms:
            raise RecordError(f"{path}.until_ms" if path else "until_ms", "must be after from_ms")


@dataclass(frozen=True, kw_only=True, slots=True)
class CancelReservation(Record):
    """Gives a reservation up, or takes it: by the drone, its operator, the pad's operator, or the authority."""

    pad_id: PadId
    reservation_id: ReservationId
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class CancelProof(Record):
    """Ends a session that will not be decided: a timeout, a loss, a refusal."""

    session_id: SessionId
    reason: Annotated[str, Text(64, r"[a-z0-9_]+", "For machines, for example timeout", min_length=1)]
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class CreateAsset(Record):
    """Stores a value of any type."""

    id: assets.AssetId
    type: assets.AssetType
    media_type: assets.MediaType
    value: assets.AssetValue


@dataclass(frozen=True, kw_only=True, slots=True)
class UpdateAsset(Record):
    """Replaces the value of an asset; type and media type may change with it."""

    id: assets.AssetId
    value: assets.AssetValue
    type: assets.AssetType | None = None
    media_type: assets.MediaType | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class AssetById(Record):
    """Names an asset: the one to read, or to delete."""

    id: assets.AssetId


@dataclass(frozen=True, kw_only=True, slots=True)
class AssetHistoryOf(Record):
    """Names an asset and how many of its changes to return, newest first."""

    id: assets.AssetId
    limit: Annotated[int, Integer(1, 1_000)] = 100


@dataclass(frozen=True, kw_only=True, slots=True)
class PadById(Record):
    """Names a pad."""

    pad_id: PadId


@dataclass(frozen=True, kw_only=True, slots=True)
class UavById(Record):
    """Names a drone."""

    uav_id: UavId


@dataclass(frozen=True, kw_only=True, slots=True)
class SessionById(Record):
    """Names a session."""

    session_id: SessionId


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyFor(Record):
    """Asks which policy holds for an action at a pad."""

    pad_id: PadId
    action: Action


@dataclass(frozen=True, kw_only=True, slots=True)
class PrekeysOf(Record):
    """Asks for unused prekeys of a pad."""

    pad_id: PadId
    limit: Annotated[int, Integer(1, 100)] = 10


@dataclass(frozen=True)
class Transaction:
    """One transaction of the contract."""

    name: str
    argument: type[Record]
    roles: tuple[str, ...]
    """Who may send it; the contract checks in addition whose pad, drone, session or asset it is."""
    event: str = ""
    """Name of the event; empty for queries, which change nothing."""


def _all(*entries: Transaction) -> dict[str, Transaction]:
    return {entry.name: entry for entry in entries}


TRANSACTIONS: Final = _all(
    Transaction("RegisterPad", RegisterPad, (ADMIN, PAD_OPERATOR), "PadRegistered"),
    Transaction("UpdatePad", UpdatePad, (ADMIN, PAD_OPERATOR), "PadUpdated"),
    Transaction("RetirePad", RetirePad, (ADMIN, PAD_OPERATOR), "PadRetired"),
    Transaction("CommissionPad", CommissionPad, (ADMIN, PAD_OPERATOR), "PadCommissioned"),
    Transaction("SetSitePlan", SetSitePlan, (ADMIN, PAD_OPERATOR), "SitePlanSet"),
    Transaction("PublishPrekeys", PublishPrekeys, (PAD,), "PrekeysPublished"),
    Transaction("RegisterUav", RegisterUav, (ADMIN, FLEET_OPERATOR), "UavRegistered"),
    Transaction("SetUavStatus", SetUavStatus, (ADMIN, INSPECTOR, FLEET_OPERATOR), "UavStatusSet"),
    Transaction("GrantAuthorisation", GrantAuthorisation, (ADMIN, INSPECTOR), "AuthorisationGranted"),
    Transaction("RevokeAuthorisation", RevokeAuthorisation, (ADMIN, INSPECTOR), "AuthorisationRevoked"),
    Transaction("RecordMaintenance", RecordMaintenance, (ADMIN, FLEET_OPERATOR), "MaintenanceRecorded"),
    Transaction("CalibrateUav", CalibrateUav, (ADMIN, INSPECTOR, PAD_OPERATOR), "UavCalibrated"),
    Transaction(
        "WithdrawCalibration",
        WithdrawCalibration,
        (ADMIN, INSPECTOR, PAD_OPERATOR, FLEET_OPERATOR),
        "CalibrationWithdrawn",
    ),
    Transaction("ProposePolicy", ProposePolicy, (ADMIN,), "ChangeProposed"),
    Transaction("ProposeReinstatement", ProposeReinstatement, (ADMIN, INSPECTOR), "ChangeProposed"),
    Transaction("ApproveChange", ApproveChange, (ADMIN, INSPECTOR), "ChangeApproved"),
    Transaction("WithdrawChange", WithdrawChange, (ADMIN, INSPECTOR), "ChangeWithdrawn"),
    Transaction("SetClosures", SetClosures, (ADMIN,), "ClosuresSet"),
    Transaction("RequestProof", RequestProof, (UAV,), "ProofRequested"),
    Transaction("WitnessProof", WitnessProof, (PAD,), "ProofWitnessed"),
    Transaction("SubmitProof", SubmitProof, (PAD,), "ProofDecided"),
    Transaction("CompleteInteraction", CompleteInteraction, (PAD, UAV), "InteractionCompleted"),
    Transaction("ReportLanding", ReportLanding, (UAV,), "LandingReported"),
    Transaction("CancelProof", CancelProof, (PAD, UAV, PAD_OPERATOR, ADMIN), "ProofCancelled"),
    Transaction("GivePrecedence", GivePrecedence, (PAD, PAD_OPERATOR, ADMIN), "PrecedenceGiven"),
    Transaction("RecordDeparture", RecordDeparture, (PAD, PAD_OPERATOR, ADMIN), "DepartureRecorded"),
    Transaction("ReservePad", ReservePad, (UAV, FLEET_OPERATOR, ADMIN), "PadReserved"),
    Transaction(
        "CancelReservation", CancelReservation, (UAV, FLEET_OPERATOR, PAD_OPERATOR, ADMIN), "ReservationCancelled"
    ),
    Transaction("CreateAsset", CreateAsset, ROLES, "AssetCreated"),
    Transaction("UpdateAsset", UpdateAsset, ROLES, "AssetUpdated"),
    Transaction("DeleteAsset", AssetById, ROLES, "AssetDeleted"),
    Transaction("AnchorAuditLog", AnchorAuditLog, (MIRROR,), "AuditLogAnchored"),
    Transaction("ReadAsset", AssetById, ROLES),
    Transaction("AssetHistory", AssetHistoryOf, ROLES),
    Transaction("ReadPad", PadById, ROLES),
    Transaction("ReadUav", UavById, ROLES),
    Transaction("ReadSession", SessionById, ROLES),
    Transaction("ReadVerdict", SessionById, ROLES),
    Transaction("ReadTestimony", SessionById, ROLES),
    Transaction("ReadPolicy", PolicyFor, ROLES),
    Transaction("ReadChange", ChangeById, ROLES),
    Transaction("ReadClosures", PadById, ROLES),
    Transaction("ReadReservations", PadById, ROLES),
    Transaction("ListPrekeys", PrekeysOf, ROLES),
    Transaction("ListAuditHeads", AuditHeadsOf, ROLES),
)
