"""While nobody asks for a proof, the anchors range each other: whether one has moved."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Final

from wonderland.proof_contract import AwayError, RefusedError

if TYPE_CHECKING:
    from wonderland_edge_agent.drift.keeper import DriftKeeper
    from wonderland_edge_agent.own_pad import OwnPad

_log = logging.getLogger(__name__)

FIRST_LOOK_S: Final = 5.0
"""After the start, once a roll has been called: exchanged ports shall not pass for long. Then as pad.toml says."""


async def watch_when_idle(drift: DriftKeeper, own: OwnPad, idle: asyncio.Event) -> None:
    """Look until cancelled, each time once ``idle`` is set."""
    await asyncio.sleep(min(FIRST_LOOK_S, drift.every_s))
    while True:
        try:
            await idle.wait()
            pad = await own.read()
            if pad.commissioning is not None and pad.commissioning_sha256 is not None:
                await drift.measure_and_judge(pad.commissioning_sha256, pad.commissioning)
        except (AwayError, RefusedError) as error:
            _log.debug("the anchors were not checked: %s", error)
        await asyncio.sleep(drift.every_s)
