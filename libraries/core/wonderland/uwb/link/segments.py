"""Frames of the link: layout, limits, and taking concatenated frames apart.

One frame is at most 80 octets, which fits the smallest in-band data unit seen on real nodes (84). Big-endian::

    offset 0   version (high nibble, 1) and kind (low nibble: 0 data, 1 acknowledgement)
           1   length of the whole frame, so that frames which a node concatenated can be taken apart
           2   addressee: 0 the UAV, 1 the pad, 2… further nodes; all responders of a session hear every frame
           3   session, 4 octets
           7   sequence number, 4 octets, per direction and kind
          11   index of the segment in its message
          12   number of segments of the message (0 in acknowledgements)
          13   AES-CCM ciphertext and 8-octet tag

The first 13 octets are authenticated, not encrypted. A message's id is the sequence number of its first segment.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from wonderland.uwb.link.errors import FrameError

VERSION: Final = 1
MAX_FRAME_OCTETS: Final = 80
TAG_OCTETS: Final = 8
HEADER: Final = struct.Struct(">BBB4sIBB")
MAX_TEXT_OCTETS: Final = MAX_FRAME_OCTETS - HEADER.size - TAG_OCTETS
MIN_FRAME_OCTETS: Final = HEADER.size + TAG_OCTETS
MAX_MESSAGE_OCTETS: Final = 4096
MAX_SEGMENTS: Final = -(-(1 + MAX_MESSAGE_OCTETS) // MAX_TEXT_OCTETS)
UAV_ADDRESS: Final = 0
PAD_ADDRESS: Final = 1


class FrameKind(IntEnum):
    """Low nibble of the first octet."""

    DATA = 0
    ACKNOWLEDGEMENT = 1


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame, parsed but not yet authenticated. ``header`` is the associated data of the cipher."""

    kind: FrameKind
    addressee: int
    session_id: bytes
    sequence: int
    index: int
    total: int
    header: bytes
    sealed: bytes


def encode_header(
    kind: FrameKind, addressee: int, session_id: bytes, *, sequence: int, index: int, total: int, text_octets: int
) -> bytes:
    """The 13 header octets of a frame whose plaintext has ``text_octets``."""
    length = HEADER.size + text_octets + TAG_OCTETS
    return HEADER.pack(VERSION << 4 | kind, length, addressee, session_id, sequence, index, total)


def split_frames(data: bytes) -> list[Frame]:
    """The frames in one data unit, which may hold several, one after the other.

    Raises ``FrameError`` on anything that is no whole frame; frames before the fault are lost with it, because a
    unit damaged in one place is trusted nowhere (the sender repeats them).
    """
    frames: list[Frame] = []
    at = 0
    while at < len(data):
        length = data[at + 1] if at + 1 < len(data) else 0
        if not MIN_FRAME_OCTETS <= length <= MAX_FRAME_OCTETS or at + length > len(data):
            raise FrameError(f"frame at octet {at}: a length of {length} with {len(data) - at} octets left")
        first, _, addressee, session_id, sequence, index, total = HEADER.unpack_from(data, at)
        if first >> 4 != VERSION or first & 0x0F not in (0, 1):
            raise FrameError(f"frame at octet {at}: version and kind 0x{first:02x} are unknown")
        kind = FrameKind(first & 0x0F)
        if (kind is FrameKind.DATA and not index < total <= MAX_SEGMENTS) or (
            kind is FrameKind.ACKNOWLEDGEMENT and (index or total)
        ):
            raise FrameError(f"frame at octet {at}: segment {index} of {total} is impossible")
        if kind is FrameKind.DATA and index > sequence:
            raise FrameError(f"frame at octet {at}: segment {index} cannot have sequence number {sequence}")
        body = at + HEADER.size
        frames.append(
            Frame(kind, addressee, session_id, sequence, index, total, data[at:body], data[body : at + length])
        )
        at += length
    return frames
