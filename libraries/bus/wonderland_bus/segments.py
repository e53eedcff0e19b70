"""What goes over the bus for a channel: numbered pieces of a stream of bytes, and how much has been taken of the other.

Zenoh loses messages when a link ends, and may bring one twice; a channel ends at a gap, and leaves out what it has had.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from typing import Final

MAX_DATA_BYTES: Final = 64 * 1024
WINDOW: Final = 16
"""So many pieces may be under way, each way: whoever sends more than is taken is no peer of this protocol."""
_HEADER: Final = struct.Struct(">BQQQ")


class Kind(enum.IntEnum):
    """What a segment is."""

    DATA = 0
    CREDIT = 1
    """No data; its number is the one that the next data will have."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One message on the bus."""

    kind: Kind
    server: int
    """Which run of which backend is meant; 0 in the opening, when the agent does not know yet who will answer."""
    seq: int
    taken: int
    """How many of the other side's have been taken."""
    data: bytes = b""

    def encode(self) -> bytes:
        """As bytes."""
        return _HEADER.pack(self.kind, self.server, self.seq, self.taken) + self.data


class SegmentError(Exception):
    """Bytes that are no segment, or one that does not come next."""


def parse(message: bytes) -> Segment:
    """Raises `SegmentError`."""
    if not _HEADER.size <= len(message) <= _HEADER.size + MAX_DATA_BYTES:
        raise SegmentError(f"a message of {len(message)} bytes is no segment")
    kind, server, seq, taken = _HEADER.unpack_from(message)
    try:
        return Segment(Kind(kind), server, seq, taken, message[_HEADER.size :])
    except ValueError:
        raise SegmentError(f"a segment of the unknown kind {kind}") from None


class Numbers:
    """Both ways' numbers of one channel."""

    def __init__(self) -> None:
        self.sent = 0
        self.taken = 0
        self._expected = 0
        self._taken_by_other = 0

    @property
    def may_send(self) -> bool:
        """Whether the other side has room for one more."""
        return self.sent - self._taken_by_other < WINDOW

    def arrived(self, segment: Segment) -> bool:
        """Whether its data comes next; False where it was here before. Raises `SegmentError`."""
        if segment.taken > self.sent:
            raise SegmentError("the other side took what was never sent")
        self._taken_by_other = max(self._taken_by_other, segment.taken)
        if segment.seq > self._expected:
            raise SegmentError("something was lost on the way")
        if segment.kind is not Kind.DATA or segment.seq < self._expected:
            return False
        self._expected += 1
        return True
