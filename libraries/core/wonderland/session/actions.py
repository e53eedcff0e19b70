"""What a session wants done, on either side."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.telemetry import StepName
from wonderland.uwb.layout import RangingPlan


@dataclass(frozen=True, slots=True)
class OpenRadios:
    """Start both UWB sessions on this side's nodes; answer with RadiosOpened or RadiosFailed."""

    plan: RangingPlan


@dataclass(frozen=True, slots=True)
class CloseRadios:
    """Stop both UWB sessions."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """End the session on the ledger without a verdict, or (the pad) after its permission lapsed."""

    reason: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class ReportStep:
    """A step of the proof was reached, or failed, at ``t_ms``."""

    step: StepName
    t_ms: int
    ok: bool = True
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Finish:
    """The session is over for this side. ``state`` is the ledger's, ``end`` says how, in one word for machines."""

    state: str
    end: str
    t_ms: int
    tx_id: str = ""
    detail: str = ""
