"""Bodies of records, one struct for each kind. Integers only; units are in the names. None of it is verified."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal

from msgspec import Meta
from msgspec.structs import force_setattr

from wonderland.proofs.records.sessions import MAX_ROUNDS
from wonderland.telemetry.fields import (
    Above,
    AboveMm,
    AccuracyMm,
    AnchorCondition,
    AnchorId,
    Count,
    DescriptionName,
    DriftCondition,
    FindingKind,
    HeightMm,
    LatE7,
    Length,
    LocalMm,
    LonE7,
    Message,
    Mm2,
    OperatorPlace,
    Ppm,
    Seq,
    SessionId,
    ShiftMm,
    Some,
    StepName,
    Text23,
    Text24,
    Text32,
    Text64,
    Text200,
    Text500,
    TimeMs,
    TxId,
    UavId,
    said,
)
from wonderland_remote_id.operators import public_operator_id


class Drip(Message, frozen=True, kw_only=True):
    """Who signed a drone's broadcasts (DRIP, RFC 9575), as far as the pad could verify it."""

    state: Literal["verified", "endorsed", "unknown_signer", "refused"]
    format: Literal["link", "wrapper", "manifest", "frame"]
    det: Annotated[str, Meta(pattern=r"^[0-9a-f:]{2,39}\Z", description="The drone's entity tag (RFC 9374)")]
    t_ms: TimeMs
    covers_location: Annotated[bool, Meta(description="A position that was heard is among what is signed")] = said(
        value=False
    )
    bound: Annotated[bool, Meta(description="The identity that the drone is heard under is `det`")] = said(value=False)
    signer: Text64 | None = None
    reason: Annotated[Text200, Meta(description="Why it is refused")] | None = None

    def __post_init__(self) -> None:
        """Take no Link for more than it is: anybody can repeat one, so that it endorses a key and verifies nothing."""
        if self.format == "link" and self.state == "verified":
            force_setattr(self, "state", "endorsed")


class Signature(Drip, frozen=True, kw_only=True):
    """The strongest that was signed during a session."""

    refused: Annotated[Some, Meta(description="Authentication messages that were refused besides")] = 0


class Track(Message, frozen=True, kw_only=True):
    """A Remote ID position that a pad heard, with what the drone broadcast beside it."""

    KIND: ClassVar = "track"

    uav_id: UavId
    lat_e7: LatE7
    lon_e7: LonE7
    transport: Annotated[Text24, Meta(description="How it was heard")]
    height_mm: HeightMm | None = None
    accuracy_mm: AccuracyMm | None = None
    speed_mm_s: Annotated[int, Meta(ge=0, le=1_000_000)] | None = None
    track_cdeg: Annotated[int, Meta(ge=0, le=36_000, description="Course over ground, clockwise from north")] | None = (
        None
    )
    vertical_mm_s: Annotated[int, Meta(ge=-1_000_000, le=1_000_000, description="Up")] | None = None
    status: Text32 | None = None
    operator_id: Annotated[Text64, Meta(description="The operator's number without its secret ending")] | None = None
    claim_t_ms: Annotated[TimeMs, Meta(description="When it was taken, by the message's own time")] | None = None
    rssi: Annotated[int, Meta(ge=-200, le=100, description="Signal strength in dBm")] | None = None
    latency_ms: (
        Annotated[int, Meta(ge=-3_600_000, le=3_600_000, description="Heard so long after `claim_t_ms`")] | None
    ) = None
    lost: Annotated[Some, Meta(description="Frames missed so far, by gaps in the transports' counters")] | None = None
    duplicates: Annotated[Some, Meta(description="Positions heard again so far")] | None = None
    transports: (
        Annotated[
            tuple[Text24, ...],
            Meta(max_length=8, description="Where several: those over which it was heard in the last ten seconds"),
        ]
        | None
    ) = None
    drip: Drip | None = None
    description: Annotated[Text23, Meta(description="What the operator says: anybody's text")] | None = None
    description_type: DescriptionName | None = None
    area_count: (
        Annotated[int, Meta(ge=2, le=65_535, description="Aircraft under this identity, where several")] | None
    ) = None
    area_radius_mm: Annotated[int, Meta(ge=0, le=2_550_000)] | None = None
    area_ceiling_mm: AboveMm | None = None
    area_floor_mm: AboveMm | None = None
    ua_type: Annotated[int, Meta(ge=0, le=15, description="Type of aircraft, ASTM F3411's number")] | None = None
    height_accuracy_mm: Annotated[int, Meta(ge=0, le=1_000_000, description="95 %")] | None = None
    above_mm: AboveMm | None = None
    above: Annotated[Above, Meta(description="What `above_mm` is measured from")] | None = None
    pressure_mm: Annotated[AboveMm, Meta(description="Altitude against 1013.25 hPa")] | None = None
    speed_accuracy_mm_s: Annotated[int, Meta(ge=0, le=1_000_000)] | None = None
    time_accuracy_ms: Annotated[int, Meta(ge=0, le=60_000)] | None = None
    eu_category: Annotated[int, Meta(ge=0, le=3, description="ASTM F3411's number")] | None = None
    eu_class: Annotated[int, Meta(ge=0, le=7, description="ASTM F3411's number")] | None = None
    operator_lat_e7: LatE7 | None = None
    operator_lon_e7: LonE7 | None = None
    operator_height_mm: HeightMm | None = None
    operator_place: Annotated[OperatorPlace, Meta(description="What the operator's position is")] | None = None

    def __post_init__(self) -> None:
        """Take the operator's secret off once more: a pad has, and whatever comes with it goes no further than here."""
        if self.operator_id:
            force_setattr(self, "operator_id", public_operator_id(self.operator_id))


