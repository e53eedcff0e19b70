"""What a session on the drone wants done: everything that the machine can ask for."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.layout import RangingPlan


@dataclass(frozen=True, slots=True)
class OpenRadios:
    """Start both UWB sessions on the drone's node; answer with RadiosOpened or RadiosFailed."""

    plan: RangingPlan


@dataclass(frozen=True, slots=True)
class CloseRadios:
    """Stop both UWB sessions."""


@dataclass(frozen=True, slots=True)
class AnswerInBlinks:
    """From now on the blinks shall carry this answer."""

    answer: bytes


@dataclass(frozen=True, slots=True)
class Sign:
    """Sign these octets with the drone's ledger key; answer with Signed or SignFailed."""

    statement: bytes


@dataclass(frozen=True, slots=True)
class Act:
    """Do what the committed verdict permits (land, take off, dock); answer with Acted."""

    verdict: Verdict


@dataclass(frozen=True, slots=True)
class StopActing:
    """The permission is gone: break off."""

    reason: str


@dataclass(frozen=True, slots=True)
class Complete:
    """Say on the ledger how the permitted action ended."""

    result: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Cancel:
    """End the session on the ledger without a verdict."""

    reason: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class ReportStep:
    """A step of the proof was reached, or failed, at ``t_ms``."""

    step: str
    t_ms: int
    ok: bool = True
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Finish:
    """The session is over for this drone. ``state`` is the ledger's, ``end`` says how, in one word for machines."""

    state: str
    end: str
    t_ms: int
    detail: str = ""


UavAction = (
    OpenRadios | CloseRadios | AnswerInBlinks | Sign | Act | StopActing | Complete | Cancel | ReportStep | Finish
)
