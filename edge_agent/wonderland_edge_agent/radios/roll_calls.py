"""While nobody asks for a proof: whether all nodes that answer their commands also range."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, Protocol

from wonderland.proof_contract import AwayError, RefusedError
from wonderland_edge_agent.radios.between import channel_of

if TYPE_CHECKING:
    from wonderland_edge_agent.own_pad import OwnPad

_log = logging.getLogger(__name__)

FIRST_S: Final = 1.0
"""After the start: until nodes that are there have been reset."""
AGAIN_S: Final = 1.0
"""After a call that nobody answered (a bad moment of the air is no fault of all nodes), or that a session ended."""


class RollRadios(Protocol):
    """Nodes that can range each other."""

    async def call_roll(self, macs: Mapping[str, int], channel: int, *, expected: bool = False) -> bool | None:
        """Look who ranges; ends at once where a session is opened. Whether any was heard; None where nobody looked."""

    @property
    def roll_wanted(self) -> bool:
        """Whether a node has come back since the last call, so that waiting for the next one hides what is known."""
        ...


async def _pause(radios: RollRadios, seconds: float) -> None:
    """So long, or until a call is wanted."""
    until_s = asyncio.get_running_loop().time() + seconds
    while (left_s := until_s - asyncio.get_running_loop().time()) > 0:
        await asyncio.sleep(min(AGAIN_S, left_s))
        if radios.roll_wanted:
            return


async def call_when_idle(
    radios: RollRadios, own: OwnPad, idle: asyncio.Event, every_s: float, hear_each_other: Callable[[str], bool]
) -> None:
    """Call until cancelled, each time once ``idle`` is set.

    ``hear_each_other``: whether anchors did when they were commissioned so (its SHA-256). Where they did, then or in a
    call since, and in two calls running no more, all of them are at fault; else they may stand so.
    """
    await asyncio.sleep(min(FIRST_S, every_s))
    heard_of, silent = "", False
    while True:
        again_s = every_s
        try:
            await idle.wait()
            pad = await own.read()
            if pad.commissioning is not None and pad.commissioning_sha256 is not None:
                sha256 = pad.commissioning_sha256
                macs = {anchor.anchor_id: anchor.mac for anchor in pad.commissioning.anchors}
                expected = silent and (heard_of == sha256 or await asyncio.to_thread(hear_each_other, sha256))
                heard = await radios.call_roll(macs, channel_of(pad.commissioning), expected=expected)
                if heard:
                    heard_of = sha256
                elif heard is None or not silent:
                    again_s = min(AGAIN_S, every_s)
                silent = silent if heard is None else not heard
        except (AwayError, RefusedError) as error:
            _log.debug("no roll was called: %s", error)
        await _pause(radios, again_s)
