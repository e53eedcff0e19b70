"""What a drone does with requests for a proof: one at a time, at the pads that its operator named."""

from __future__ import annotations

import asyncio
import logging
from typing import Protocol

from wonderland.telemetry import PleaseProve
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.agent import ProofResult, UavAgentError

_log = logging.getLogger(__name__)


class Prover(Protocol):
    """The part of `UavAgent` that is needed here."""

    async def prove(self, pad_id: str, action: str) -> ProofResult:
        """Prove, and do what the verdict permits."""
        ...

    def stop(self, reason: str = "agent_stopped") -> None:
        """End the session under way."""


class Willing:
    """Says yes to requests for known pads while no other proof is under way, and sets about them."""

    def __init__(self, agent: Prover, pads: frozenset[str]) -> None:
        self._agent = agent
        self._pads = pads
        self._work: asyncio.Task[None] | None = None

    async def decide(self, wish: PleaseProve) -> str:
        """Why not; empty where the drone sets about it."""
        if wish.pad_id not in self._pads:
            return (
                f"this drone does not prove itself at {wish.pad_id}; its operator named {', '.join(sorted(self._pads))}"
            )
        if self._work is not None and not self._work.done():
            return "another proof is under way"
        self._work = asyncio.create_task(self._prove(wish), name=f"request-{wish.request_id}")
        return ""

    async def stop(self) -> None:
        """End what is under way in a recorded state."""
        if self._work is not None:
            self._agent.stop()
            await asyncio.gather(self._work, return_exceptions=True)

    async def _prove(self, wish: PleaseProve) -> None:
        try:
            result = await self._agent.prove(wish.pad_id, wish.action)
        except (UavAgentError, LedgerError) as error:
            _log.warning("the proof that was asked for at %s did not come about: %s", wish.pad_id, error)
        else:
            _log.info("the proof that was asked for at %s: %s, %s", wish.pad_id, result.state, result.end)
