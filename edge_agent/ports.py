"""What a pad's agent needs of the ledger and of its nodes, and how it says that it cannot go on."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Protocol

from edge_agent.prekeys import PrekeyLedger
from edge_agent.reconcile import ReconcileLedger
from edge_agent.session.ports import Radios, SessionLedger
from edge_agent.witness import WitnessLedger, WitnessRadios

if TYPE_CHECKING:
    from edge_agent.radios import AnchorState
    from wonderland.ledger.checkpoints import Checkpointer
    from wonderland.ledger.proof_contract import ContractEvent
    from wonderland.proofs.records.pads import Pad


class AgentError(Exception):
    """The agent cannot work and will not by waiting; the text says what to do."""


class PadLedger(SessionLedger, PrekeyLedger, ReconcileLedger, WitnessLedger, Protocol):
    """The ledger as a pad uses it (``wonderland.ledger.proof_contract.ProofContract``)."""

    @property
    def channel(self) -> str:
        """Name of the ledger's channel."""
        ...

    async def read_pad(self, pad_id: str) -> Pad:
        """This pad, with its commissioning."""
        ...

    async def height(self) -> int:
        """How many blocks the channel has."""
        ...

    def events(
        self, *, checkpointer: Checkpointer | None = None, names: frozenset[str]
    ) -> AsyncIterator[ContractEvent]:
        """Events with these names, for ever, from where the checkpoint says."""
        ...


class PadRadiosPort(Radios, WitnessRadios, Protocol):
    """The nodes, and how they are."""

    def states(self) -> list[AnchorState]:
        """Every anchor's node as it is now."""
        ...
