"""NatNet, as OptiTrack's Motive streams it: where rigid bodies are. Versions 2.6 to 4.x.

The layout is that of NatNet's SDK (PacketClient). Everything is little-endian; up to the rigid bodies, which is as far
as is read here. Lengths are checked before they are believed: anybody can send a datagram.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Final

from wonderland_edge_agent.references import LARGEST_M, Point, PositionError

COMMAND_PORT: Final = 1510
CONNECT: Final = struct.pack("<HH256s4B4B", 0, 264, b"Wonderland", 4, 1, 0, 0, 4, 1, 0, 0)
"""A name, and twice the version that is understood, as the SDK sends it: servers read all of it."""
KEEP_ALIVE: Final = struct.pack("<HH", 10, 1) + b"\0"
_SERVER_INFO: Final = 1
_FRAME: Final = 7
_NAME_OCTETS: Final = 256
_OLDEST: Final = (2, 6)
_WITHOUT_MARKERS: Final = (3, 0)
"""From here on a rigid body's markers are in its description."""
_WITH_SIZES: Final = (4, 1)
"""From here on each list says how long it is."""
_TRACKED: Final = 1


@dataclass(frozen=True, slots=True)
class Server:
    """What a server says of itself; ``group``: where its frames go, where that is many at once."""

    version: tuple[int, int]
    group: tuple[str, int] | None


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body of a frame; None where it was not tracked. East, north, up (m), for a Motive whose y points up."""

    body_id: int
    point: Point | None


def server_info(packet: bytes) -> Server | None:
    """None for another message. Raises PositionError for a server that is too old, or an answer that is none."""
    kind, reader = _message(packet)
    if kind != _SERVER_INFO:
        return None
    reader.skip(_NAME_OCTETS + 4)
    major, minor, _, _ = reader.take("4B")
    if (major, minor) < _OLDEST:
        raise PositionError(f"NatNet {major}.{minor} is too old; 2.6 is the least")
    group = None
    if (major, minor) >= _WITHOUT_MARKERS and reader.left >= 15:
        _, port, many = reader.take("QH?")
        address = IPv4Address(reader.octets(4))
        if many and not address.is_multicast:
            raise PositionError(f"the NatNet server names {address} as where its frames go to many")
        group = (str(address), int(port)) if many else None
    return Server((int(major), int(minor)), group)


def bodies(packet: bytes, version: tuple[int, int]) -> tuple[Body, ...] | None:
    """The rigid bodies of a frame; None for another message. Raises PositionError for one that cannot be read."""
    kind, reader = _message(packet)
    if kind != _FRAME:
        return None
    reader.skip(4)  # number
    for _ in reader.list(version):  # marker sets
        reader.text()
        reader.skip(12 * reader.count())
    reader.skip(12 * len(reader.list(version)))  # markers of no set
    return tuple(_body(reader, version) for _ in reader.list(version))


def _body(reader: _Reader, version: tuple[int, int]) -> Body:
    body_id, x, y, z = reader.take("I3f")
    reader.skip(16)  # rotation
    if version < _WITHOUT_MARKERS:
        markers = reader.count()
        reader.skip(20 * markers)  # positions, ids, sizes
    reader.skip(4)  # mean error
    (state,) = reader.take("H")
    known = int(state) & _TRACKED and all(math.isfinite(each) and abs(each) < LARGEST_M for each in (x, y, z))
    return Body(int(body_id), (x, -z, y) if known else None)


def _message(packet: bytes) -> tuple[int, _Reader]:
    reader = _Reader(packet)
    kind, size = reader.take("HH")
    if size > reader.left:
        raise PositionError("a NatNet message that was cut off")
    return int(kind), reader


class _Reader:
    """Takes one thing after another. Raises PositionError at the end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def octets(self, count: int) -> bytes:
        if count > self.left:
            raise PositionError("a NatNet message that ends too soon")
        self._at += count
        return self._data[self._at - count : self._at]

    def skip(self, count: int) -> None:
        self.octets(count)

    def take(self, form: str) -> tuple[float, ...] | tuple[int, ...]:
        return struct.unpack(f"<{form}", self.octets(struct.calcsize(f"<{form}")))

    def count(self) -> int:
        (count,) = self.take("I")
        return int(count)

    def list(self, version: tuple[int, int]) -> range:
        """As many turns as the list says that it has entries."""
        count = self.count()
        if version >= _WITH_SIZES:
            self.skip(4)
        if count > self.left:
            raise PositionError("a NatNet message that ends too soon")
        return range(count)

    def text(self) -> None:
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise PositionError("a NatNet message that ends too soon")
        self._at = end + 1
