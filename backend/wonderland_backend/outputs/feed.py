"""Live items for an output that runs for as long as the server does."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from typing import Final

import orjson

from wonderland_backend.live.hub import GOING_AWAY, Hub
from wonderland_backend.outputs.items import Gate, Item, items_of

logger = logging.getLogger(__name__)

AGAIN_S: Final = 1.0


async def items(hub: Hub, gate: Gate) -> AsyncIterator[Item]:
    """What there is, then what comes, until the server stops.

    Whoever takes them too slowly loses positions, as every slow client does; verdicts come again with the next
    snapshot, and the gate knows which were told.
    """
    while True:
        client = hub.join("", None)
        try:
            while (frame := await client.next_frame()) is not None:
                for item in items_of(orjson.loads(frame)):
                    if gate.lets_through(item):
                        yield item
        finally:
            hub.leave(client)
        if client.close_code == GOING_AWAY:
            return
        logger.warning("an output was too slow and begins anew with what there is now")
        await asyncio.sleep(AGAIN_S)
