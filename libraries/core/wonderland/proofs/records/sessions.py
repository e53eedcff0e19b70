"""A session: the request, the evidence that the pad gathered, and its state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.fields import (
    MAX_TIME_MS,
    Action,
    AnchorId,
    HeightMm,
    LatE7,
    LonE7,
    MspId,
    Name,
    Note,
    PadId,
    PrekeyId,
    PublicKey,
    SessionId,
    Sha256Hex,
    TimeMs,
    UavId,
)
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.schema import Binary, Choice, Integer, Items, Record, Text

MAX_ROUNDS = 500
MAX_CLAIMS = 200
MAX_ATTESTED = 64
MAX_ATTEMPTED = 100_000
NO_RANGE = -1
MAX_FRAMES = 500
NO_TICK = -1
TICKS_PER_SECOND = 63_897_600_000
"""Rate of the time stamps: 128 × 499.2 MHz, 15.65 ps and 4.69 mm of light each."""

STATES = ("requested", "decided", "completed", "cancelled")
STEP_NAMES = ("request", "poll", "match", "reply", "range", "confirm", "verdict", "permission")
"""The paper's eight steps (section 3), in order."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Claim(Record):
    """Where a drone says that it is, when, and how well it thinks it knows."""

    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm
    accuracy_mm: Annotated[int, Integer(1, 10_000_000, "Horizontal accuracy, 95 %")]
    height_accuracy_mm: Annotated[int, Integer(1, 10_000_000, "Vertical accuracy, 95 %")]
    t_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class BroadcastClaim(Record):
    """A Remote ID position as the pad heard it; ``t_ms`` is when it was heard, by the pad's clock."""

    lat_e7: LatE7
    lon_e7: LonE7
    t_ms: TimeMs
    height_mm: HeightMm | None = None
    accuracy_mm: Annotated[int, Integer(1, 10_000_000, "Broadcast horizontal accuracy, 95 %")] | None = None
    transport: Annotated[str, Text(24, r"[a-z0-9_-]*", "How it was heard")] | None = None
    said_ms: (
        Annotated[int, Integer(0, MAX_TIME_MS, "When the position was taken, by the message itself, to a tenth")] | None
    ) = None


@dataclass(frozen=True, kw_only=True, slots=True)
class AnchorRanges(Record):
    """What one anchor measured, a value a round; −1 where it heard nothing usable."""

    anchor_id: AnchorId
    range_mm: Annotated[tuple[int, ...], Items(0, MAX_ROUNDS, of=Integer(NO_RANGE, 1_000_000))]
    nlos: Annotated[
        tuple[int, ...], Items(0, MAX_ROUNDS, "Rounds in which it saw an obstruction", of=Integer(0, MAX_ROUNDS))
    ] = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class RangeTable(Record):
    """All rounds of a session: when (by the pad's clock) and what each anchor measured."""

    t_ms: Annotated[tuple[int, ...], Items(0, MAX_ROUNDS, of=Integer(0, 253_402_300_799_999))]
    anchors: Annotated[tuple[AnchorRanges, ...], Items(0, 16)]

    def validate(self, path: str) -> None:
        """Columns must have one value for each round."""
        prefix = f"{path}." if path else ""
        for index, anchor in enumerate(self.anchors):
            if len(anchor.range_mm) != len(self.t_ms):
                raise RecordError(
                    f"{prefix}anchors[{index}].range_mm", f"{len(anchor.range_mm)} values for {len(self.t_ms)} rounds"
                )
        if len({anchor.anchor_id for anchor in self.anchors}) != len(self.anchors):
            raise RecordError(f"{prefix}anchors", "an anchor appears twice")


@dataclass(frozen=True, kw_only=True, slots=True)
class AnchorTicks(Record):
    """When one anchor heard each frame: ticks after the first anchor that heard it; −1 where it did not."""

    anchor_id: AnchorId
    ticks: Annotated[tuple[int, ...], Items(0, MAX_FRAMES, of=Integer(NO_TICK, 2**24))]


