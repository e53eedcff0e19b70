"""The contract's events for a pad's agent: for ever, from where the last run left off, and where that is kept."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Final

from wonderland.proof_contract import AwayError, ContractEvent, RefusedError
from wonderland_edge_agent.ports import AgentError, PadLedger
from wonderland_fabric_gateway.checkpoints import Checkpoint
from wonderland_fabric_gateway.errors import CheckpointError

if TYPE_CHECKING:
    from wonderland_fabric_gateway.checkpoints import Checkpointer

_log = logging.getLogger(__name__)

NAMES: Final = frozenset(
    {
        "ProofRequested",
        "ProofWitnessed",
        "ProofDecided",
        "ProofCancelled",
        "InteractionCompleted",
        "PrecedenceGiven",
        "DepartureRecorded",
        "PadReserved",
        "ReservationCancelled",
        "PadCommissioned",
        "PadRetired",
    }
)
FOREIGN_EVENTS: Final = 256
AGAIN_S: Final = 1.0
_NO_EVENTS: Final = frozenset({"NOT_FOUND", "PERMISSION_DENIED", "UNAUTHENTICATED"})


class EventSubscription:
    """Hands each event to ``take``, which says whether it was about this pad.

    ``placed``: the place in the ledger's events is kept; no request that comes from then on can be missed.
    """

    def __init__(
        self, ledger: PadLedger, checkpointer: Checkpointer, take: Callable[[ContractEvent], Awaitable[bool]]
    ) -> None:
        self.placed: Final = asyncio.Event()
        self._ledger = ledger
        self._checkpointer = checkpointer
        self._take = take
        self._foreign = 0
        self._heard = False

    async def run(self) -> None:
        """Listen until cancelled. Raises AgentError for what no waiting can cure."""
        while True:
            try:
                if self._checkpointer.load() is None:  # the first start: what was before cannot concern this agent
                    self._checkpointer.save(Checkpoint(await self._ledger.height()))
                self.placed.set()
                async for event in self._ledger.events(checkpointer=self._checkpointer, names=NAMES):
                    self._heard = True
                    self._foreign += 1
                    ours = await self._take(event)
                    if ours or self._foreign >= FOREIGN_EVENTS:
                        # Now and then for those of other pads, too: a restart need not read all their history again.
                        await self._keep_place(event)
            except CheckpointError as error:
                raise AgentError(str(error)) from error
            except RefusedError as error:
                # A place that was on the chain before can only be missing while its peers are behind.
                if error.code in _NO_EVENTS and (error.code != "NOT_FOUND" or not self._heard):
                    raise AgentError(f"the ledger gives this pad no events: {error}") from error
                _log.warning("the ledger's events stopped: %s", error)
            except AwayError as error:
                _log.warning("the ledger's events stopped: %s", error)
            await asyncio.sleep(AGAIN_S)

    async def _keep_place(self, event: ContractEvent) -> None:
        self._foreign = 0
        try:
            await asyncio.to_thread(self._checkpointer.save, event.checkpoint)
        except CheckpointError as error:
            _log.warning("the place in the ledger's events is not kept; after a restart some are seen again: %s", error)
