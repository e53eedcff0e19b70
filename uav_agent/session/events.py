"""What happens to a session on the drone: everything that the machine can be told."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.verdicts import Verdict


@dataclass(frozen=True, slots=True)
class RadiosOpened:
    """The drone's node runs both UWB sessions."""


@dataclass(frozen=True, slots=True)
class RadiosFailed:
    """The drone's node cannot range."""

    detail: str


@dataclass(frozen=True, slots=True)
class OwnRange:
    """A range that the drone's own node measured to a pad node (short address); ``t_ms`` on the drone's clock."""

    mac: int
    t_ms: int
    range_mm: int


@dataclass(frozen=True, slots=True)
class DataHeard:
    """One in-band data unit from the pad; not yet authenticated."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Signed:
    """The countersignature: r ‖ s, 64 octets, low-S."""

    signature: bytes


@dataclass(frozen=True, slots=True)
class SignFailed:
    """The key could not sign."""

    detail: str


@dataclass(frozen=True, slots=True)
class VerdictCommitted:
    """SubmitProof is VALID in a block. Only this event lets the machine act."""

    verdict: Verdict
    tx_id: str


@dataclass(frozen=True, slots=True)
class SessionCancelled:
    """The ledger says that someone cancelled the session."""

    by: str
    reason: str


@dataclass(frozen=True, slots=True)
class Acted:
    """What was permitted is over: ``done`` or ``aborted``."""

    result: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed; nothing else happened."""


@dataclass(frozen=True, slots=True)
class Interrupted:
    """The agent has to end the session."""

    reason: str
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