BOUND_BY = ("challenge", "key", "none")


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeStamps(Record):
    """Frames of the drone that a pad's nodes time-stamped on one clock (63.8976 GHz); the drone's has no part in it."""

    start_ms: TimeMs
    gap_ms: Annotated[
        tuple[int, ...],
        Items(
            0,
            MAX_FRAMES,
            "Since the frame before, or since ``start_ms``, by the pad's clock",
            of=Integer(0, 2**24),
        ),
    ]
    anchors: Annotated[tuple[AnchorTicks, ...], Items(0, 16)]
    bound_by: Annotated[
        str,
        Choice(
            BOUND_BY,
            "What ties these frames to the session: the answer to the pad's challenge in each, a time-stamp sequence "
            "keyed for this session, or nothing",
        ),
    ]

    @property
    def end_ms(self) -> int:
        """When the last frame was heard."""
        total = self.start_ms
        for gap_ms in self.gap_ms:
            total += gap_ms
        return total

    def validate(self, path: str) -> None:
        """Columns must have one value for each frame, and each anchor one column."""
        prefix = f"{path}." if path else ""
        for index, anchor in enumerate(self.anchors):
            if len(anchor.ticks) != len(self.gap_ms):
                raise RecordError(
                    f"{prefix}anchors[{index}].ticks", f"{len(anchor.ticks)} values for {len(self.gap_ms)} frames"
                )
        if len({anchor.anchor_id for anchor in self.anchors}) != len(self.anchors):
            raise RecordError(f"{prefix}anchors", "an anchor appears twice")


@dataclass(frozen=True, kw_only=True, slots=True)
class ClockReading(Record):
    """The drone's clock as the pad saw it: it said ``uav_ms`` after ``asked_ms`` and before ``heard_ms``, the pad's."""

    uav_ms: TimeMs
    heard_ms: TimeMs
    asked_ms: Annotated[int, Integer(0, MAX_TIME_MS, "When the pad asked; left out where it did not ask")] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Radio(Record):
    """How the ranges came about: what the assurance of a verdict can rest on."""

    measured_by: Annotated[str, Choice(("pad", "uav"), "Whose nodes computed the ranges")]
    sts: Annotated[
        str,
        Choice(
            ("unbound", "static", "provisioned"),
            "Scrambled time-stamp sequence: public, or keyed per session; unbound: there is none, and the words go "
            "another way, so that nothing on the air ties the ranges to the session",
        ),
    ]
    firmware: Annotated[str, Text(64, description="Firmware of the pad's nodes")] | None = None
    attempted_rounds: (
        Annotated[
            int,
            Integer(
                0,
                MAX_ATTEMPTED,
                "Rounds of the pad's nodes in which somebody might have measured: those of the table, and those in "
                "which nobody did. Left out where the drone measures",
            ),
        ]
        | None
    ) = None


@dataclass(frozen=True, kw_only=True, slots=True)
class StepTime(Record):
    """When a step of the proof was completed, by the clock of the one who reports it."""

    step: Annotated[str, Choice(STEP_NAMES)]
    t_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence(Record):
    """What a pad brings before the contract."""

    ranges: RangeTable
    claims: Annotated[tuple[Claim, ...], Items(0, MAX_CLAIMS, "Claims that the drone sent over UWB, in order of time")]
    broadcast: Annotated[tuple[BroadcastClaim, ...], Items(0, MAX_CLAIMS, "What the pad heard on Remote ID")]
    matched: Annotated[str, Choice(("both", "none"), "Whether the session codes matched, on both sides")]
    radio: Radio
    steps: Annotated[tuple[StepTime, ...], Items(0, 16)]
    uav_signature: (
        Annotated[str, Binary(64, 64, "The drone's signature (r, s) over the statement of step 6")] | None
    ) = None
    failure: Annotated[str, Text(64, r"[a-z0-9_]+", "Why the session stopped early, if it did")] | None = None
    time_stamps: TimeStamps | None = None
    clock: Annotated[tuple[ClockReading, ...], Items(0, 16, "The drone's clock against the pad's")] = ()
    attested: Annotated[
        tuple[str, ...],
        Items(
            0,
            MAX_ATTESTED,
            "Digests of the Remote ID positions that the drone sent in this session, as it countersigned them",
            of=Binary(8, 8),
        ),
    ] = ()
    drift_sigma_mm: (
        Annotated[int, Integer(1, 10_000, "What the pad adds to where each anchor stands: it has drifted")] | None
    ) = None

    def validate(self, path: str) -> None:
        """No more rounds than were attempted."""
        attempted, rounds = self.radio.attempted_rounds, len(self.ranges.t_ms)
        if attempted is not None and attempted < rounds:
            prefix = f"{path}." if path else ""
            raise RecordError(f"{prefix}radio.attempted_rounds", f"{attempted}, but the table has {rounds} rounds")


