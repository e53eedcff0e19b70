"""The size of an image by its header alone: nothing is decoded."""

from __future__ import annotations

import struct
from collections.abc import Iterator


def image_size(raw: bytes) -> tuple[str, int, int]:
    """Media type, width and height in pixels by the header alone; an empty type where it is neither PNG nor JPEG."""
    if raw[:8] == b"\x89PNG\r\n\x1a\n" and raw[12:16] == b"IHDR" and len(raw) >= 24:
        width, height = struct.unpack(">II", raw[16:24])
        return "image/png", width, height
    for marker, body in _jpeg_segments(raw):
        if 0xC0 <= marker <= 0xCF and marker not in {0xC4, 0xC8, 0xCC} and len(body) >= 5:
            height, width = struct.unpack(">HH", body[1:5])
            return "image/jpeg", width, height
    return "", 0, 0


def _jpeg_segments(raw: bytes) -> Iterator[tuple[int, bytes]]:
    if raw[:2] != b"\xff\xd8":
        return
    at = 2
    while at + 4 <= len(raw) and raw[at] == 0xFF:
        marker, (length,) = raw[at + 1], struct.unpack(">H", raw[at + 2 : at + 4])
        if marker == 0xDA or length < 2:
            return
        yield marker, raw[at + 4 : at + 2 + length]
        at += 2 + length
