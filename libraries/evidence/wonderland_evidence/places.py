"""What the steps share: where something is, whose fault an error is, and which transactions matter."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from wonderland_evidence.derive import rests_on
from wonderland_evidence.errors import StepError
from wonderland_fabric_gateway.errors import LedgerError

if TYPE_CHECKING:
    from wonderland_evidence.case import Case
    from wonderland_fabric_gateway.transactions import Version


@contextmanager
def within(where: str) -> Iterator[None]:
    """What the ledger's checks find wrong in here is wrong there. Raises `StepError`."""
    try:
        yield
    except LedgerError as cause:
        raise StepError(f"{where}: {cause}") from cause


def used(case: Case) -> dict[Version, str]:
    """All transactions that the session rests on, the contract's definitions among them."""
    if case.used is None:
        case.used = rests_on(case)
    return case.used


def one_process(case: Case) -> str:
    """A remark for a ledger on which organisations do not guard against one another."""
    return " (an embedded ledger: one process holds the keys of all)" if case.is_embedded else ""


def name_of_place(place: Version) -> str:
    """A transaction's place for people."""
    return f"block {place.block}, transaction {place.transaction}"
