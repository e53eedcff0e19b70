"""What agents send, checked strictly: no unknown fields, no floats, every number and text bounded."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, field_validator, model_validator

from wonderland.proofs.records import fields
from wonderland.proofs.records.schema import Integer, Text
from wonderland.proofs.records.sessions import MAX_ROUNDS
from wonderland.remote_id.operators import public_operator_id

PROTOCOL: Final = "wonderland-ingest/1"
MAX_SEQ: Final = 2**53 - 1
_PLAIN: Final = r"^[^\x00-\x1f\x7f]*$"


class IngestError(Exception):
    """A frame or record that is not as it must be. `code` is for machines."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


def _text(check: Any) -> Any:
    """A record's text field for pydantic."""
    (spec,) = [each for each in check.__metadata__ if isinstance(each, Text)]
    bounds = Field(min_length=spec.min_length, max_length=spec.max_length, pattern=f"^(?:{spec.pattern})$")
    return Annotated[str, bounds]


def _integer(check: Any) -> Any:
    (spec,) = [each for each in check.__metadata__ if isinstance(each, Integer)]
    return Annotated[int, Field(ge=spec.minimum, le=spec.maximum)]


def _between(minimum: int, maximum: int) -> Any:
    return Annotated[int, Field(ge=minimum, le=maximum)]


def _plain(limit: int) -> Any:
    return Annotated[str, Field(max_length=limit, pattern=_PLAIN)]


_UavId = _text(fields.UavId)
_PadId = _text(fields.PadId)
_AnchorId = _text(fields.AnchorId)
_SessionId = _text(fields.SessionId)
_TimeMs = _integer(fields.TimeMs)
_LatE7 = _integer(fields.LatE7)
_LonE7 = _integer(fields.LonE7)
_HeightMm = _integer(fields.HeightMm)
_LocalMm = _integer(fields.LocalMm)
_Ppm = _integer(fields.Ppm)
_Mm2 = _between(-(2**52), 2**52)


class Hello(_Strict):
    """Who an agent is, and the proof that it holds its ledger key."""

    type: Literal["hello"]
    protocol: Literal["wonderland-ingest/1"]
    agent: Literal["pad", "uav"]
    id: Annotated[str, Field(min_length=1, max_length=64, pattern=f"^(?:{fields.ID_PATTERN})$")]
    spool: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    msp_id: _text(fields.MspId)  # type: ignore[valid-type]
    certificate: Annotated[str, Field(min_length=1, max_length=16_384)]
    signature: Annotated[str, Field(min_length=8, max_length=128, pattern="^[A-Za-z0-9_-]*$")]
    takes: list[Literal["please_prove"]] = Field(default_factory=list, max_length=1)
    """Messages besides those of the protocol's beginning that the agent understands."""


class Answer(_Strict):
    """Whether a drone's agent will do what it was asked (``please_prove``)."""

    type: Literal["answer"]
    request_id: Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
    accepted: bool
    text: _plain(300) = ""  # type: ignore[valid-type]


class Entry(_Strict):
    """One record of a spool; its body is checked by its kind, so that a bad one is refused alone."""

    seq: _between(1, MAX_SEQ)  # type: ignore[valid-type]
    kind: _plain(32)  # type: ignore[valid-type]
    t_ms: _TimeMs  # type: ignore[valid-type]
    body: dict[str, Any]


class Records(_Strict):
    """A batch of a spool's records, in order."""

    type: Literal["records"]
    records: list[dict[str, Any]]


class DripBody(_Strict):
    """Who signed a drone's broadcasts (DRIP, RFC 9575), as far as the pad could verify it."""

    state: Literal["verified", "endorsed", "unknown_signer", "refused"]
    det: Annotated[str, Field(pattern="^[0-9a-f:]{2,39}$")]
    format: Literal["link", "wrapper", "manifest", "frame"]
    t_ms: _TimeMs  # type: ignore[valid-type]
    signer: _plain(64) | None = None  # type: ignore[valid-type]
    reason: _plain(200) | None = None  # type: ignore[valid-type]
    covers_location: bool = False
    bound: bool = False

    @model_validator(mode="before")
    @classmethod
    def _link_proves_nothing(cls, body: Any) -> Any:
        """Pads of before 0.2 called an endorsement that they heard verified."""
        if isinstance(body, dict) and body.get("format") == "link" and body.get("state") == "verified":
            return body | {"state": "endorsed"}
        return body


