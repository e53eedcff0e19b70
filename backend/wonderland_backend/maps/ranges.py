"""One byte range of a request (RFC 9110, 14.2): all that a map's reader asks for."""

from __future__ import annotations

import re
from typing import Final

MAX_PART: Final = 16 << 20
"""No tile and no directory is larger; bytes."""
_RANGE: Final = re.compile(r"bytes=(\d{1,18})-(\d{0,18})")


class RangeError(Exception):
    """The range cannot be given."""


def parse(header: str | None, size: int) -> tuple[int, int]:
    """(first byte, how many) of a file of ``size`` bytes. Raises `RangeError` where it is too much, or elsewhere."""
    if header is None:
        if size > MAX_PART:
            raise RangeError(f"this archive is read in ranges of at most {MAX_PART} bytes")
        return 0, size
    found = _RANGE.fullmatch(header.strip())
    if found is None:
        raise RangeError("one range of the form bytes=first-last is understood")
    first = int(found.group(1))
    last = min(size - 1, int(found.group(2) or size - 1))
    if first >= size or last < first:
        raise RangeError(f"the archive has {size} bytes")
    if last - first + 1 > MAX_PART:
        raise RangeError(f"this archive is read in ranges of at most {MAX_PART} bytes")
    return first, last - first + 1
