"""What a pad's agent needs of the ledger and of its nodes, and how it says that it cannot go on."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from typing import TYPE_CHECKING, Protocol

from wonderland_edge_agent.prekeys import PrekeyLedger
from wonderland_edge_agent.reconcile import ReconcileLedger
from wonderland_edge_agent.session.ports import Radios, SessionLedger
from wonderland_edge_agent.waiting import QueueLedger
from wonderland_edge_agent.witness import WitnessLedger, WitnessRadios

if TYPE_CHECKING:
    from wonderland.proof_contract import ContractEvent
    from wonderland.proofs.records.pads import Pad
    from wonderland.proofs.records.policies import Policy
    from wonderland_edge_agent.radios import AnchorState
    from wonderland_fabric_gateway.checkpoints import Checkpointer


class AgentError(Exception):
    """The agent cannot work and will not by waiting; the text says what to do."""


class PadLedger(SessionLedger, PrekeyLedger, ReconcileLedger, WitnessLedger, QueueLedger, Protocol):
    """The ledger as a pad uses it (``wonderland.proof_contract.ProofContract``)."""

    @property
    def channel(self) -> str:
        """Name of the ledger's channel."""
        ...

    async def read_pad(self, pad_id: str) -> Pad:
        """This pad, with its commissioning."""
        ...

    async def read_policy(self, pad_id: str, action: str) -> Policy:
        """The policy that holds for an action at a pad."""
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

    @property
    def highest(self) -> int | None:
        """The assurance that this kind of nodes bears at most; None: what they say of themselves counts."""
        ...

    def states(self) -> list[AnchorState]:
        """Every anchor's node as it is now."""
        ...

    @property
    def roll_wanted(self) -> bool:
        """Whether a node has come back since the last roll call."""
        ...

    async def call_roll(self, macs: Mapping[str, int], channel: int, *, expected: bool = False) -> bool | None:
        """Look whether all nodes that answer also range: whether any was heard, or None where nobody looked."""
