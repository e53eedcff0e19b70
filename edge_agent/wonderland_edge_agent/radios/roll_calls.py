"""While nobody asks for a proof: whether all nodes that answer their commands also range."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final, Protocol

from wonderland.proof_contract import AwayError, RefusedError

if TYPE_CHECKING:
    from wonderland_edge_agent.own_pad import OwnPad

_log = logging.getLogger(__name__)

FIRST_S: Final = 1.0
"""After the start: until nodes that are there have been reset."""


class RollRadios(Protocol):
    """Nodes that can range each other."""

    async def call_roll(self, macs: Mapping[str, int]) -> None:
        """Look who ranges; ends at once where a session is opened."""


async def call_when_idle(radios: RollRadios, own: OwnPad, idle: asyncio.Event, every_s: float) -> None:
    """Call until cancelled, each time once ``idle`` is set."""
    await asyncio.sleep(min(FIRST_S, every_s))
    while True:
        try:
            await idle.wait()
            pad = await own.read()
            if pad.commissioning is not None:
                await radios.call_roll({anchor.anchor_id: anchor.mac for anchor in pad.commissioning.anchors})
        except (AwayError, RefusedError) as error:
            _log.debug("no roll was called: %s", error)
        await asyncio.sleep(every_s)
