"""From an agent's records to rows, and to what the live side is told once they are durable."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, assert_never

import msgspec

from wonderland import telemetry
from wonderland.telemetry import (
    Body,
    Dropped,
    Estimate,
    Finding,
    Health,
    Position,
    Record,
    SessionEnd,
    Step,
    TelemetryError,
    Track,
)
from wonderland_backend.agents.connected import PAD, Agent
from wonderland_backend.agents.errors import IngestError
from wonderland_backend.ingest.rows import (
    EndValues,
    EstimateValues,
    FindingValues,
    HealthValues,
    IrregularValues,
    OperatorValues,
    StepValues,
    TrackValues,
)
from wonderland_backend.live.telling import HeardTrack, PadHealthTold, RunningEstimate, StepTaken, Telling
from wonderland_backend.masking import masked
from wonderland_backend.sessions.state import ReportedStep
from wonderland_backend.tracks.queries import MAX_AHEAD_MS

MAX_KEPT_BODY: Final = 4_096
"""Characters of a refused record's body."""
MAX_HEIGHT_ACCURACY_MM: Final = 1_000_000
"""What a track can say; a drone that knows less of its height says no more."""
_TELEMETRY: Final = (Track, Position, Finding, Estimate, Health)


@dataclass
class Batch:
    """What one frame of one agent comes to."""

    agent: Agent
    received_ms: int
    last_seq: int = 0
    tracks: list[TrackValues] = field(default_factory=list)
    operators: list[OperatorValues] = field(default_factory=list)
    findings: list[FindingValues] = field(default_factory=list)
    estimates: list[EstimateValues] = field(default_factory=list)
    steps: list[StepValues] = field(default_factory=list)
    ends: list[EndValues] = field(default_factory=list)
    health: HealthValues | None = None
    irregular: list[IrregularValues] = field(default_factory=list)
    rejected: list[tuple[int, str, str]] = field(default_factory=list)
    heard: list[tuple[int, Track]] = field(default_factory=list)
    """Positions with everything that was said with them, and when they were heard."""
    networked: list[tuple[int, Track]] = field(default_factory=list)
    """The same of a drone's own agent, and when it sent them. Never stored."""
    tell: list[Telling] = field(default_factory=list)
    """What the board is told after the commit."""


class _Irregular(msgspec.Struct):
    """What can still be made out of a record that is none."""

    kind: object = None
    body: msgspec.Raw = msgspec.Raw()


def read(agent: Agent, records: list[msgspec.Raw], *, acknowledged: int, now_ms: int) -> Batch:
    """Check each record; a bad one is refused alone. Records that were acknowledged already are left out.

    Raises `TelemetryError` when sequence numbers do not rise: then nothing of the frame can be trusted.
    """
    batch = Batch(agent, now_ms, last_seq=acknowledged)
    previous = 0
    for raw in records:
        record: Record | None = None
        problem: TelemetryError | None = None
        try:
            record = telemetry.decode_record(raw)
            seq = record.seq
        except TelemetryError as error:
            problem, seq = error, telemetry.number_of(raw)
        if seq <= previous:
            raise IngestError("bad_order", f"record {seq} came after {previous}; send them in order")
        previous = seq
        if seq <= acknowledged:
            continue
        batch.last_seq = seq
        if record is not None:
            try:
                body = telemetry.decode_body(record)
                _require_not_ahead(body, record.t_ms, now_ms)
                _take(batch, record, body)
            except TelemetryError as error:
                problem = error
        if problem is not None:
            batch.rejected.append((seq, problem.code, problem.message))
            _irregular(batch, raw, seq, problem.code, problem.message)
    return batch


def _require_not_ahead(body: Body, t_ms: int, now_ms: int) -> None:
    if isinstance(body, _TELEMETRY) and t_ms > now_ms + MAX_AHEAD_MS:
        raise IngestError("clock", f"dated {t_ms - now_ms} ms ahead of this server's clock")


def _take(batch: Batch, record: Record, body: Body) -> None:
    t_ms = record.t_ms
    match body:
        case Step():
            _step(batch, body)
        case SessionEnd():
            _end(batch, t_ms, body)
        case Health():
            _health(batch, t_ms, body)
        case Dropped():
            why = f"the agent dropped records {body.from_seq} to {body.to_seq}"
            _keep(batch, record.seq, record.kind, _text(record.body), "dropped", why)
        case Position():
            if batch.agent.kind == PAD:
                raise IngestError("not_allowed", "only drones report position: their own")
            batch.networked.append((t_ms, _as_heard(body, batch.agent.id)))
        case Track() | Finding() | Estimate() if batch.agent.kind != PAD:
            raise IngestError("not_allowed", f"only pads report {record.kind}")
        case Track():
            _track(batch, t_ms, body)
        case Finding():
            _finding(batch, t_ms, body)
        case Estimate():
            _estimate(batch, t_ms, body)
        case _:
            assert_never(body)


