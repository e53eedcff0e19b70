"""Time for agents: milliseconds since the Unix epoch that never jump while a session runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

Clock = Callable[[], int]
"""Milliseconds since the Unix epoch."""

_NS_PER_MS: Final = 1_000_000


class SteadyClock:
    """The system's time, carried on by the monotonic clock from the last ``resync``.

    A session compares its own times with each other (timeouts, rounds) and with the ledger's; a step of the system
    clock in the middle of it must do neither harm. Between sessions ``resync`` takes the system's time over again.
    """

    def __init__(
        self, wall_ns: Callable[[], int] = time.time_ns, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._wall_ns = wall_ns
        self._monotonic_ns = monotonic_ns
        self._offset_ns = 0
        self.resync()

    def resync(self) -> int:
        """Take over the system's time; returns by how many milliseconds this clock jumped."""
        offset_ns = self._wall_ns() - self._monotonic_ns()
        jump_ns, self._offset_ns = offset_ns - self._offset_ns, offset_ns
        return jump_ns // _NS_PER_MS

    def __call__(self) -> int:
        """Now, in milliseconds since the Unix epoch."""
        return (self._offset_ns + self._monotonic_ns()) // _NS_PER_MS
