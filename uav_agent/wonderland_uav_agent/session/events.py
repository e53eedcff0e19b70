"""What happens to a session on the drone: everything that the machine can be told."""

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
    "Acted",
    "DataHeard",
    "Interrupted",
    "OwnRange",
    "RadiosFailed",
    "RadiosOpened",
    "SessionCancelled",
    "SignFailed",
    "Signed",
    "Tick",
    "UavEvent",
    "VerdictCommitted",
]


@dataclass(frozen=True, slots=True)
class OwnRange:
    """A range that the drone's own node measured to a pad node (short address); ``t_ms`` on the drone's clock."""

    mac: int
    t_ms: int
    range_mm: int


@dataclass(frozen=True, slots=True)
class Signed:
    """The countersignature: r ‖ s, 64 octets, low-S."""

    signature: bytes


@dataclass(frozen=True, slots=True)
class SignFailed:
    """The key could not sign."""

    detail: str


@dataclass(frozen=True, slots=True)
class Acted:
    """What was permitted is over: ``done`` or ``aborted``."""

    result: str
    detail: str = ""


UavEvent = (
    RadiosOpened
    | RadiosFailed
    | OwnRange
    | DataHeard
    | Signed
    | SignFailed
    | VerdictCommitted
    | SessionCancelled
    | Acted
    | Tick
    | Interrupted
)
