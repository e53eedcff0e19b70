"""What happens to a session, on either side."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.verdicts import Verdict


@dataclass(frozen=True, slots=True)
class RadiosOpened:
    """This side's nodes run both UWB sessions. ``firmware`` of the nodes, where they say it."""

    firmware: str | None = None


@dataclass(frozen=True, slots=True)
class RadiosFailed:
    """The nodes cannot range: too few of them answered, or the one that speaks is gone for good."""

    detail: str


@dataclass(frozen=True, slots=True)
class DataHeard:
    """One in-band data unit from the other side, as a node reported it; not yet authenticated."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed; nothing else happened."""


@dataclass(frozen=True, slots=True)
class VerdictCommitted:
    """SubmitProof is VALID in a block. Only this event lets a machine permit anything, or act."""

    verdict: Verdict
    tx_id: str


@dataclass(frozen=True, slots=True)
class SessionCancelled:
    """The ledger says that someone cancelled the session: pad, drone or authority."""

    by: str
    reason: str
    note: str = ""
    """What whoever did it wrote beside it."""


@dataclass(frozen=True, slots=True)
class Interrupted:
    """The agent has to end the session: it is being stopped, its spool is full, or the like."""

    reason: str
    detail: str = ""
