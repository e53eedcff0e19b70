"""What backends say to one another, in MessagePack. Pure."""

from __future__ import annotations

import zlib
from typing import Any, Final

import msgspec

from wonderland_backend.live.aside import Aside
from wonderland_backend.live.hub import PACKING_LEVEL, Frame

MAX_FRAME_BYTES: Final = 64 << 20
"""Of a frame, or a part of a snapshot, unpacked: 20,000 positions are 5 MB."""


class UnansweredError(Exception):
    """No answer came. `asked`: whether somebody may have got the question all the same."""

    def __init__(self, why: str, *, asked: bool) -> None:
        super().__init__(why)
        self.asked = asked


class Told(msgspec.Struct, frozen=True, array_like=True):
    """A frame of the live interface, as its number in an epoch."""

    epoch: str
    seq: int
    packed: bytes
    aside: Aside

    @classmethod
    def of(cls, epoch: str, frame: Frame) -> Told:
        """On its way."""
        return cls(epoch, frame.seq, zlib.compress(frame.text.encode(), PACKING_LEVEL), frame.aside)

    def frame(self) -> Frame:
        """As it was. Raises `ValueError`."""
        return Frame(self.seq, unpacked(self.packed), self.aside)


class Wanted(msgspec.Struct, frozen=True, array_like=True):
    """Asks for the state: what came after this place, or all of it."""

    epoch: str = ""
    seq: int = 0


class State(msgspec.Struct, frozen=True, array_like=True):
    """Where the backend on duty is, and how to come there."""

    epoch: str
    seq: int
    frames: list[Told] | None
    """What was missed; None where a snapshot is there instead."""
    parts: list[bytes]
    """Of the snapshot, packed."""
    owners: Aside


class Request(msgspec.Struct, frozen=True, array_like=True):
    """A request that another backend was asked, with all that is known of who asks."""

    method: str
    path: str
    raw_path: bytes
    query: bytes
    headers: list[tuple[bytes, bytes]]
    body: bytes
    scheme: str
    server: tuple[str, int | None] | None
    client: tuple[str, int] | None
    """As the nearest proxy that the other backend trusts says."""
    peer_address: str
    peer_certificate: bytes | None
    peer_encrypted: bool


class Answer(msgspec.Struct, frozen=True, array_like=True):
    """What the one on duty answered."""

    status: int
    headers: list[tuple[bytes, bytes]]
    body: bytes


_encoder = msgspec.msgpack.Encoder()


def encode(message: msgspec.Struct) -> bytes:
    """As bytes."""
    return _encoder.encode(message)


def decode(kind: Any, data: bytes) -> Any:
    """The message of this kind. Raises `msgspec.MsgspecError`, a `ValueError`."""
    return msgspec.msgpack.decode(data, type=kind)


def packed(text: str) -> bytes:
    """As `Told.packed` is."""
    return zlib.compress(text.encode(), PACKING_LEVEL)


def unpacked(data: bytes) -> str:
    """Raises `ValueError` for what is no text that was packed, or too long."""
    unpacking = zlib.decompressobj()
    try:
        text = unpacking.decompress(data, MAX_FRAME_BYTES)
    except zlib.error as cause:
        raise ValueError(str(cause)) from None
    if not unpacking.eof:
        raise ValueError("cut off, or too long")
    return text.decode()
