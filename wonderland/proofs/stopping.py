"""When to stop ranging: after which rounds a pad looks, and how many more would settle it."""

from __future__ import annotations

from math import sqrt
from typing import Final

from wonderland.proofs.estimate import Offset

LOOKS: Final = (10, 20, 40, 80, 160)
"""Rounds after which a pad may look whether the session is settled."""
LOOK_Z: Final = 2.83
"""Standard deviations that hold 1 % error at each side under these five looks (simulated; ``docs/method.md``)."""
SINGLE_Z: Final = 2.3263478740408408
"""Standard deviations of 1 % in a single look."""
LOOK_INFLATION: Final = (LOOK_Z * LOOK_Z) / (SINGLE_Z * SINGLE_Z)
"""Looking five times costs this factor of variance."""
MAX_MORE_ROUNDS: Final = 10_000


def more_rounds(offset: Offset, rounds: int, radius_mm: float) -> int:
    """Further rounds expected to settle it; −1 where the part that does not shrink is already too large."""
    distance = sqrt(offset.east * offset.east + offset.north * offset.north)
    if distance > 1.0:
        east, north = offset.east / distance, offset.north / distance
    else:
        axes = offset.covariance.ellipse()
        east, north = axes.east, axes.north
    floor = offset.floor.along(east, north)
    white = (offset.covariance.along(east, north) - floor) * rounds
    margin = (radius_mm - distance) / LOOK_Z
    room = margin * margin - floor
    if room <= 0.0:
        return -1
    needed = white / room
    if needed > MAX_MORE_ROUNDS:
        return -1
    return max(int(needed) + 1 - rounds, 0)
