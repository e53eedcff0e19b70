"""From an agent's records to rows, and to what the live side is told once they are durable."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import orjson

from backend.ingest import messages
from backend.ingest.agents import PAD, Agent
from backend.ingest.messages import Entry, IngestError
from backend.people.masking import masked
from backend.sessions.state import ReportedStep

MAX_AHEAD_MS: Final = 60_000
"""Telemetry dated further ahead would stand before everybody else's: its clock is wrong, and it is refused."""
MAX_KEPT_BODY: Final = 4_096

Row = dict[str, Any]


@dataclass
class Batch:
    """What one frame of one agent comes to."""

    agent: Agent
    received_ms: int
    last_seq: int = 0
    tracks: list[Row] = field(default_factory=list)
    operators: list[Row] = field(default_factory=list)
    findings: list[Row] = field(default_factory=list)
    estimates: list[Row] = field(default_factory=list)
    steps: list[Row] = field(default_factory=list)
    ends: list[Row] = field(default_factory=list)
    health: Row | None = None
    irregular: list[Row] = field(default_factory=list)
    rejected: list[tuple[int, str, str]] = field(default_factory=list)
    heard: list[tuple[int, messages.TrackBody]] = field(default_factory=list)
    """Positions with everything that was said with them, and when they were heard."""
    networked: list[tuple[int, messages.TrackBody]] = field(default_factory=list)
    """The same of a drone's own agent, and when it sent them. Never stored."""
    tell: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)
    """Calls to the board, by name, to be made after the commit."""


def read(agent: Agent, records: list[Row], *, acknowledged: int, now_ms: int) -> Batch:
    """Check each record; a bad one is refused alone. Records that were acknowledged already are left out.

    Raises `IngestError` when sequence numbers do not rise: then nothing of the frame can be trusted.
    """
    batch = Batch(agent, now_ms, last_seq=acknowledged)
    previous = 0
    for record in records:
        seq = messages.sequence_of(record)
        if seq <= previous:
            raise IngestError("bad_order", f"record {seq} came after {previous}; send them in order")
        previous = seq
        if seq <= acknowledged:
            continue
        batch.last_seq = seq
        try:
            entry = messages.parse_entry(record)
            body = messages.parse_body(entry)
            _require_not_ahead(entry, now_ms)
            _take(batch, entry, body)
        except IngestError as problem:
            batch.rejected.append((seq, problem.code, problem.message))
            _irregular(batch, record, problem.code, problem.message)
    return batch


def _require_not_ahead(entry: Entry, now_ms: int) -> None:
    if entry.kind in {"track", "position", "finding", "estimate", "health"} and entry.t_ms > now_ms + MAX_AHEAD_MS:
        raise IngestError("clock", f"dated {entry.t_ms - now_ms} ms ahead of this server's clock")


def _take(batch: Batch, entry: Entry, body: messages.Body) -> None:
    if isinstance(body, messages.StepBody):
        _step(batch, entry, body)
    elif isinstance(body, messages.SessionEndBody):
        _end(batch, entry, body)
    elif isinstance(body, messages.HealthBody):
        _health(batch, entry, body)
    elif isinstance(body, messages.DroppedBody):
        _irregular(batch, entry.model_dump(), "dropped", f"the agent dropped records {body.from_seq} to {body.to_seq}")
    elif isinstance(body, messages.PositionBody):
        if batch.agent.kind == PAD:
            raise IngestError("not_allowed", "only drones report position: their own")
        batch.networked.append((entry.t_ms, body.heard(batch.agent.id)))
    elif batch.agent.kind != PAD:
        raise IngestError("not_allowed", f"only pads report {entry.kind}")
    elif isinstance(body, messages.TrackBody):
        shown = _track(batch, entry, body)
        batch.heard.append((entry.t_ms, body))
        row = {"uav_id": body.uav_id, "pad_id": batch.agent.id, "t_ms": entry.t_ms, "body": shown}
        batch.tracks.append(row)
        batch.tell.append(("hear", (body.uav_id, entry.t_ms, shown)))
    elif isinstance(body, messages.FindingBody):
        batch.findings.append(
            {
                "uav_id": body.uav_id,
                "pad_id": batch.agent.id,
                "kind": body.kind,
                "t_ms": entry.t_ms,
                "body": _shown(body, t_ms=entry.t_ms, pad_id=batch.agent.id),
            }
        )
    else:
        shown = _shown(body, t_ms=entry.t_ms, pad_id=batch.agent.id)
        batch.estimates.append(
            {
                "session_id": body.session_id,
                "uav_id": body.uav_id,
                "pad_id": batch.agent.id,
                "t_ms": entry.t_ms,
                "body": shown,
            }
        )
        batch.tell.append(("estimate", (body.uav_id, body.session_id, batch.agent.id, shown)))


def _track(batch: Batch, entry: Entry, body: messages.TrackBody) -> str:
    """What everybody may see of a position; the operator's number is kept apart from it."""
    where = {"t_ms": entry.t_ms, "pad_id": batch.agent.id}
    if not body.operator_id:
        return _shown(body, **where)
    batch.operators.append({"uav_id": body.uav_id, "operator_id": body.operator_id, **where})
    return _shown(body, **where, operator_id=masked(body.operator_id))


def _step(batch: Batch, _entry: Entry, body: messages.StepBody) -> None:
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
    batch.tell.append(("step", (body.session_id, step)))


def _end(batch: Batch, entry: Entry, body: messages.SessionEndBody) -> None:
    shown: Row = {"source": batch.agent.kind, "t_ms": entry.t_ms, "state": body.state, "verified": False}
    if body.end is not None:
        shown["end"] = body.end
    if body.tx_id is not None:
        shown["tx_id"] = body.tx_id
    if body.signature is not None and batch.agent.kind == PAD:
        shown["signature"] = body.signature.model_dump(exclude_none=True)
    batch.ends.append(
        {
            "session_id": body.session_id,
            "agent": batch.agent.kind,
            "agent_id": batch.agent.id,
            "t_ms": entry.t_ms,
            "body": orjson.dumps(shown).decode(),
        }
    )


def _health(batch: Batch, entry: Entry, body: messages.HealthBody) -> None:
    shown = _shown(body, t_ms=entry.t_ms)
    batch.health = {"agent": batch.agent.kind, "agent_id": batch.agent.id, "t_ms": entry.t_ms, "body": shown}
    if batch.agent.kind == PAD:
        batch.tell.append(("health", (batch.agent.id, shown)))


def _irregular(batch: Batch, record: Row, code: str, message: str) -> None:
    try:
        body = orjson.dumps(record.get("body")).decode()[:MAX_KEPT_BODY]
    except orjson.JSONEncodeError:  # a number that no other reader would take either
        body = ""
    kind = record.get("kind")
    batch.irregular.append(
        {
            "agent": batch.agent.kind,
            "agent_id": batch.agent.id,
            "spool": batch.agent.spool,
            "seq": record["seq"],
            "kind": kind if isinstance(kind, str) and kind in messages.BODIES else "unknown",
            "code": code,
            "message": message.replace("\x00", "\ufffd"),
            "body": body,
            "received_ms": batch.received_ms,
        }
    )


def _shown(body: messages.Body, **more: Any) -> str:
    said = body.model_dump(exclude_none=True, exclude=messages.USPACE_ONLY)
    return orjson.dumps({**said, **more, "verified": False}).decode()
