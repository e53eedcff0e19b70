"""Attempts to sign in, counted by address."""

from __future__ import annotations

from typing import Annotated, Final

from wonderland.problems import said
from wonderland_backend.context import part
from wonderland_backend.errors import TooManyRequests

WINDOW_MS: Final = 60_000
MAX_ADDRESSES: Final = 10_000


class Attempts:
    """Counts attempts by address, in this process, in windows of a minute."""

    def __init__(self, per_minute: int) -> None:
        self._per_minute = per_minute
        self._began_ms = 0
        self._counts: dict[str, int] = {}

    def count(self, address: str, now_ms: int) -> None:
        """One more attempt from an address. Raises `TooManyRequests` beyond the minute's allowance."""
        if not 0 <= now_ms - self._began_ms < WINDOW_MS or len(self._counts) >= MAX_ADDRESSES:
            self._began_ms = now_ms
            self._counts = {}
        self._counts[address] = self._counts.get(address, 0) + 1
        if self._counts[address] > self._per_minute:
            wait_s = max(1, (self._began_ms + WINDOW_MS - now_ms) // 1000)
            raise TooManyRequests(
                said("too_many_attempts", wait_s=wait_s),
                headers={"Retry-After": str(wait_s)},
            )


AttemptsDep = Annotated[Attempts, part(Attempts)]