FOR_USPACE: Final = frozenset(
    {
        "above_mm", "above", "pressure_mm", "speed_accuracy_mm_s", "time_accuracy_ms", "eu_category", "eu_class",
        "operator_lat_e7", "operator_lon_e7", "operator_height_mm", "operator_place",
    }
)  # fmt: skip
"""Fields of a track that only U-space is told: taken in and passed on, never stored or shown."""


class Position(Message, frozen=True, kw_only=True):
    """Where a drone's own agent says that it is: for Network Remote ID, passed on and never stored."""

    KIND: ClassVar = "position"

    lat_e7: LatE7
    lon_e7: LonE7
    height_mm: HeightMm
    accuracy_mm: AccuracyMm
    height_accuracy_mm: AccuracyMm
    claim_t_ms: Annotated[TimeMs, Meta(description="When it was there")]


class Finding(Message, frozen=True, kw_only=True):
    """Something odd about a drone's broadcasts (docs/remote-id.md); never part of a verdict."""

    KIND: ClassVar = "finding"

    uav_id: UavId
    kind: FindingKind
    count: Annotated[
        int, Meta(ge=1, le=2**53 - 1, description="How often it was seen since the last time that it was told")
    ] = said(1)
    lat_e7: LatE7 | None = None
    lon_e7: LonE7 | None = None
    other_lat_e7: LatE7 | None = None
    other_lon_e7: LonE7 | None = None
    transport: Text24 | None = None
    other_transport: Text24 | None = None
    distance_mm: Length | None = None
    interval_ms: Length | None = None
    other_uav_id: UavId | None = None


class Estimate(Message, frozen=True, kw_only=True):
    """A running estimate of a session: for people to watch."""

    KIND: ClassVar = "estimate"

    session_id: SessionId
    uav_id: UavId
    lat_e7: LatE7
    lon_e7: LonE7
    east_mm: LocalMm
    north_mm: LocalMm
    ee_mm2: Annotated[Mm2, Meta(description="Covariance, east with east")]
    en_mm2: Annotated[Mm2, Meta(description="East with north")]
    nn_mm2: Annotated[Mm2, Meta(description="North with north")]
    rounds: Annotated[int, Meta(ge=0, le=MAX_ROUNDS)]
    likelihood_ppm: Ppm
    ranges: Annotated[
        dict[AnchorId, Annotated[int, Meta(ge=-1, le=1_000_000)]],
        Meta(max_length=16, description="The latest range by anchor in mm; −1: none"),
    ]
    truth_east_mm: (
        Annotated[LocalMm, Meta(description="Where a reference has the drone then: motion capture")] | None
    ) = None
    truth_north_mm: LocalMm | None = None


