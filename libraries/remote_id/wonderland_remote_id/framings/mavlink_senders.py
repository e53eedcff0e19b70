"""MAVLink's SYSTEM_UPDATE says where an operator is now, no more: it belongs to the System message before it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import replace
from typing import Any, Final

from wonderland_remote_id.decoding import decode
from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import OperatorLocationType
from wonderland_remote_id.framings.framed import Framed
from wonderland_remote_id.messages import Pack, System

MAX_SENDERS: Final = 256


class Senders:
    """The last System message of each sender, and its transmitter's address. Bounded in memory."""

    def __init__(self) -> None:
        self._last: OrderedDict[Hashable, tuple[str | None, System] | None] = OrderedDict()

    def take_frame(self, sender: Hashable, framed: Framed) -> None:
        """Note a frame. A sender that relays several drones leaves open whose operator an update would move."""
        decoded = decode(framed.frame)
        messages = decoded.messages if isinstance(decoded, Pack) else (decoded,)
        system = next((message for message in messages if isinstance(message, System)), None)
        if system is None:
            return
        now = framed.address, system
        known = self._last.pop(sender, now)
        self._last[sender] = now if known is not None and known[0] == framed.address else None
        if len(self._last) > MAX_SENDERS:
            self._last.popitem(last=False)

    def moved(self, sender: Hashable, **place: Any) -> Framed | None:
        """The System message with another place; None where nobody knows whose it is. Raises `RemoteIdError`."""
        known = self._last.get(sender, (None, System(operator_location=OperatorLocationType.LIVE_GNSS)))
        if known is None:
            return None
        address, system = known
        return Framed(encode(replace(system, **place)), "mavlink", address=address)
