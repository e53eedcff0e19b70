"""What a session on the pad wants done: everything that the machine can ask for."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.sessions import Evidence
from wonderland.proofs.records.verdicts import Verdict
from wonderland.session.actions import Cancel, CloseRadios, Finish, OpenRadios, ReportStep

__all__ = [
    "Cancel",
    "CloseRadios",
    "Finish",
    "OpenRadios",
    "PadAction",
    "Permit",
    "ReportEstimate",
    "ReportStep",
    "Submit",
    "Withdraw",
]


@dataclass(frozen=True, slots=True)
class Submit:
    """Bring the evidence before the contract; answer with VerdictCommitted, SubmitRefused or LedgerLost."""

    evidence: Evidence


@dataclass(frozen=True, slots=True)
class Permit:
    """Let the drone act: the verdict that grants it is committed."""

    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Take the permission back: it was used, it lapsed, or the session was cancelled."""

    reason: str


@dataclass(frozen=True, slots=True)
class ReportEstimate:
    """A running estimate: unverified, for people to watch. ``ranges`` are the latest by anchor, mm."""

    verdict: Verdict
    ranges: dict[str, int]
    t_ms: int


PadAction = OpenRadios | CloseRadios | Submit | Cancel | Permit | Withdraw | ReportStep | ReportEstimate | Finish
