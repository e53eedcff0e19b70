"""How long to leave somebody alone who did not answer as it should."""

from __future__ import annotations

from email.utils import parsedate_to_datetime
from typing import Final

from wonderland_backend.http.times import unix_ms

LONGEST_RETRY_S: Final = 3_600.0
DEFAULT_RETRY_S: Final = 30.0


class Backoff:
    """Doubles with each failure, up to a limit; one success ends it."""

    def __init__(self, first_s: float = 1.0, longest_s: float = 60.0) -> None:
        self._first_s = first_s
        self._longest_s = longest_s
        self._failures = 0
        self.until_ms = 0

    def is_open(self, now_ms: int) -> bool:
        """Whether it may be asked now."""
        return now_ms >= self.until_ms

    def failed(self, now_ms: int, retry_s: float | None = None) -> None:
        """It failed; `retry_s` is what it asked for itself."""
        wait_s = min(self._longest_s, self._first_s * 2 ** min(self._failures, 20))
        self._failures += 1
        self.until_ms = now_ms + int(1000 * max(wait_s, retry_s or 0.0))

    def succeeded(self) -> None:
        """It answered: the next failure waits for the first, short time again."""
        self._failures = 0
        self.until_ms = 0


def retry_after_s(value: str | None, now_ms: int) -> float:
    """A `Retry-After` header (RFC 9110) in seconds from now, within bounds; without one, half a minute."""
    if value is None:
        return DEFAULT_RETRY_S
    if value.isdecimal() and len(value) < 10:
        return min(float(value), LONGEST_RETRY_S)
    try:
        t_ms = unix_ms(parsedate_to_datetime(value).isoformat())
    except ValueError:
        return DEFAULT_RETRY_S
    return min(max(0.0, (t_ms - now_ms) / 1000), LONGEST_RETRY_S)
