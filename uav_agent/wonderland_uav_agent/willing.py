"""What a drone does with requests for a proof: one at a time, at the pads that its operator named."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final, Protocol

from wonderland.telemetry import PleaseProve
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.agent import ProofResult, UavAgentError

_log = logging.getLogger(__name__)

END_S: Final = 5.0
"""So long a proof has to end in a recorded state; with a ledger that is away it cannot."""


def _nothing() -> str:
    return ""


class Prover(Protocol):
    """The part of `UavAgent` that is needed here."""

    async def prove(self, pad_id: str, action: str) -> ProofResult:
        """Prove, and do what the verdict permits."""
        ...

    def stop(self, reason: str = "agent_stopped") -> None:
        """End the session under way."""


class Willing:
    """Says yes to requests for known pads while no other proof is under way, and sets about them."""

    def __init__(self, agent: Prover, pads: frozenset[str], missing: Callable[[], str] = _nothing) -> None:
        """`missing`: what a proof would lack just now, for the answer; empty where it lacks nothing."""
        self._missing = missing
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
        lacking = self._missing()
        if lacking:
            return lacking
        self._work = asyncio.create_task(self._prove(wish), name=f"request-{wish.request_id}")
        return ""

    async def stop(self) -> None:
        """End what is under way in a recorded state."""
        if self._work is not None:
            self._agent.stop()
            await asyncio.wait({self._work}, timeout=END_S)
            self._work.cancel()
            await asyncio.gather(self._work, return_exceptions=True)

    async def _prove(self, wish: PleaseProve) -> None:
        try:
            result = await self._agent.prove(wish.pad_id, wish.action)
        except (UavAgentError, LedgerError) as error:
            _log.warning("the proof that was asked for at %s did not come about: %s", wish.pad_id, error)
        else:
            _log.info("the proof that was asked for at %s: %s, %s", wish.pad_id, result.state, result.end)
