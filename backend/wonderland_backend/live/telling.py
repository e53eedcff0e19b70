"""What a board is told of agents' records: the live one once they are durable, a replay's when they had come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from wonderland_backend.live.board import Board
from wonderland_backend.sessions.state import ReportedStep


@dataclass(frozen=True, slots=True)
class HeardTrack:
    """A position that a pad heard at `t_ms`; `shown` is JSON, as everybody may see it."""

    uav_id: str
    t_ms: int
    shown: str


@dataclass(frozen=True, slots=True)
class RunningEstimate:
    """A pad's running estimate of a session."""

    uav_id: str
    session_id: str
    pad_id: str
    shown: str


@dataclass(frozen=True, slots=True)
class StepTaken:
    """A step of a session that an agent reported."""

    session_id: str
    step: ReportedStep


@dataclass(frozen=True, slots=True)
class PadHealthTold:
    """A pad's word on itself."""

    pad_id: str
    shown: str


Telling: TypeAlias = HeardTrack | RunningEstimate | StepTaken | PadHealthTold


def tell_board(board: Board, what: Telling) -> None:
    """Hand what agents said to the live map, each kind to its own method."""
    match what:
        case HeardTrack(uav_id, t_ms, shown):
            board.hear(uav_id, t_ms, shown)
        case RunningEstimate(uav_id, session_id, pad_id, shown):
            board.estimate(uav_id, session_id, pad_id, shown)
        case StepTaken(session_id, step):
            board.step(session_id, step)
        case PadHealthTold(pad_id, shown):
            board.health(pad_id, shown)