class SignatureBody(DripBody):
    """Who signed during a session, and how many authentication messages were refused in it."""

    refused: _between(0, MAX_SEQ) = 0  # type: ignore[valid-type]


class TrackBody(_Strict):
    """A Remote ID position heard."""

    uav_id: _UavId  # type: ignore[valid-type]
    lat_e7: _LatE7  # type: ignore[valid-type]
    lon_e7: _LonE7  # type: ignore[valid-type]
    transport: _plain(24)  # type: ignore[valid-type]
    height_mm: _HeightMm | None = None  # type: ignore[valid-type]
    accuracy_mm: _between(0, 100_000_000) | None = None  # type: ignore[valid-type]
    speed_mm_s: _between(0, 1_000_000) | None = None  # type: ignore[valid-type]
    track_cdeg: _between(0, 36_000) | None = None  # type: ignore[valid-type]
    vertical_mm_s: _between(-1_000_000, 1_000_000) | None = None  # type: ignore[valid-type]
    status: _plain(32) | None = None  # type: ignore[valid-type]
    operator_id: _plain(64) | None = None  # type: ignore[valid-type]
    claim_t_ms: _TimeMs | None = None  # type: ignore[valid-type]
    rssi: _between(-200, 100) | None = None  # type: ignore[valid-type]
    latency_ms: _between(-3_600_000, 3_600_000) | None = None  # type: ignore[valid-type]
    lost: _between(0, MAX_SEQ) | None = None  # type: ignore[valid-type]
    duplicates: _between(0, MAX_SEQ) | None = None  # type: ignore[valid-type]
    transports: Annotated[list[_plain(24)], Field(max_length=8)] | None = None  # type: ignore[valid-type]
    drip: DripBody | None = None
    description: _plain(23) | None = None  # type: ignore[valid-type]
    description_type: Literal["text", "emergency", "extended_status", "private"] | None = None
    area_count: _between(2, 65_535) | None = None  # type: ignore[valid-type]
    area_radius_mm: _between(0, 2_550_000) | None = None  # type: ignore[valid-type]
    area_ceiling_mm: _between(-2_000_000, 100_000_000) | None = None  # type: ignore[valid-type]
    area_floor_mm: _between(-2_000_000, 100_000_000) | None = None  # type: ignore[valid-type]
    ua_type: _between(0, 15) | None = None  # type: ignore[valid-type]
    height_accuracy_mm: _between(0, 1_000_000) | None = None  # type: ignore[valid-type]
    # For U-space only (backend/uspace): taken in, passed on, never stored.
    above_mm: _between(-2_000_000, 100_000_000) | None = None  # type: ignore[valid-type]
    above: Literal["takeoff", "ground"] | None = None
    pressure_mm: _between(-2_000_000, 100_000_000) | None = None  # type: ignore[valid-type]
    speed_accuracy_mm_s: _between(0, 1_000_000) | None = None  # type: ignore[valid-type]
    time_accuracy_ms: _between(0, 60_000) | None = None  # type: ignore[valid-type]
    eu_category: _between(0, 3) | None = None  # type: ignore[valid-type]
    eu_class: _between(0, 7) | None = None  # type: ignore[valid-type]
    operator_lat_e7: _LatE7 | None = None  # type: ignore[valid-type]
    operator_lon_e7: _LonE7 | None = None  # type: ignore[valid-type]
    operator_height_mm: _HeightMm | None = None  # type: ignore[valid-type]
    operator_place: Literal["takeoff", "live_gnss", "fixed"] | None = None

    @field_validator("operator_id")
    @classmethod
    def _without_secret(cls, text: str | None) -> str | None:
        """A pad has taken the secret characters off; whatever comes with them goes no further than here."""
        return public_operator_id(text) if text else text


USPACE_ONLY: Final[set[str]] = {
    "above_mm", "above", "pressure_mm", "speed_accuracy_mm_s", "time_accuracy_ms", "eu_category",
    "eu_class", "operator_lat_e7", "operator_lon_e7", "operator_height_mm", "operator_place",
}  # fmt: skip