@dataclass(frozen=True, kw_only=True, slots=True)
class Party(Record):
    """Who took part: organisation, certificate and its key."""

    msp_id: MspId
    certificate_sha256: Sha256Hex
    public_key: PublicKey | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class LastRequest(Record):
    """When a drone last asked a pad, where its policy sets a gap between requests."""

    session_id: SessionId
    requested_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class Witness(Record):
    """The second pad that shall time-stamp the drone: the policy names it, the request consumes one of its prekeys."""

    pad_id: PadId
    prekey_id: PrekeyId
    pad_key: PublicKey
    party: Party
    commissioning_sha256: Sha256Hex


@dataclass(frozen=True, kw_only=True, slots=True)
class Testimony(Record):
    """What a witness brought: the same drone, time-stamped by the nodes of another pad, in its own transaction."""

    session_id: SessionId
    pad_id: PadId
    msp_id: MspId
    certificate_sha256: Sha256Hex
    commissioning_sha256: Sha256Hex
    radio: Radio
    time_stamps: TimeStamps
    testified_ms: TimeMs


Priority = Annotated[str, Choice(("low_battery", "emergency"), "Why it should not have to wait, by its own word")]
BatteryPercent = Annotated[int, Integer(0, 100, "What its battery has left, by its own word")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Precedence(Record):
    """Who put a waiting drone before all others, when and why."""

    by: Annotated[str, Choice(("pad", "operator", "authority"))]
    name: Name
    reason: Note
    t_ms: TimeMs


@dataclass(frozen=True, kw_only=True, slots=True)
class Departure(Record):
    """Who says that a drone that had landed has left the pad."""

    by: Annotated[str, Choice(("pad", "operator", "authority"))]
    name: Name
    t_ms: TimeMs
    note: Note | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Session(Record):
    """A proof under way or ended."""

    session_id: SessionId
    state: Annotated[str, Choice(STATES)]
    pad_id: PadId
    uav_id: UavId
    action: Action
    claim: Claim
    prekey_id: PrekeyId
    pad_key: PublicKey
    uav_key: PublicKey
    pad: Party
    uav: Party
    commissioning_sha256: Sha256Hex
    contract_version: Annotated[
        str, Text(32, r"[0-9A-Za-z.+-]+", "Version of the contract that took the request", min_length=1)
    ]
    transcript_sha256: Sha256Hex
    policy: Policy
    requested_ms: TimeMs
    expires_ms: TimeMs
    decided_ms: TimeMs | None = None
    ended_ms: TimeMs | None = None
    end: Annotated[str, Text(64, r"[a-z0-9_]+", "How it ended")] | None = None
    ended_by: Annotated[str, Choice(("pad", "uav", "operator", "authority"))] | None = None
    note: Note | None = None
    witness: Witness | None = None
    site_plan_sha256: Sha256Hex | None = None
    node: NodeAbility | None = None
    """What the drone's node can do, as it said with its request."""
    calibration: DroneOffset | None = None
    """What its node adds to every range; without it the drone is judged with what is known of nodes in general."""
    priority: Priority | None = None
    battery_percent: BatteryPercent | None = None
    precedence: Precedence | None = None
    departure: Departure | None = None
