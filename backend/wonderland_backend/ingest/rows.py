"""Rows of the tables that hold what agents report; `Intake` adds when it took them in."""

from __future__ import annotations

from typing import TypedDict


class TrackValues(TypedDict):
    """A position that a pad heard; `body` is JSON, as everybody may see it, here and in all others."""

    uav_id: str
    pad_id: str
    t_ms: int
    body: str


class OperatorValues(TypedDict):
    """The operator's number that a drone broadcasts."""

    uav_id: str
    operator_id: str
    t_ms: int
    pad_id: str


class FindingValues(TypedDict):
    """What was odd about broadcasts."""

    uav_id: str
    pad_id: str
    kind: str
    t_ms: int
    body: str


class EstimateValues(TypedDict):
    """A pad's running estimate."""

    session_id: str
    uav_id: str
    pad_id: str
    t_ms: int
    body: str


class StepValues(TypedDict):
    """A step of a session, as an agent reported it."""

    session_id: str
    step: str
    agent: str
    agent_id: str
    uav_id: str
    t_ms: int
    ok: bool
    detail: str | None


class EndValues(TypedDict):
    """How an agent says that a session ended."""

    session_id: str
    agent: str
    agent_id: str
    t_ms: int
    body: str


class HealthValues(TypedDict):
    """An agent's word on itself."""

    agent: str
    agent_id: str
    t_ms: int
    body: str


class IrregularValues(TypedDict):
    """A record that was refused, or dropped by its agent."""

    agent: str
    agent_id: str
    spool: str
    seq: int
    kind: str
    code: str
    message: str
    body: str
    received_ms: int
