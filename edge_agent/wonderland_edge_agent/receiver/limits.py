"""How much a receiver takes: bounds that keep a flood of frames from filling memory or starving the agent."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverLimits:
    """Rates are frames a second with a burst of the same size, unless said otherwise.

    The defaults leave room for dozens of drones: the standard asks each for one position a second.
    """

    frames_per_s: int = 1_000
    frames_per_source_s: int = 500
    reserved_per_s: int = 200
    """Beside ``frames_per_s``, for transmitters that were there before a flood and send modestly."""
    modest_per_s: int = 20
    """More than this of one transmitter is no modest use of what is reserved."""
    positions_per_drone_s: int = 25
    positions_per_transmitter_s: int = 20
    """Of one drone: whoever broadcasts its serial number from one place leaves room for the drone's own."""
    new_drones_per_s: int = 10
    sources: int = 256
    newcomers: int = 1_024
    """Transmitters that were heard for less than a second."""
    drones: int = 256
    history: int = 64
    watched_history: int = 1_200
    identity_lifetime_ms: int = 10_000
    """A Basic ID comes every 3 s; one not repeated for this long no longer says whose the positions are."""


class TokenBucket:
    """Lets ``rate_per_s`` through, and at once no more than ``burst``. Time is passed in and may step back."""

    __slots__ = ("_burst_milli", "_last_ms", "_milli", "_rate")

    def __init__(self, rate_per_s: int, burst: int, now_ms: int) -> None:
        self._rate = rate_per_s
        self._burst_milli = burst * 1000
        self._milli = self._burst_milli
        self._last_ms = now_ms

    def take_token(self, now_ms: int) -> bool:
        """Whether one more may pass now."""
        elapsed_ms = now_ms - self._last_ms
        self._last_ms = now_ms
        if elapsed_ms > 0:
            self._milli = min(self._burst_milli, self._milli + elapsed_ms * self._rate)
        if self._milli < 1000:
            return False
        self._milli -= 1000
        return True
