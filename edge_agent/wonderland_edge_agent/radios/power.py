"""A node that hangs is given its power anew, by a command of the operator's (a USB hub's, a relay's)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from wonderland.clock import Clock
from wonderland_edge_agent.programs import run_program
from wonderland_edge_agent.radios.anchors import AnchorState

_log = logging.getLogger(__name__)

HANGS_MS: Final = 20_000
"""So long a node is left to the driver, which reconnects and resets it by itself."""
AGAIN_MS: Final = 120_000
LOOK_S: Final = 1.0
COMMAND_S: Final = 15.0

Command = tuple[str, ...]


class PowerCycles:
    """When which node's power is due to be cycled. Pure."""

    def __init__(self, hangs_ms: int = HANGS_MS, again_ms: int = AGAIN_MS) -> None:
        self._hangs_ms, self._again_ms = hangs_ms, again_ms
        self._since_ms: dict[str, int] = {}
        self._cycled_ms: dict[str, int] = {}

    def due(self, states: Sequence[AnchorState], now_ms: int) -> list[str]:
        """Anchors that have been of no use for so long, each not again for a while."""
        out: list[str] = []
        for state in states:
            if state.ranges:
                self._since_ms.pop(state.anchor_id, None)
                continue
            since_ms = self._since_ms.setdefault(state.anchor_id, now_ms)
            cycled_ms = self._cycled_ms.get(state.anchor_id)
            if now_ms - since_ms >= self._hangs_ms and (cycled_ms is None or now_ms - cycled_ms >= self._again_ms):
                self._cycled_ms[state.anchor_id] = now_ms
                out.append(state.anchor_id)
        return out


async def cycle_power(
    states: Callable[[], Sequence[AnchorState]],
    commands: Mapping[str, Command],
    clock: Clock,
    cycles: PowerCycles | None = None,
) -> None:
    """Until cancelled: run the command of each anchor that hangs. What goes wrong with it is logged."""
    cycles = cycles or PowerCycles()
    while True:
        for anchor_id in cycles.due([each for each in states() if each.anchor_id in commands], clock()):
            _log.warning("anchor %s hangs: its power is cycled (%s)", anchor_id, " ".join(commands[anchor_id]))
            problem = await run_program(commands[anchor_id], COMMAND_S)
            if problem:
                _log.error("anchor %s: its power was not cycled: %s", anchor_id, problem)
        await asyncio.sleep(LOOK_S)
