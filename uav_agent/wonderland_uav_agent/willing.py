"""What a drone does with requests for a proof: one at a time, at the pads that its operator named."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final, Protocol

from wonderland.telemetry import PleaseProve
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_uav_agent.agent import ProofResult, UavAgentError
from wonderland_uav_agent.results import why_not

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

    def stop(self, reason: str = "drone_stopped") -> None:
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
        return self.begin(wish.pad_id, wish.action)

    def begin(
        self,
        pad_id: str,
        action: str,
        ended: Callable[[str], None] | None = None,
        proved: Callable[[ProofResult], None] | None = None,
    ) -> str:
        """Set about a proof; why not, or empty. ``ended`` hears why nothing was permitted (or empty).

        ``proved`` is told the result before, where there is one.
        """
        if pad_id not in self._pads:
            return f"this drone does not prove itself at {pad_id}; its operator named {', '.join(sorted(self._pads))}"
        if self._work is not None and not self._work.done():
            return "another proof is under way"
        lacking = self._missing()
        if lacking:
            return lacking
        self._work = asyncio.create_task(self._prove(pad_id, action, ended, proved), name=f"proof-{pad_id}-{action}")
        return ""

    async def stop(self) -> None:
        """End what is under way in a recorded state."""
        if self._work is not None:
            self._agent.stop()
            await asyncio.wait({self._work}, timeout=END_S)
            self._work.cancel()
            await asyncio.gather(self._work, return_exceptions=True)

    async def _prove(
        self,
        pad_id: str,
        action: str,
        ended: Callable[[str], None] | None,
        proved: Callable[[ProofResult], None] | None,
    ) -> None:
        reason = "the proof was ended"
        try:
            result = await self._agent.prove(pad_id, action)
        except (UavAgentError, LedgerError) as error:
            reason = str(error)
            _log.warning("the proof at %s (%s) did not come about: %s", pad_id, action, error)
        else:
            reason = why_not(result)
            if proved is not None:
                proved(result)
            _log.info("the proof at %s (%s): %s, %s", pad_id, action, result.state, result.end)
        finally:
            if ended is not None:
                ended(reason)