class PositionBody(_Strict):
    """Where a drone's own agent says that it is: for Network Remote ID, passed on and never stored."""

    lat_e7: _LatE7  # type: ignore[valid-type]
    lon_e7: _LonE7  # type: ignore[valid-type]
    claim_t_ms: _TimeMs  # type: ignore[valid-type]
    height_mm: _HeightMm  # type: ignore[valid-type]
    accuracy_mm: _between(0, 100_000_000)  # type: ignore[valid-type]
    height_accuracy_mm: _between(0, 100_000_000)  # type: ignore[valid-type]

    def heard(self, uav_id: str) -> TrackBody:
        """As what pads hear. Raises `IngestError` for an agent whose id no drone can have."""
        said = self.model_dump() | {"height_accuracy_mm": min(self.height_accuracy_mm, 1_000_000)}
        try:
            return TrackBody(uav_id=uav_id, transport="network", **said)
        except ValidationError as cause:
            raise IngestError("bad_body", _first(cause)) from None


class FindingBody(_Strict):
    """Something odd about a drone's broadcasts."""

    uav_id: _UavId  # type: ignore[valid-type]
    kind: Literal[
        "two_places",
        "impossible_speed",
        "time_stuck",
        "time_backwards",
        "time_off",
        "several_identities",
        "rate_high",
        "signature_bad",
    ]
    count: _between(1, MAX_SEQ) = 1  # type: ignore[valid-type]
    lat_e7: _LatE7 | None = None  # type: ignore[valid-type]
    lon_e7: _LonE7 | None = None  # type: ignore[valid-type]
    other_lat_e7: _LatE7 | None = None  # type: ignore[valid-type]
    other_lon_e7: _LonE7 | None = None  # type: ignore[valid-type]
    transport: _plain(24) | None = None  # type: ignore[valid-type]
    other_transport: _plain(24) | None = None  # type: ignore[valid-type]
    distance_mm: _between(0, 2**40) | None = None  # type: ignore[valid-type]
    interval_ms: _between(0, 2**40) | None = None  # type: ignore[valid-type]
    other_uav_id: _UavId | None = None  # type: ignore[valid-type]


class EstimateBody(_Strict):
    """A running estimate of a session."""

    session_id: _SessionId  # type: ignore[valid-type]
    uav_id: _UavId  # type: ignore[valid-type]
    lat_e7: _LatE7  # type: ignore[valid-type]
    lon_e7: _LonE7  # type: ignore[valid-type]
    east_mm: _LocalMm  # type: ignore[valid-type]
    north_mm: _LocalMm  # type: ignore[valid-type]
    ee_mm2: _Mm2  # type: ignore[valid-type]
    en_mm2: _Mm2  # type: ignore[valid-type]
    nn_mm2: _Mm2  # type: ignore[valid-type]
    rounds: _between(0, MAX_ROUNDS)  # type: ignore[valid-type]
    likelihood_ppm: _Ppm  # type: ignore[valid-type]
    ranges: Annotated[dict[_AnchorId, _between(-1, 1_000_000)], Field(max_length=16)]  # type: ignore[valid-type]


