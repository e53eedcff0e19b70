"""What can be wrong with evidence, each by its own type."""

from __future__ import annotations


class EvidenceError(Exception):
    """Base of everything this package raises on purpose."""


class UnreadableError(EvidenceError):
    """A file that is none of this format. `code` is for machines.

    too_large, cut, concatenated, not_json, not_canonical, unknown_version, wrong_field, or no_file.
    """

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


class StepError(EvidenceError):
    """Something that a step of the verification found wrong."""


class NotCheckedError(EvidenceError):
    """A step cannot be made with this file and this verifier; the text says why. It never counts as one that holds."""


class StatementError(EvidenceError):
    """A signed statement that does not hold; the text says why."""


class MissingBlockError(StepError):
    """The bundle lacks a block that something in it rests on."""

    def __init__(self, number: int, why: str) -> None:
        super().__init__(f"block {number} is missing: {why}")
        self.number = number


class ExportError(EvidenceError):
    """The ledger cannot give the evidence that was asked for; the text says why."""


class UnreachedError(ExportError):
    """The ledger could not be reached: that says nothing about what is on it."""
