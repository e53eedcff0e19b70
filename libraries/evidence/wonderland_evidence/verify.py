"""All steps in their order, and what came of each."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Final, Literal

from cryptography.utils import CryptographyDeprecationWarning

from wonderland.proofs.errors import ProofError
from wonderland_evidence.bundle import Bundle
from wonderland_evidence.case import NO_VERDICT, Case
from wonderland_evidence.errors import EvidenceError, NotCheckedError
from wonderland_evidence.steps import STEPS, Step
from wonderland_evidence.trust import Pins
from wonderland_fabric_gateway.errors import LedgerError

Status = Literal["holds", "fails", "not_checked"]
HOLDS: Final = "holds"
FAILS: Final = "fails"
NOT_CHECKED: Final = "not_checked"


@dataclass(frozen=True)
class Finding:
    """What came of a step."""

    number: int
    step: Step
    status: Status
    text: str
    proves: str = ""
    """What stands proved: nothing, unless the step holds."""

    def to_json(self) -> dict[str, Any]:
        """One object, as ``--json`` prints it."""
        return {
            "step": self.number,
            "name": self.step.name,
            "status": self.status,
            "text": self.text,
            "proves": self.proves,
            "does_not_prove": self.step.does_not_prove,
        }


@dataclass(frozen=True)
class Report:
    """All findings, in the order of the steps."""

    findings: tuple[Finding, ...]

    @property
    def failed(self) -> Finding | None:
        """The step that does not hold, if one does not."""
        return next((each for each in self.findings if each.status == FAILS), None)

    @property
    def is_whole(self) -> bool:
        """Whether every step holds that evidence may not lack."""
        return all(
            each.status == HOLDS or (each.step.may_lack and each.status == NOT_CHECKED) for each in self.findings
        )


def verify(data: bytes, pins: Pins) -> Report:
    """Check a bundle's bytes. Raises `UnreadableError` for what is no bundle.

    After a step that does not hold nothing is checked: everything further would rest on it.
    """
    with warnings.catch_warnings():
        # Of certificates that the bundle only brings along: whether they serve is what the steps find out.
        warnings.simplefilter("ignore", CryptographyDeprecationWarning)
        return _verify(Case(Bundle.decode(data)), pins)


def _verify(case: Case, pins: Pins) -> Report:
    findings: list[Finding] = []
    failed = 0
    for number, step in enumerate(STEPS, 1):
        if failed:
            finding = Finding(number, step, NOT_CHECKED, f"step {failed} does not hold")
        else:
            finding = _finding(number, step, case, pins)
            failed = number if finding.status == FAILS else 0
        findings.append(finding)
    return Report(tuple(findings))


def _finding(number: int, step: Step, case: Case, pins: Pins) -> Finding:
    try:
        text = step.check(case, pins)
        less = step.without_verdict if step.without_verdict and NO_VERDICT in case.lacks else ""
        return Finding(number, step, HOLDS, text, less or step.proves)
    except NotCheckedError as cause:
        return Finding(number, step, NOT_CHECKED, str(cause))
    except (EvidenceError, LedgerError, ProofError) as cause:
        return Finding(number, step, FAILS, str(cause))
    except Exception as cause:  # noqa: BLE001 - bytes of strangers: whatever a library says of them, they fail
        return Finding(number, step, FAILS, f"it cannot be read ({type(cause).__name__}: {cause})")
