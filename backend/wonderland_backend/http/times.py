"""The clock, and times as U-space writes them: RFC 3339 in UTC, with ``Z``."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Final

_FIRST: Final = datetime(1970, 1, 1, tzinfo=UTC)


def now_ms() -> int:
    """Milliseconds since the Unix epoch."""
    return time.time_ns() // 1_000_000


def rfc3339(t_ms: int) -> str:
    """A time (Unix ms) with milliseconds."""
    return datetime.fromtimestamp(t_ms / 1000, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def unix_ms(text: str) -> int:
    """A time in RFC 3339 as Unix ms. Raises ValueError for another text, or one without its offset."""
    found = datetime.fromisoformat(text)
    if found.tzinfo is None:
        raise ValueError("a time without an offset; write Z")
    elapsed = found - _FIRST
    return elapsed.days * 86_400_000 + elapsed.seconds * 1000 + elapsed.microseconds // 1000
