"""What a session on the pad wants done: everything that the machine can ask for."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.sessions import Evidence
from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.layout import RangingPlan


@dataclass(frozen=True, slots=True)
class OpenRadios:
    """Start both UWB sessions on the pad's nodes; answer with RadiosOpened or RadiosFailed."""

    plan: RangingPlan


@dataclass(frozen=True, slots=True)
class CloseRadios:
    """Stop both UWB sessions."""


@dataclass(frozen=True, slots=True)
class Submit:
    """Bring the evidence before the contract; answer with VerdictCommitted, SubmitRefused or LedgerLost."""

    evidence: Evidence


@dataclass(frozen=True, slots=True)
class Cancel:
    """End the session on the ledger without a verdict, or after its permission lapsed."""

    reason: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Permit:
    """Let the drone act: the verdict that grants it is committed."""

    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Take the permission back: it was used, it lapsed, or the session was cancelled."""

    reason: str


@dataclass(frozen=True, slots=True)
class ReportStep:
    """A step of the proof was reached, or failed, at ``t_ms``."""

    step: str
    t_ms: int
    ok: bool = True
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ReportEstimate:
    """A running estimate: unverified, for people to watch. ``ranges`` are the latest by anchor, mm."""

    verdict: Verdict
    ranges: dict[str, int]
    t_ms: int


@dataclass(frozen=True, slots=True)
class Finish:
    """The session is over for this pad. ``state`` is the ledger's, ``end`` says how, in one word for machines."""

    state: str
    end: str
    t_ms: int
    tx_id: str = ""
    detail: str = ""


PadAction = OpenRadios | CloseRadios | Submit | Cancel | Permit | Withdraw | ReportStep | ReportEstimate | Finish