class Step(Message, frozen=True, kw_only=True):
    """A step of a proof that was reached, or failed. Evidence: the spool never drops it."""

    KIND: ClassVar = "step"

    session_id: SessionId
    uav_id: UavId
    step: StepName
    t_ms: TimeMs
    ok: bool
    detail: Text500 | None = None


class EndStep(Message, frozen=True, kw_only=True):
    """A step in the summary of an ended session."""

    step: StepName
    t_ms: TimeMs
    ok: bool = True
    detail: Text500 | None = None


class SessionEnd(Message, frozen=True, kw_only=True):
    """How a session ended. Evidence: the spool never drops it."""

    KIND: ClassVar = "session_end"

    session_id: SessionId
    state: Annotated[Text32, Meta(description="The ledger's state of it, as the agent knows it")]
    steps: Annotated[tuple[EndStep, ...], Meta(max_length=32)]
    end: Annotated[Text64, Meta(description="How, in one word for machines")] | None = None
    tx_id: TxId | None = None
    signature: Annotated[Signature | None, Meta(description="Of pads only")] = None


class AnchorHealth(Message, frozen=True, kw_only=True):
    """How an anchor does. ``down``: its port or node is away; ``silent``: it answers, and ranges nothing."""

    anchor_id: AnchorId
    state: AnchorCondition
    firmware: Text64 | None = None
    detail: Annotated[Text200, Meta(description="Why it is not up, in the agent's words")] | None = None


class SpoolHealth(Message, frozen=True, kw_only=True):
    """What waits on the agent's disk."""

    records: Count
    bytes: Count
    dropped: Annotated[Count, Meta(description="Records dropped since the spool was made")]


class ReceiverHealth(Message, frozen=True, kw_only=True):
    """Remote ID frames heard since the start."""

    frames: Count
    bad: Count


class Drift(Message, frozen=True, kw_only=True):
    """Whether the anchors stand as they were commissioned, by the ranges that they measure to each other."""

    state: DriftCondition
    checked_ms: TimeMs
    looks: Count
    since_ms: TimeMs | None = None
    anchor_id: Annotated[AnchorId, Meta(description="The anchor that explains it best")] | None = None
    off_mm: ShiftMm | None = None
    sigma_mm: ShiftMm | None = None
    common_mm: Annotated[int, Meta(ge=-100_000, le=100_000, description="Change that all pairs share")] | None = None
    extra_sigma_mm: (
        Annotated[int, Meta(ge=0, le=200_000, description="Uncertainty that each range gets for it")] | None
    ) = None


class Health(Message, frozen=True, kw_only=True):
    """An agent's word on itself."""

    KIND: ClassVar = "health"

    anchors: Annotated[tuple[AnchorHealth, ...], Meta(max_length=16)] = said(())
    spool: SpoolHealth | None = None
    receiver: ReceiverHealth | None = None
    prekeys: Annotated[int, Meta(ge=0, le=1_000_000, description="Prekeys left on the ledger")] | None = None
    version: Text64 | None = None
    drift: Annotated[Drift | None, Meta(description="Missing until the anchors first ranged each other")] = None


class Dropped(Message, frozen=True, kw_only=True):
    """A gap in a spool: telemetry that its quota dropped. Its own number is `to_seq`."""

    KIND: ClassVar = "dropped"

    from_seq: Seq
    to_seq: Seq


Body = Track | Position | Finding | Estimate | Step | SessionEnd | Health | Dropped
