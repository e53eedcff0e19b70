"""When to stop ranging: what holds however often a pad looks, after which rounds it does, how many more would help.

A pad that looks until it likes what it sees would be wrong far more often than each look says. So an outcome needs a
*sequential* proof: the likelihood ratio between a design alternative, a fixed distance on this side of the buffer's
edge, and the nearest point on the other side of the edge. In standard deviations, with D the distance from the
estimate to that point and η the alternative's, it is exp(ηD − η²/2); Wald's bound lets it exceed 1/α with probability
α at most, at whichever rounds one looks. Several alternatives share α by weights. The covariance is the whole one:
with the bias integrated out this still is a ratio of likelihoods, so that the floor is treated exactly.

The weights add up to more than one because real rounds overshoot Wald's bound. They were chosen by simulation so that
a drone exactly on the edge, looked at after *every* round from the fifth to the five hundredth, is verified with at
most 1 % and refuted with at most 1 % (``tests/bench/test_verdict_statistics.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import sqrt
from typing import Final

from wonderland.proofs.estimate import Offset
from wonderland.proofs.likelihood import LARGE_DISTANCE, Matrix2, distance_to_disc, distance_to_outside
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.special import exp_negative

LOOKS: Final = (10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60, 72, 86, 103, 124, 149, 160)
"""Rounds after which a pad looks whether the session is settled; the error rates would hold at every round."""
INSIDE: Final = ((1.0, 1.42), (0.5, 0.52))
"""Alternatives to "outside": (distance within the edge in buffers, weight). The first is the claim itself."""
OUTSIDE: Final = ((1.0, 1.0), (2.0, 0.6))
"""Alternatives to "inside": lies of two and of three buffers."""
ANYWHERE_WEIGHT: Final = 0.153
"""Weight of the alternative at the estimate itself: for what lies between or beyond the design alternatives."""
MAX_MORE_ROUNDS: Final = 10_000
_HOPE_SIGMAS: Final = 2.0
"""How far the estimate may still move, in standard deviations of the part that shrinks."""
_LARGEST_EXPONENT: Final = 700.0
_HALVINGS: Final = 60

Alternatives = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Sides:
    """What one estimate proves about one claim, whenever one looks."""

    inside: bool
    outside: bool
    significance: float
    """Standard deviations between the estimate and the nearest point of the buffer; 0 inside it."""


def sides(east: float, north: float, covariance: Matrix2, policy: Policy) -> Sides:
    """Whether a drone at this offset from its claim is proved within the buffer, or outside of it."""
    radius = float(policy.buffer_mm)
    s1 = covariance.ellipse().s1
    significance = distance_to_disc(east, north, covariance, radius)
    if significance > 0.0:
        return Sides(inside=False, outside=proved_outside(significance, s1, policy), significance=significance)
    depth = distance_to_outside(east, north, covariance, radius)
    inside = depth >= _needed(INSIDE, _alpha(1_000_000 - policy.verify_ppm), radius, s1)
    return Sides(inside=inside, outside=False, significance=0.0)


def proved_outside(significance: float, s1: float, policy: Policy) -> bool:
    """Whether a distance to the buffer (σ) of an estimate known to ``s1`` mm refutes, whenever one looks."""
    return significance >= _needed(OUTSIDE, _alpha(policy.refute_ppm), float(policy.buffer_mm), s1)


def more_rounds(offset: Offset, rounds: int, policy: Policy) -> int:
    """Further rounds expected to settle it; −1 where the part that does not shrink forbids any outcome.

    None can settle it only if none could from anywhere that the estimate may still move to.
    """
    axes = offset.covariance.ellipse()
    floor = offset.floor.along(axes.east, axes.north)
    white = max(offset.covariance.along(axes.east, axes.north) - floor, 0.0)
    distance = sqrt(offset.east * offset.east + offset.north * offset.north)
    total = rounds_needed(distance, white * rounds, floor, policy)
    if total < 0:
        reach = _HOPE_SIGMAS * sqrt(white)
        total = max(
            rounds_needed(max(distance - reach, 0.0), white * rounds, floor, policy),
            rounds_needed(distance + reach, white * rounds, floor, policy),
        )
        if total < 0:
            return -1
        total = max(total, 2 * rounds)
    return min(max(total - rounds, 1), MAX_MORE_ROUNDS)


def rounds_needed(away_mm: float, white_mm2: float, floor_mm2: float, policy: Policy) -> int:
    """Rounds that settle a drone this far from its claim; −1 where none do.

    ``white_mm2``: variance along the ellipse's long axis that one round leaves; ``floor_mm2``: what never shrinks.
    """
    radius = float(policy.buffer_mm)
    if away_mm <= radius:
        alternatives, alpha, margin = INSIDE, _alpha(1_000_000 - policy.verify_ppm), radius - away_mm
    else:
        alternatives, alpha, margin = OUTSIDE, _alpha(policy.refute_ppm), away_mm - radius
    room = _largest_variance(alternatives, alpha, radius, margin) - floor_mm2
    if room <= 0.0 or white_mm2 > room * MAX_MORE_ROUNDS:
        return -1
    return int(white_mm2 / room) + 1


def _alpha(ppm: int) -> float:
    return ppm / 1_000_000.0


def _needed(alternatives: Alternatives, alpha: float, radius: float, s1: float) -> float:
    """Distance in standard deviations that proves a side."""
    if s1 <= 0.0:
        return 0.0
    best = sqrt(2.0 * _log_inverse(alpha * ANYWHERE_WEIGHT))
    for distance, weight in alternatives:
        eta = distance * radius / s1
        best = min(best, _log_inverse(alpha * weight) / eta + 0.5 * eta)
    return best


def _largest_variance(alternatives: Alternatives, alpha: float, radius: float, margin: float) -> float:
    """Largest variance (mm²) with which a margin (mm) to the edge proves a side."""
    best = margin * margin / (2.0 * _log_inverse(alpha * ANYWHERE_WEIGHT))
    for distance, weight in alternatives:
        delta = distance * radius
        best = max(best, delta * (margin - 0.5 * delta) / _log_inverse(alpha * weight))
    return best


@lru_cache(maxsize=64)
def _log_inverse(probability: float) -> float:
    """ln(1/p) by halving, so that libm has no part in it; a probability of nothing is never reached."""
    if probability <= 0.0:
        return LARGE_DISTANCE
    low, high = 0.0, _LARGEST_EXPONENT
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if exp_negative(-middle) > probability:
            low = middle
        else:
            high = middle
    return high
