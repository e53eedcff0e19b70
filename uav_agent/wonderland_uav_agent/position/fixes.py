"""From messages of ROS 2 with a header (``NavSatFix``, ``Odometry``) to claims. Time is handed in. Pure.

A claim says no more than the message does: its time is that of the header, its accuracies are worked out from the
covariance, and a message without one is none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.receiver import MAX_AGE_MS

MAX_AHEAD_MS: Final = 500
"""So far the fix's clock may be ahead of this computer's."""
HORIZONTAL_95: Final = math.sqrt(5.991)
"""From one standard deviation of the worse direction to 95 % (χ², two degrees of freedom)."""
VERTICAL_95: Final = 1.96
BEYOND_ALL: Final = 1e9
BEYOND_ALL_M2: Final = 1e12
"""Larger numbers (and what is none) mean nothing, and would overflow."""
_UNKNOWN: Final = 0


class FixError(Exception):
    """A message that no claim may rest on; the text says why."""


def claim_of(fix: Any, now_ms: int, after_ms: int) -> Claim:
    """A fix as a claim; ``after_ms`` is the time of the one before. Raises FixError."""
    if fix.status.status < 0:
        raise FixError("the receiver has no fix")
    t_ms = time_of(fix.header, now_ms, after_ms)
    place = (fix.latitude, fix.longitude, fix.altitude)
    if not all(abs(each) <= BEYOND_ALL for each in place):
        raise FixError("latitude, longitude or altitude is no number, or a place nowhere")
    accuracies = accuracies_m(fix.position_covariance_type, [float(each) for each in fix.position_covariance])
    return claim_at(place, accuracies, t_ms)


def claim_at(place: tuple[float, float, float], accuracies: tuple[float, float], t_ms: int) -> Claim:
    """Degrees and metres above the ellipsoid; accuracies at 95 %, in metres. Raises FixError."""
    lat, lon, height_m = place
    horizontal_m, vertical_m = accuracies
    try:
        return Claim.parse(
            {
                "lat_e7": round(lat * 1e7),
                "lon_e7": round(lon * 1e7),
                "height_mm": round(height_m * 1_000),
                "accuracy_mm": max(1, math.ceil(horizontal_m * 1_000)),
                "height_accuracy_mm": max(1, math.ceil(vertical_m * 1_000)),
                "t_ms": t_ms,
            }
        )
    except ProofError as error:
        raise FixError(str(error)) from error


def time_of(header: Any, now_ms: int, after_ms: int) -> int:
    """When a message's content was so. Raises FixError where that is not now, or not after the one before."""
    t_ms = int(header.stamp.sec * 1_000 + header.stamp.nanosec // 1_000_000)
    if t_ms <= after_ms:
        raise FixError("its time is not after that of the fix before")
    if t_ms > now_ms + MAX_AHEAD_MS:
        raise FixError(f"its time is {(t_ms - now_ms) / 1_000:.1f} s ahead of this computer's clock")
    if t_ms < now_ms - MAX_AGE_MS:
        raise FixError(f"it is {(now_ms - t_ms) / 1_000:.1f} s old, by its own time")
    return t_ms


def accuracies_m(kind: int, covariance: Sequence[float]) -> tuple[float, float]:
    """Horizontal and vertical accuracy at 95 % of a covariance (east, north, up; m²). Raises FixError."""
    if kind == _UNKNOWN:
        raise FixError("it states no covariance (position_covariance_type 0), and so no accuracy")
    east, north, up = covariance[0], covariance[4], covariance[8]
    cross = (covariance[1] + covariance[3]) / 2
    sane = all(abs(each) <= BEYOND_ALL_M2 for each in covariance)
    if not sane or min(east, north, up) <= 0 or cross**2 > east * north:
        raise FixError("its covariance is none (a variance that is not above 0, or no number)")
    worst = (east + north) / 2 + math.hypot((east - north) / 2, cross)
    return HORIZONTAL_95 * math.sqrt(worst), VERTICAL_95 * math.sqrt(up)
