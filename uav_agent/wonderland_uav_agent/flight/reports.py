"""Says on the ledger what came down without a permission, as often as it takes."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Coroutine
from typing import Any, Final, Protocol

from wonderland.proof_contract import RefusedError
from wonderland.proofs.records import transactions as tx
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway.backoff import Backoff

_log = logging.getLogger(__name__)

FIRST_PAUSE_S: Final = 1.0
LONGEST_PAUSE_S: Final = 30.0


class LandingLedger(Protocol):
    """The part of the contract that is needed here."""

    def report_landing(self, argument: tx.ReportLanding) -> Coroutine[Any, Any, Any]:
        """Raises `LedgerError`."""
        ...


class LandingReports:
    """A queue; ``run`` empties it until cancelled. What is in it when the agent ends is in its log only."""

    def __init__(self, ledger: LandingLedger) -> None:
        self._ledger = ledger
        self._queue: asyncio.Queue[tx.ReportLanding] = asyncio.Queue()

    def add(self, landing: tx.ReportLanding) -> None:
        """To be reported."""
        self._queue.put_nowait(landing)

    async def run(self) -> None:
        """Report one after the other; a ledger that is away is tried again."""
        while True:
            landing = await self._queue.get()
            pauses = Backoff(secrets.token_bytes, first_s=FIRST_PAUSE_S, max_s=LONGEST_PAUSE_S)
            while True:
                try:
                    await self._ledger.report_landing(landing)
                except RefusedError as error:
                    _log.error("the ledger does not take the report of a landing at %s: %s", landing.pad_id, error)
                    break
                except LedgerError as error:
                    _log.warning("the landing at %s is not reported yet: %s", landing.pad_id, error)
                    await asyncio.sleep(pauses.next_s())
                else:
                    _log.warning("the landing at %s without a permission is on the ledger", landing.pad_id)
                    break
