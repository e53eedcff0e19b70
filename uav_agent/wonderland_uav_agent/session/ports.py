"""What a drone's session needs of the world; the shell is given these, tests give it others."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Protocol

from wonderland.proof_contract import Committed
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import Pad, Prekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.uwb.layout import RangingPlan
from wonderland_uav_agent.session import events as on

Sink = Callable[[on.UavEvent], None]
"""Where reports go."""

Act = Callable[[Verdict], Awaitable[str]]
"""Does what a committed verdict permits; returns ``done`` or ``aborted``. Cancelled when the permission is gone."""


class Radio(Protocol):
    """The drone's node (``wonderland_uav_agent.radio.UavRadio``)."""

    @property
    def measures(self) -> bool:
        """Whether the node tells its host the ranges, so that the drone can compare what the pad says."""
        ...

    async def ability(self) -> NodeAbility | None:
        """What the node can do, once it is ready; None where it does not say. Raises UwbError."""

    async def open_session(self, plan: RangingPlan, sink: Sink) -> None:
        """Start both UWB sessions; raises where the drone cannot range."""

    async def send(self, frame: bytes) -> None:
        """Hand a frame to the node; raises UwbError."""

    async def answer_in_blinks(self, answer: bytes) -> None:
        """Let each blink carry this from now on, where the node blinks; raises UwbError."""

    async def close_session(self) -> None:
        """Stop both UWB sessions; never raises."""


class UavLedger(Protocol):
    """The ledger (``wonderland.proof_contract.ProofContract``); raises RefusedError and AwayError."""

    @property
    def channel(self) -> str:
        """Name of the ledger's channel."""
        ...

    async def request_proof(self, argument: tx.RequestProof) -> tuple[Session, Committed]:
        """Opens a session."""
        ...

    async def complete(self, session_id: str, result: str, note: str = "") -> tuple[Session, Committed]:
        """How the permitted action ended."""
        ...

    async def cancel(self, session_id: str, reason: str, note: str = "") -> tuple[Session, Committed]:
        """End a session without a verdict."""
        ...

    async def read_pad(self, pad_id: str) -> Pad:
        """A pad with its commissioning."""
        ...

    async def list_prekeys(self, pad_id: str, limit: int = 10) -> tuple[Prekey, ...]:
        """Unused prekeys of a pad."""
        ...

    async def read_policy(self, pad_id: str, action: str) -> Policy:
        """The policy that holds for an action at a pad."""
        ...

    async def read_session(self, session_id: str) -> Session:
        """A session as it stands."""
        ...

    async def read_verdict(self, session_id: str) -> Verdict | None:
        """Its verdict, if there is one."""
