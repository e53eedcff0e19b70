"""What happens to a session on the pad: everything that the machine can be told."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.session.events import (
    DataHeard,
    Interrupted,
    RadiosFailed,
    RadiosOpened,
    SessionCancelled,
    Tick,
    VerdictCommitted,
)

__all__ = [
    "AnchorRange",
    "DataHeard",
    "FrameHeard",
    "InteractionCompleted",
    "Interrupted",
    "LedgerLost",
    "PadEvent",
    "Permitted",
    "RadiosFailed",
    "RadiosOpened",
    "SessionCancelled",
    "SubmitRefused",
    "Tick",
    "VerdictCommitted",
    "Witnessed",
]


@dataclass(frozen=True, slots=True)
class AnchorRange:
    """One report of one node: ``range_mm`` is None where it heard the drone's frame but has no range.

    ``t_ms``: when the report arrived, on the session's clock.
    """

    anchor_id: str
    t_ms: int
    range_mm: int | None
    nlos: bool = False


@dataclass(frozen=True, slots=True)
class FrameHeard:
    """One blink of the drone as one node time-stamped it: ``ticks`` of 15.65 ps on the nodes' common clock (40 bits).

    ``number`` is the drone's count of its blinks, ``payload`` what its host put into it.
    """

    anchor_id: str
    t_ms: int
    number: int
    ticks: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Witnessed:
    """The session's witness has testified: WitnessProof is VALID in a block."""

    tx_id: str


@dataclass(frozen=True, slots=True)
class Permitted:
    """What the pad does for a permitted drone is done (a light, a hangar's door): it may come."""


@dataclass(frozen=True, slots=True)
class SubmitRefused:
    """The contract refused the evidence; ``reason`` is for machines."""

    reason: str
    detail: str


@dataclass(frozen=True, slots=True)
class LedgerLost:
    """Neither a commit nor a refusal before it was too late."""

    detail: str


@dataclass(frozen=True, slots=True)
class InteractionCompleted:
    """The ledger says how the permitted interaction ended."""

    end: str


PadEvent = (
    RadiosOpened
    | RadiosFailed
    | AnchorRange
    | FrameHeard
    | DataHeard
    | Tick
    | VerdictCommitted
    | Permitted
    | Witnessed
    | SubmitRefused
    | LedgerLost
    | SessionCancelled
    | InteractionCompleted
    | Interrupted
)
