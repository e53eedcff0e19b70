"""The autopilot's time since boot, as UTC."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from wonderland.proofs.records.fields import MAX_TIME_MS

EARLIEST_MS: Final = 1_577_836_800_000
"""2020: an autopilot whose time is earlier has not been told the time yet (0, or since 1970)."""
REORDERED_MS: Final = 1_000
"""Messages overtake each other by less than this; what goes back further has booted again."""
JUMP_MS: Final = 2_000
SKEW_MS: Final = 200
"""Claims are compared with ranges by time; at 10 m/s this is two metres, and a short session is over in 400 ms."""
PATIENCE_MS: Final = 3_000
"""SYSTEM_TIME comes once a second. A position dated without it would be followed by one dated earlier, or later."""


class BootTime:
    """Maps ``time_boot_ms`` to UTC by the last SYSTEM_TIME; where none comes, the arrival's time stands in.

    A boot time that goes back, or moves otherwise than this computer's clock, belongs to another boot: forgotten is
    then what mapped the one before.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._warned = False
        self._last_boot_ms = 0
        self._first_ms: int | None = None
        self._said = False
        """Whether it has said what time it is, or that it does not know."""
        self._anchor_ms: int | None = None
        self._unix_at_boot_ms: int | None = None
        self.skew_ms: int | None = None
        """How far the autopilot's UTC is ahead of this computer's clock, by the last SYSTEM_TIME."""
        self.resets = 0

    def follows(self, boot_ms: int, arrived_ms: int) -> bool:
        """Note the time of a message; False where it is of another boot than those before."""
        if self._first_ms is None:
            self._first_ms = arrived_ms
        booted_ms, last_boot_ms = arrived_ms - boot_ms, self._last_boot_ms
        self._last_boot_ms = boot_ms
        anchor_ms = booted_ms if self._anchor_ms is None else self._anchor_ms
        self._anchor_ms = anchor_ms
        if boot_ms - last_boot_ms >= -REORDERED_MS and abs(booted_ms - anchor_ms) <= JUMP_MS:
            return True
        self._anchor_ms = booted_ms
        self._first_ms, self._said = arrived_ms, False
        self._unix_at_boot_ms = self.skew_ms = None
        self._warned = False
        self.resets += 1
        return False

    def set(self, unix_us: int, boot_ms: int, arrived_ms: int) -> None:
        """Take over the autopilot's UTC, if it has one."""
        unix_ms = unix_us // 1_000
        self._said = True
        if not EARLIEST_MS <= unix_ms <= MAX_TIME_MS:
            return
        self._unix_at_boot_ms = unix_ms - boot_ms
        self._anchor_ms = arrived_ms - boot_ms  # Crystals drift apart, by seconds in a day.
        self.skew_ms = unix_ms - arrived_ms
        if abs(self.skew_ms) > SKEW_MS and not self._warned:
            self._warned = True
            self._warn(
                f"the autopilot’s time is {abs(self.skew_ms)} ms {'ahead of' if self.skew_ms > 0 else 'behind'} this "
                "computer’s (or its messages come late); claims bear the autopilot’s: set both by GNSS or NTP"
            )

    def utc_ms(self, boot_ms: int, arrived_ms: int) -> int | None:
        """When a message's content was so; None while the autopilot's time may yet come."""
        if self._unix_at_boot_ms is not None:
            return self._unix_at_boot_ms + boot_ms
        waited_ms = 0 if self._first_ms is None else arrived_ms - self._first_ms
        return arrived_ms if self._said or waited_ms >= PATIENCE_MS else None
