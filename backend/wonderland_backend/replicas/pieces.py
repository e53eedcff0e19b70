"""What is longer than one message of the bus goes in pieces. Pure."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from typing import Final

import msgspec

PIECE_BYTES: Final = 96 * 1024
"""Below what the bus takes at once, with room for what stands around it."""
MOST_BEGUN: Final = 64


class Label(msgspec.Struct, frozen=True, array_like=True):
    """Which piece of what."""

    of: bytes
    index: int
    count: int


def cut(data: bytes, name: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Pieces, each with its label."""
    count = max(1, -(-len(data) // PIECE_BYTES))
    for index in range(count):
        piece = data[index * PIECE_BYTES : (index + 1) * PIECE_BYTES]
        yield piece, msgspec.msgpack.encode(Label(name, index, count))


def label_of(data: bytes) -> Label:
    """Raises `ValueError`."""
    return msgspec.msgpack.decode(data, type=Label)


class Assembly:
    """Puts pieces together, which come in order; of what misses one nothing comes."""

    def __init__(self, most_bytes: int) -> None:
        """`most_bytes`: of everything that is begun, together."""
        self._most_bytes = most_bytes
        self._bytes = 0
        self._begun: OrderedDict[bytes, list[bytes]] = OrderedDict()

    def take(self, label: Label, piece: bytes) -> bytes | None:
        """The whole, with its last piece. Raises `ValueError` for a piece that does not follow, or is too much."""
        if label.index == 0:
            self._forget(label.of)
            self._begun[label.of] = []
        pieces = self._begun.get(label.of)
        if pieces is None or len(pieces) != label.index or label.index >= label.count:
            self._forget(label.of)
            raise ValueError("a piece is missing")
        pieces.append(piece)
        self._bytes += len(piece)
        if label.index + 1 == label.count:
            self._forget(label.of)
            return b"".join(pieces)
        while len(self._begun) > MOST_BEGUN or self._bytes > self._most_bytes:
            self._forget(next(iter(self._begun)))
        return None

    def _forget(self, name: bytes) -> None:
        self._bytes -= sum(map(len, self._begun.pop(name, ())))
