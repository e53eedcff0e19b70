"""Frames as lines of hexadecimal digits, as serial receivers and capture files give them.

``[address [rssi]] frame``: the frame in hexadecimal (case, colons and blanks between bytes do not matter to a frame
that stands alone), optionally after the transmitter's address (``aa:bb:cc:dd:ee:ff``) and the signal strength in dBm.
The address lets a receiver tell two drones apart that send single messages.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from wonderland_remote_id.decoding import MAX_FRAME_BYTES
from wonderland_remote_id.errors import FramingError

MAX_LINE_CHARS: Final = 1024
_LINE: Final = re.compile(
    r"\s*(?:(?P<address>[0-9A-Fa-f]{2}(?::[0-9A-Fa-f]{2}){5})\s+(?:(?P<rssi>-?[0-9]{1,3})\s+)?)?(?P<frame>[0-9A-Fa-f:\s]+)\Z"
)


@dataclass(frozen=True, slots=True)
class FrameLine:
    """One frame as a receiver heard it; ``address`` is lower-case, ``rssi_dbm`` −128..20."""

    frame: bytes
    address: str | None = None
    rssi_dbm: int | None = None


def parse_line(line: str | bytes, max_bytes: int = MAX_FRAME_BYTES) -> FrameLine:
    """The frame in a line (its end included or not). Raises `FramingError`.

    ``max_bytes`` is larger where the line holds a packet around the frame.
    """
    if len(line) > MAX_LINE_CHARS + 3 * (max_bytes - MAX_FRAME_BYTES):
        raise FramingError(f"a line of {len(line)} characters; a frame needs at most {2 * max_bytes}")
    try:
        text = line if isinstance(line, str) else line.decode("ascii")
    except UnicodeDecodeError:
        raise FramingError("a line that is no ASCII text; is the baud rate right?") from None
    match = _LINE.match(text)
    if match is None:
        raise FramingError("a line that is no frame in hexadecimal digits")
    digits = re.sub(r"[:\s]", "", match["frame"])
    if len(digits) % 2:
        raise FramingError(f"{len(digits)} hexadecimal digits: the last byte is cut in half")
    if len(digits) > 2 * max_bytes:
        raise FramingError(f"{len(digits) // 2} bytes; a frame has at most {max_bytes}")
    rssi_dbm = int(match["rssi"]) if match["rssi"] else None
    if rssi_dbm is not None and not -128 <= rssi_dbm <= 20:
        raise FramingError(f"a signal strength of {rssi_dbm} dBm is outside -128..20")
    address = match["address"]
    return FrameLine(bytes.fromhex(digits), address.lower() if address else None, rssi_dbm)


def format_line(frame: bytes, address: str | None = None, rssi_dbm: int | None = None) -> str:
    """The line of a frame, without its end: the inverse of `parse_line`."""
    head = f"{address} " if address else ""
    if address and rssi_dbm is not None:
        head += f"{rssi_dbm} "
    return head + frame.hex()