class StepBody(_Strict):
    """A step that was reached, or failed."""

    session_id: _SessionId  # type: ignore[valid-type]
    uav_id: _UavId  # type: ignore[valid-type]
    step: Literal["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
    t_ms: _TimeMs  # type: ignore[valid-type]
    ok: bool
    detail: _plain(500) | None = None  # type: ignore[valid-type]


class EndStep(_Strict):
    """A step in the summary of an ended session."""

    step: Literal["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
    t_ms: _TimeMs  # type: ignore[valid-type]
    ok: bool = True
    detail: _plain(500) | None = None  # type: ignore[valid-type]


class SessionEndBody(_Strict):
    """How a session ended."""

    session_id: _SessionId  # type: ignore[valid-type]
    state: _plain(32)  # type: ignore[valid-type]
    steps: Annotated[list[EndStep], Field(max_length=32)]
    end: _plain(64) | None = None  # type: ignore[valid-type]
    tx_id: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    signature: SignatureBody | None = None


class AnchorBody(_Strict):
    """How an anchor does."""

    anchor_id: _AnchorId  # type: ignore[valid-type]
    state: Literal["up", "down", "silent"]
    firmware: _plain(64) | None = None  # type: ignore[valid-type]


class SpoolBody(_Strict):
    """What waits on the agent's disk."""

    records: _between(0, 2**53)  # type: ignore[valid-type]
    bytes: _between(0, 2**53)  # type: ignore[valid-type]
    dropped: _between(0, 2**53)  # type: ignore[valid-type]


class ReceiverBody(_Strict):
    """Remote ID frames heard."""

    frames: _between(0, 2**53)  # type: ignore[valid-type]
    bad: _between(0, 2**53)  # type: ignore[valid-type]


class DriftBody(_Strict):
    """Whether the anchors stand as they were commissioned, by the ranges that they measure to each other."""

    state: Literal["ok", "drifting", "moved"]
    checked_ms: _between(0, 253_402_300_799_999)  # type: ignore[valid-type]
    looks: _between(0, 2**53)  # type: ignore[valid-type]
    since_ms: _between(0, 253_402_300_799_999) | None = None  # type: ignore[valid-type]
    anchor_id: _AnchorId | None = None  # type: ignore[valid-type]
    off_mm: _between(0, 100_000) | None = None  # type: ignore[valid-type]
    sigma_mm: _between(0, 100_000) | None = None  # type: ignore[valid-type]
    common_mm: _between(-100_000, 100_000) | None = None  # type: ignore[valid-type]
    extra_sigma_mm: _between(0, 200_000) | None = None  # type: ignore[valid-type]


class HealthBody(_Strict):
    """An agent's word on itself."""

    anchors: Annotated[list[AnchorBody], Field(max_length=16)] = []
    spool: SpoolBody | None = None
    receiver: ReceiverBody | None = None
    prekeys: _between(0, 1_000_000) | None = None  # type: ignore[valid-type]
    version: _plain(64) | None = None  # type: ignore[valid-type]
    drift: DriftBody | None = None


class DroppedBody(_Strict):
    """A gap in a spool: telemetry that its quota dropped."""

    from_seq: _between(1, MAX_SEQ)  # type: ignore[valid-type]
    to_seq: _between(1, MAX_SEQ)  # type: ignore[valid-type]


Body = TrackBody | PositionBody | FindingBody | EstimateBody | StepBody | SessionEndBody | HealthBody | DroppedBody
BODIES: Final[dict[str, type[Body]]] = {
    "track": TrackBody,
    "position": PositionBody,
    "finding": FindingBody,
    "estimate": EstimateBody,
    "step": StepBody,
    "session_end": SessionEndBody,
    "health": HealthBody,
    "dropped": DroppedBody,
}
_HELLO: Final = TypeAdapter(Hello)
_RECORDS: Final = TypeAdapter(Records)
_ANSWER: Final = TypeAdapter(Answer)


def parse_hello(text: str) -> Hello:
    """An agent's first frame. Raises `IngestError`."""
    try:
        return _HELLO.validate_json(text)
    except ValidationError as cause:
        raise IngestError("bad_hello", _first(cause)) from None


def parse_records(text: str, limit: int) -> list[dict[str, Any]]:
    """A batch of at most `limit` records. Raises `IngestError`; the records are not looked at yet."""
    try:
        entries = _RECORDS.validate_json(text).records
    except ValidationError as cause:
        raise IngestError("bad_frame", _first(cause)) from None
    if len(entries) > limit:
        raise IngestError("bad_frame", f"{len(entries)} records; at most {limit}")
    return entries


def parse_drone_frame(text: str, limit: int) -> Answer | list[dict[str, Any]]:
    """What a drone's agent sends: an answer, or records as any other. Raises `IngestError`."""
    try:
        return _ANSWER.validate_json(text)
    except ValidationError:
        return parse_records(text, limit)


def sequence_of(record: dict[str, Any]) -> int:
    """A record's sequence number, without which nothing can be said about it. Raises `IngestError`."""
    seq = record.get("seq")
    if type(seq) is not int or not 1 <= seq <= MAX_SEQ:
        raise IngestError("bad_frame", f"records: seq must be an integer from 1 to {MAX_SEQ}")
    return seq


def parse_entry(record: dict[str, Any]) -> Entry:
    """A record, its body not looked at yet. Raises `IngestError`."""
    try:
        return Entry.model_validate(record)
    except ValidationError as cause:
        raise IngestError("bad_record", _first(cause)) from None


def parse_body(entry: Entry) -> Body:
    """The body of a record. Raises `IngestError`."""
    kind = BODIES.get(entry.kind)
    if kind is None:
        raise IngestError("unknown_kind", f"kind {entry.kind!r}; known are {', '.join(BODIES)}")
    try:
        return kind.model_validate(entry.body)
    except ValidationError as cause:
        raise IngestError("bad_body", _first(cause)) from None


def _first(error: ValidationError) -> str:
    """The first thing that is wrong, without the input: it may hold anything."""
    first = error.errors(include_input=False, include_url=False, include_context=False)[0]
    where = ".".join(str(part)[:40] for part in first["loc"])
    return f"{where}: {first['msg']}"[:300] if where else str(first["msg"])[:300]
