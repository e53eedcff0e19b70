"""What a session on the drone wants done: everything that the machine can ask for."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland.proofs.records.verdicts import Verdict
from wonderland.session.actions import Cancel, CloseRadios, Finish, OpenRadios, ReportStep

__all__ = [
    "Act",
    "AnswerInBlinks",
    "Cancel",
    "CloseRadios",
    "Complete",
    "Finish",
    "OpenRadios",
    "ReportStep",
    "Sign",
    "StopActing",
    "UavAction",
]


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


UavAction = (
    OpenRadios | CloseRadios | AnswerInBlinks | Sign | Act | StopActing | Complete | Cancel | ReportStep | Finish
)
