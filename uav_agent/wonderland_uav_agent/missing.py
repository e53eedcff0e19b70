"""What a drone's agent that stays still waits for: its position, the ledger, its UWB node.

Each part is looked at again and again, with bounded pauses; a change is said once, and so is its end.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime
from typing import Final

from wonderland.clock import Clock
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway.backoff import Backoff

_log = logging.getLogger(__name__)

LOOK_EVERY_S: Final = 0.5
LEDGER_EVERY_S: Final = 5.0
FIRST_PAUSE_S: Final = 0.5
LONGEST_PAUSE_S: Final = 5.0
ANSWER_S: Final = 5.0
"""A ledger that says nothing for so long is away."""


class Missing:
    """What is not there just now. `run` keeps looking until cancelled; `why_not` is what requests are answered with."""

    def __init__(
        self,
        *,
        position: Callable[[], str],
        ledger: Callable[[], Awaitable[None]],
        node: Callable[[], str],
        clock: Clock,
    ) -> None:
        """`position` and `node`: why it is not there, or empty. `ledger`: raises `LedgerError`."""
        self._position = position
        self._ask_ledger = ledger
        self._node = node
        self._clock = clock
        self._ledger = "the ledger has not answered yet"
        self._told: dict[str, bool] = {}
        self._since: dict[str, str] = {}

    def why_not(self) -> str:
        """Why no proof can begin now, in words for whoever asked; empty where nothing is missing."""
        return "; ".join(filter(None, (self._no_position(), self._ledger, self._no_node())))

    async def run(self) -> None:
        """Look until cancelled."""
        async with asyncio.TaskGroup() as looks:
            looks.create_task(self._look_at_ledger())
            looks.create_task(self._look_here())

    def _no_position(self) -> str:
        why = self._position()
        return f"no position yet: {why}" if why else ""

    def _no_node(self) -> str:
        trouble = self._node()
        return f"the drone's UWB node is not ready: {trouble}" if trouble else ""

    async def _look_here(self) -> None:
        while True:
            self._tell(
                "position",
                self._no_position(),
                "See that the autopilot runs and --position is where it is heard, or wait for its fix.",
            )
            self._tell("UWB node", self._no_node(), "Plug it in, or see that --port is its port.")
            await asyncio.sleep(LOOK_EVERY_S)

    async def _look_at_ledger(self) -> None:
        pauses = Backoff(secrets.token_bytes, first_s=FIRST_PAUSE_S, max_s=LONGEST_PAUSE_S)
        while True:
            try:
                async with asyncio.timeout(ANSWER_S):
                    await self._ask_ledger()
            except (LedgerError, TimeoutError) as error:
                why = str(error) or f"no answer within {ANSWER_S:g} s"
                now = datetime.fromtimestamp(self._clock() / 1000, UTC).isoformat(timespec="seconds")
                since = self._since.setdefault("ledger", now)
                self._ledger = f"the ledger is away since {since}: {why}"
                self._tell("ledger", self._ledger, "See that it runs and that the network reaches it.")
                await asyncio.sleep(pauses.next_s())
            else:
                self._ledger = ""
                self._since.pop("ledger", None)
                self._tell("ledger", "", "")
                pauses.reset()
                await asyncio.sleep(LEDGER_EVERY_S)

    def _tell(self, part: str, why: str, next_step: str) -> None:
        """Once when it goes, once when it is back; nothing where it was there from the beginning."""
        missing = bool(why)
        if missing == self._told.get(part, False):
            return
        self._told[part] = missing
        if missing:
            _log.warning("%s. %s Until then requests for proofs are answered with this.", why, next_step)
        else:
            _log.warning("the %s is there now", part)
