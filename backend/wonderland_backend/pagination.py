"""Cursor pagination: a cursor is opaque to clients and says after which row the next page begins."""

from __future__ import annotations

import binascii
from base64 import urlsafe_b64decode, urlsafe_b64encode
from typing import Any, Final

import orjson

from wonderland.problems import said
from wonderland_backend.errors import BadRequest

MAX_CURSOR: Final = 512


def encode_cursor(*position: int | str) -> str:
    """The cursor of a position: the sort key of the last row of a page."""
    return urlsafe_b64encode(orjson.dumps(position)).rstrip(b"=").decode()


def decode_cursor(cursor: str, *kinds: type) -> tuple[Any, ...]:
    """The position in a cursor, its parts of these types. Raises `BadRequest`."""
    try:
        position = orjson.loads(urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (ValueError, binascii.Error):
        raise _refused() from None
    fits = isinstance(position, list) and len(position) == len(kinds)
    if not fits or any(type(part) is not kind for part, kind in zip(position, kinds, strict=True)):
        raise _refused()
    if any(isinstance(part, int) and abs(part) >= 1 << 63 for part in position):
        raise _refused()
    if any(isinstance(part, str) and "\x00" in part for part in position):
        raise _refused()
    return tuple(position)


def _refused() -> BadRequest:
    return BadRequest(
        said("bad_cursor"),
        ("query.cursor", said("bad_cursor_field")),
    )
