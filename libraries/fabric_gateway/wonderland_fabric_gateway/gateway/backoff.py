"""Pauses between attempts: growing, limited, and random, so that many clients do not come back at the same moment."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


class Backoff:
    """The n-th pause is uniform in (0, min(`max_s`, `first_s` · 2ⁿ)] ("full jitter"), seconds."""

    def __init__(self, random_bytes: Callable[[int], bytes], *, first_s: float = 0.05, max_s: float = 2.0) -> None:
        self._random_bytes = random_bytes
        self._first_s = first_s
        self._max_s = max_s
        self._limit_s = first_s

    def next_s(self) -> float:
        """How long to wait now; the limit doubles for the next one."""
        fraction = (int.from_bytes(self._random_bytes(4), "big") + 1) / (1 << 32)
        limit_s, self._limit_s = self._limit_s, min(self._max_s, 2 * self._limit_s)
        return fraction * limit_s

    def reset(self) -> None:
        """Begin with a short pause again, after a success."""
        self._limit_s = self._first_s