def _as_heard(body: Position, uav_id: str) -> Track:
    """A drone's own word on its position, as pads hear one. Raises `IngestError` for an id that no drone can have."""
    try:
        uav_id = msgspec.convert(uav_id, telemetry.UavId)
    except msgspec.ValidationError:
        raise IngestError("bad_body", "the agent's id is no drone's serial number") from None
    return Track(
        uav_id=uav_id,
        transport="network",
        lat_e7=body.lat_e7,
        lon_e7=body.lon_e7,
        claim_t_ms=body.claim_t_ms,
        height_mm=body.height_mm,
        accuracy_mm=body.accuracy_mm,
        height_accuracy_mm=min(body.height_accuracy_mm, MAX_HEIGHT_ACCURACY_MM),
    )


def _track(batch: Batch, t_ms: int, body: Track) -> None:
    """What everybody may see, without the operator's number, which is kept apart; all of it for `Intake.listeners`."""
    uav_id, pad_id = body.uav_id, batch.agent.id
    shown = telemetry.plain(body)
    for name in telemetry.FOR_USPACE:
        shown.pop(name, None)
    if body.operator_id:
        shown["operator_id"] = masked(body.operator_id)
        batch.operators.append({"uav_id": uav_id, "operator_id": body.operator_id, "t_ms": t_ms, "pad_id": pad_id})
    text = _shown(shown, t_ms=t_ms, pad_id=pad_id)
    batch.heard.append((t_ms, body))
    batch.tracks.append({"uav_id": uav_id, "pad_id": pad_id, "t_ms": t_ms, "body": text})
    batch.tell.append(HeardTrack(uav_id, t_ms, text))


def _finding(batch: Batch, t_ms: int, body: Finding) -> None:
    pad_id = batch.agent.id
    text = _shown(telemetry.plain(body), t_ms=t_ms, pad_id=pad_id)
    batch.findings.append({"uav_id": body.uav_id, "pad_id": pad_id, "kind": body.kind, "t_ms": t_ms, "body": text})


def _estimate(batch: Batch, t_ms: int, body: Estimate) -> None:
    uav_id, session_id, pad_id = body.uav_id, body.session_id, batch.agent.id
    text = _shown(telemetry.plain(body), t_ms=t_ms, pad_id=pad_id)
    batch.estimates.append({"session_id": session_id, "uav_id": uav_id, "pad_id": pad_id, "t_ms": t_ms, "body": text})
    batch.tell.append(RunningEstimate(uav_id, session_id, pad_id, text))


def _step(batch: Batch, body: Step) -> None:
    agent = batch.agent
    if agent.kind != PAD and body.uav_id != agent.id:
        raise IngestError("not_allowed", "a drone reports its own sessions only")
    batch.steps.append(
        {
            "session_id": body.session_id,
            "step": body.step,
            "agent": agent.kind,
            "agent_id": agent.id,
            "uav_id": body.uav_id,
            "t_ms": body.t_ms,
            "ok": body.ok,
            "detail": body.detail,
        }
    )
    step = ReportedStep(body.step, body.t_ms, body.ok, agent.kind, body.detail, agent.id)
    batch.tell.append(StepTaken(body.session_id, step))


def _end(batch: Batch, t_ms: int, body: SessionEnd) -> None:
    shown: dict[str, Any] = {"source": batch.agent.kind, "t_ms": t_ms, "state": body.state, "verified": False}
    if body.end is not None:
        shown["end"] = body.end
    if body.tx_id is not None:
        shown["tx_id"] = body.tx_id
    if body.signature is not None and batch.agent.kind == PAD:
        shown["signature"] = {"refused": 0} | telemetry.plain(body.signature)
    batch.ends.append(
        {
            "session_id": body.session_id,
            "agent": batch.agent.kind,
            "agent_id": batch.agent.id,
            "t_ms": t_ms,
            "body": _json(shown),
        }
    )


def _health(batch: Batch, t_ms: int, body: Health) -> None:
    shown = _shown(telemetry.plain(body), t_ms=t_ms)
    batch.health = {"agent": batch.agent.kind, "agent_id": batch.agent.id, "t_ms": t_ms, "body": shown}
    if batch.agent.kind == PAD:
        batch.tell.append(PadHealthTold(batch.agent.id, shown))


def _irregular(batch: Batch, raw: msgspec.Raw, seq: int, code: str, message: str) -> None:
    """Keep of a record that was refused what there is: its number is known, the rest may be anything."""
    try:
        found = msgspec.json.decode(raw, type=_Irregular)
    except (ValueError, RecursionError):
        found = _Irregular()
    kind = found.kind if isinstance(found.kind, str) and found.kind in telemetry.BODIES else "unknown"
    _keep(batch, seq, kind, _text(found.body), code, message)


def _keep(batch: Batch, seq: int, kind: str, body: str, code: str, message: str) -> None:
    batch.irregular.append(
        {
            "agent": batch.agent.kind,
            "agent_id": batch.agent.id,
            "spool": batch.agent.spool,
            "seq": seq,
            "kind": kind,
            "code": code,
            "message": message,
            "body": body,
            "received_ms": batch.received_ms,
        }
    )


def _text(body: msgspec.Raw) -> str:
    """A body's JSON text as the agent wrote it: that has no NUL, which the database would not take."""
    return bytes(body).decode()[:MAX_KEPT_BODY]


def _shown(said: dict[str, Any], **more: Any) -> str:
    return _json({**said, **more, "verified": False})


def _json(value: dict[str, Any]) -> str:
    return msgspec.json.encode(value).decode()
