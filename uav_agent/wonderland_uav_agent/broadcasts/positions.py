"""The positions that a drone broadcast, for it to sign for; what they have to be whoever tells them."""

from __future__ import annotations

import logging
from collections import deque
from typing import Final

from wonderland.attested import attested_position
from wonderland.clock import Clock
from wonderland_remote_id import BasicId, IdType, Location, Message, RemoteIdError

_log = logging.getLogger(__name__)

OLDEST_MS: Final = 1_200
"""A position may be so old when it is sent: no older than an honest drone is excused for (600 ms at 95 %, twice)."""
EARLIEST_MS: Final = -200
"""And its time so far ahead of the agent's clock."""
MAX_SENT: Final = 256


class OwnPositions:
    """The last positions of one drone; one that another clock dated would be judged where the drone was not."""

    def __init__(self, uav_id: str, clock: Clock) -> None:
        self._uav_id = uav_id
        self._clock = clock
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=MAX_SENT)
        self.bad = 0
        """What came and is no Remote ID message."""
        self.foreign = 0
        """How often something was broadcast under another drone's number."""
        self.undated = 0
        """Positions without a time, or with one that is not the agent's."""

    def sent(self, since_ms: int) -> tuple[bytes, ...]:
        """Digests of the positions sent since then, oldest first, each once."""
        return tuple(dict.fromkeys(digest for sent_ms, digest in self._sent if sent_ms >= since_ms))

    def _dated(self, location: Location, now_ms: int) -> tuple[int, bytes] | None:
        """When it says that it was there, and its digest; None where that is not now."""
        found = attested_position(location, now_ms)
        if found is not None and EARLIEST_MS <= now_ms - found[0] <= OLDEST_MS:
            return found
        self.undated += 1
        if self.undated == 1:
            off = "has no place or time" if found is None else f"is dated {(found[0] - now_ms) / 1e3:+.1f} s"
            _log.warning("a broadcast %s by this drone’s clock, and is not signed for", off)
        return None

    def _count_bad(self, error: RemoteIdError) -> None:
        self.bad += 1
        if self.bad == 1:
            _log.warning("something from the Remote ID module is no message: %s", error)


def serials(messages: tuple[Message, ...]) -> set[str]:
    """The serial numbers in them."""
    return {
        message.uas_id.rstrip(" ")
        for message in messages
        if isinstance(message, BasicId) and message.id_type is IdType.SERIAL_NUMBER
    }
