"""Datagrams between a drone with a DWM1001 tag and its pad: the board has no data channel of its own, so IP carries.

``type u8 | session u32 | sequence u32 | body | tag (16 octets)``, integers big-endian. The tag is HMAC-SHA-256, cut to
its first half (RFC 2104, section 5), over direction and datagram, with the session's radio key: only the two parties
of the session have it, and with this board nothing else needs it. Sequences rise, so that nothing is heard twice and
the pad can answer to wherever the last datagram came from.

* WORDS, both ways: one frame of ``wonderland.uwb.link``, which seals and repeats by itself.
* RANGES, drone → pad: ``count u8``, then for each anchor its short address u16 and the range in millimetres u32.
* HELLO, drone → pad: says where the drone is to be reached, and by its body (u16), where the pad's boards measure, the
  short address of the board that it carries.

None of it shows that the drone is near: that is why such a proof has assurance 0.
"""

from __future__ import annotations

import hashlib
import hmac
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from wonderland_fira_uci.dwm1001.errors import Dwm1001DecodeError, Dwm1001EncodeError
from wonderland_fira_uci.dwm1001.tlv import MAX_DISTANCES, MAX_RANGE_MM

MAX_BODY_OCTETS: Final = 256
TAG_OCTETS: Final = 16
_HEAD: Final = struct.Struct(">BII")
_RANGE: Final = struct.Struct(">HI")
_FROM_PAD: Final = b"wonderland/1 dwm1001 pad"
_FROM_UAV: Final = b"wonderland/1 dwm1001 uav"
MAX_DATAGRAM_OCTETS: Final = _HEAD.size + MAX_BODY_OCTETS + TAG_OCTETS


class Kind(IntEnum):
    """What a datagram carries."""

    WORDS = 1
    RANGES = 2
    HELLO = 3


@dataclass(frozen=True, slots=True)
class Words:
    """One frame of the link."""

    frame: bytes


@dataclass(frozen=True, slots=True)
class Ranges:
    """One round as the drone's tag measured it: (short address of the anchor, millimetres)."""

    rows: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Hello:
    """The drone is here. ``board``: the short address of the board that it carries, where it says it."""

    board: int | None = None


Content = Words | Ranges | Hello


class Carrier:
    """One side of one session. ``key``: the session's radio key. ``is_pad``: which side this is."""

    def __init__(self, key: bytes, session_id: int, *, is_pad: bool) -> None:
        self._key = key
        self._session_id = session_id
        self._own, self._peer = (_FROM_PAD, _FROM_UAV) if is_pad else (_FROM_UAV, _FROM_PAD)
        self._sent = 0
        self._heard = 0

    def words(self, frame: bytes) -> bytes:
        """A datagram with one frame. Raises Dwm1001EncodeError beyond 256 octets."""
        return self._seal(Kind.WORDS, frame)

    def ranges(self, rows: Sequence[tuple[int, int]]) -> bytes:
        """A datagram with one round. Raises Dwm1001EncodeError for more than 15 anchors or values that do not fit."""
        if len(rows) > MAX_DISTANCES or any(not 0 < range_mm <= MAX_RANGE_MM for _, range_mm in rows):
            raise Dwm1001EncodeError(f"ranges: at most {MAX_DISTANCES}, each from 1 to {MAX_RANGE_MM} mm")
        try:
            body = b"".join(_RANGE.pack(*row) for row in rows)
        except struct.error as error:
            raise Dwm1001EncodeError(f"ranges: {error}") from error
        return self._seal(Kind.RANGES, bytes((len(rows),)) + body)

    def hello(self, board: int | None = None) -> bytes:
        """A datagram that says where this drone is, and which board it carries."""
        return self._seal(Kind.HELLO, b"" if board is None else board.to_bytes(2, "big"))

    def open(self, datagram: bytes) -> Content:
        """What the peer sent. Raises Dwm1001DecodeError for anything that is not a new datagram of this session."""
        if not _HEAD.size + TAG_OCTETS <= len(datagram) <= MAX_DATAGRAM_OCTETS:
            raise Dwm1001DecodeError(f"datagram: {len(datagram)} octets")
        content, tag = datagram[:-TAG_OCTETS], datagram[-TAG_OCTETS:]
        kind, session_id, sequence = _HEAD.unpack_from(content)
        if session_id != self._session_id:
            raise Dwm1001DecodeError("datagram: of another session")
        if not hmac.compare_digest(tag, self._tag(self._peer, content)):
            raise Dwm1001DecodeError("datagram: its authentication tag is wrong")
        if sequence <= self._heard:
            raise Dwm1001DecodeError("datagram: heard before, or overtaken by a later one")
        self._heard = sequence
        body = content[_HEAD.size :]
        if kind == Kind.WORDS and body:
            return Words(body)
        if kind == Kind.RANGES and body and len(body) == 1 + body[0] * _RANGE.size and body[0] <= MAX_DISTANCES:
            rows = tuple(_RANGE.iter_unpack(body[1:]))
            if len({address for address, _ in rows}) == len(rows) and all(0 < mm <= MAX_RANGE_MM for _, mm in rows):
                return Ranges(rows)
        if kind == Kind.HELLO and len(body) in {0, 2}:
            return Hello(int.from_bytes(body, "big") if body else None)
        raise Dwm1001DecodeError(f"datagram: type {kind} with {len(body)} octets makes no sense")

    def _seal(self, kind: Kind, body: bytes) -> bytes:
        if len(body) > MAX_BODY_OCTETS:
            raise Dwm1001EncodeError(f"datagram: {len(body)} octets; at most {MAX_BODY_OCTETS} are allowed")
        self._sent += 1
        content = _HEAD.pack(kind, self._session_id, self._sent) + body
        return content + self._tag(self._own, content)

    def _tag(self, direction: bytes, content: bytes) -> bytes:
        return hmac.new(self._key, direction + content, hashlib.sha256).digest()[:TAG_OCTETS]
