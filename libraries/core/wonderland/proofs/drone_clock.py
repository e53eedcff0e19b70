"""The drone's clock against the pad's, from the echoes of the pad's challenge.

Each reading bounds it: what the drone said at ``uav_ms`` the pad heard by ``heard_ms``, and where it was an answer, the
drone cannot have said it before ``asked_ms``. So the offset (drone's clock minus the pad's) lies between
max(uav − heard) and min(uav − asked), whatever the drone says: a false time moves both bounds, a late answer only
widens them. The claims are shifted by the middle, which is to say that they are judged where the drone was when it
*said* them; a clock so far off that this matters is a reason not to verify.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.reasons import nearest
from wonderland.proofs.records.sessions import Claim, ClockReading
from wonderland.proofs.reduction import CLAIM_CLOCK_SIGMA_MS

HONEST_MS: Final = 2.0 * CLAIM_CLOCK_SIGMA_MS
"""A drone with GNSS time or NTP keeps to this; an offset within it needs no proof."""
FINEST_MS: Final = 10.0
"""No better is known when a claimed position held: receivers date their fixes to hundredths of a second."""
EXCUSED_SHARE: Final = 0.25
"""A clock's error may explain this share of the buffer, at the drone's speed."""


@dataclass(frozen=True, slots=True)
class Clock:
    """What is known of the offset, in ms."""

    offset_ms: float
    sigma_ms: float
    beyond_ms: float
    """How far the clock is off at least; 0 where it may be as good as an honest one's."""
    contradictory: bool
    """No clock gives these readings."""
    readings: int


UNKNOWN: Final = Clock(0.0, CLAIM_CLOCK_SIGMA_MS, 0.0, contradictory=False, readings=0)


def drone_clock(readings: Sequence[ClockReading]) -> Clock:
    """The offset and its standard deviation; without readings that of an honest clock."""
    if not readings:
        return UNKNOWN
    lowest = max(float(reading.uav_ms - reading.heard_ms) for reading in readings)
    asked = [float(reading.uav_ms - reading.asked_ms) for reading in readings if reading.asked_ms is not None]
    if not asked:
        if lowest <= HONEST_MS:
            return Clock(0.0, CLAIM_CLOCK_SIGMA_MS, 0.0, contradictory=False, readings=len(readings))
        return Clock(lowest, CLAIM_CLOCK_SIGMA_MS, lowest, contradictory=False, readings=len(readings))
    highest = min(asked)
    if lowest > highest:
        return Clock(0.0, CLAIM_CLOCK_SIGMA_MS, 0.0, contradictory=True, readings=len(readings))
    beyond = 0.0
    low, high = max(lowest, -HONEST_MS), min(highest, HONEST_MS)
    if low > high:
        low, high = lowest, highest
        beyond = low if low > 0.0 else -high
    # Anywhere between the bounds: a uniform distribution.
    sigma = max((high - low) / sqrt(12.0), FINEST_MS)
    return Clock(0.5 * (low + high), sigma, beyond, contradictory=False, readings=len(readings))


def on_the_pads_clock(claims: Sequence[Claim], clock: Clock) -> tuple[Claim, ...]:
    """The claims with the times that they have by the pad's clock."""
    offset_ms = nearest(clock.offset_ms)
    if offset_ms == 0:
        return tuple(claims)
    return tuple(replace(claim, t_ms=max(claim.t_ms - offset_ms, 0)) for claim in claims)
