"""When to stop ranging: what holds however often a pad looks, after which rounds it does, how many more would help.

A pad that looks until it likes what it sees would be wrong far more often than each look says. So an outcome needs a
*sequential* proof: a mixture of likelihood ratios between design alternatives, each a fixed distance on this side of
the buffer's edge, and the nearest point on the other side of the edge. In standard deviations, with D the distance from
the estimate to that point and η an alternative's, it is Σ w·exp(ηD − η²/2); Ville's inequality lets it exceed 1/α with
probability α·Σw at most, at whichever rounds one looks. The covariance is the whole one: with the bias integrated out
this still is a ratio of likelihoods, so that the floor is treated exactly.

Real rounds come one by one and so overshoot 1/α, by exp(0.583 ρ) on average where ρ is the step of η from one round to
the next (Siegmund's correction); that much less is demanded. Locations and weights were then chosen by simulation, so
that a drone exactly on the edge, looked at after *every* round from the third to the five hundredth, is verified with
at most 1 % and refuted with at most 1 %, for ellipses from 0.3 to 6 buffers after one round, and so that lies of two
and of three buffers cost the same excess over Wald's bound (``tests/bench/test_verdict_statistics.py``).
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
INSIDE: Final = ((1.0, 0.97), (0.5, 0.26))
"""Alternatives to "outside": (distance within the edge in buffers, weight). The first is the claim itself."""
OUTSIDE: Final = ((1.08, 0.42), (2.15, 0.51))
"""Alternatives to "inside": about lies of two and of three buffers, a little beyond to gain by what they share."""
ANYWHERE_WEIGHT: Final = 0.04
"""Weight of the alternative at the estimate itself: for what lies between or beyond the design alternatives."""
FAR_WEIGHT: Final = 0.15
"""The same where the estimate is vaguer than two buffers: there it has to find lies of many buffers."""
FAR_BUFFERS: Final = 2.0
MAX_MORE_ROUNDS: Final = 10_000
_HOPE_SIGMAS: Final = 2.0
"""How far the estimate may still move, in standard deviations of the part that shrinks."""
_LARGEST_EXPONENT: Final = 700.0
_OVERSHOOT: Final = 0.583
"""Mean overshoot of a normal random walk over a distant boundary, in its steps: −ζ(½)/√(2π)."""
_LARGEST_STEP: Final = 1.6
"""Beyond this the correction is no longer exponential; it is held here, on the safe side."""
_HALVINGS: Final = 60
_ROOM_HALVINGS: Final = 12
_MIXTURE_GAIN: Final = 1.5
"""No mixture of these alternatives demands a variance smaller than its best part alone by more than this."""

Alternatives = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Sides:
    """What one estimate proves about one claim, whenever one looks."""

    inside: bool
    outside: bool
    significance: float
    """Standard deviations between the estimate and the nearest point of the buffer; 0 inside it."""


def sides(east: float, north: float, covariance: Matrix2, policy: Policy, step: float = 0.0) -> Sides:
    """Whether a drone at this offset from its claim is proved within the buffer, or outside of it.

    ``step`` (1/mm, from ``step_of``): how much the last round told; 0 is always on the safe side.
    """
    radius = float(policy.buffer_mm)
    s1 = covariance.ellipse().s1
    significance = distance_to_disc(east, north, covariance, radius)
    if significance > 0.0:
        return Sides(inside=False, outside=proved_outside(significance, s1, policy, step), significance=significance)
    depth = distance_to_outside(east, north, covariance, radius)
    inside = proved_inside(depth, s1, radius, policy, step)
    return Sides(inside=inside, outside=False, significance=0.0)


def proved_inside(depth: float, s1: float, radius: float, policy: Policy, step: float = 0.0) -> bool:
    """Whether a depth (σ) in a buffer of ``radius`` mm verifies an estimate known to ``s1`` mm, whenever one looks."""
    return proved(INSIDE, _alpha(1_000_000 - policy.verify_ppm), radius, s1, depth, step)


def proved_outside(significance: float, s1: float, policy: Policy, step: float = 0.0) -> bool:
    """Whether a distance to the buffer (σ) of an estimate known to ``s1`` mm refutes, whenever one looks."""
    return proved(OUTSIDE, _alpha(policy.refute_ppm), float(policy.buffer_mm), s1, significance, step)


def step_of(covariance: Matrix2, shrinking: Matrix2, rounds: int) -> float:
    """How much the last of ``rounds`` rounds told: the step of 1/s1 in quadrature, 1/mm; 0 where that is not known.

    ``shrinking`` is the part of the covariance that more rounds make smaller.
    """
    if rounds < 2:
        return 0.0
    axes = covariance.ellipse()
    return step_between(covariance.along(axes.east, axes.north), shrinking.along(axes.east, axes.north), rounds)


def step_between(after: float, shrinking: float, rounds: int) -> float:
    """The same in one dimension, from variances (mm²)."""
    if rounds < 2:
        return 0.0
    before = after + max(shrinking, 0.0) / (rounds - 1)
    if after <= 0.0 or before <= after:
        return 0.0
    return sqrt(1.0 / after - 1.0 / before)


def proved(alternatives: Alternatives, alpha: float, radius: float, s1: float, away: float, step: float) -> bool:
    """Whether a distance ``away`` (σ) of an estimate from the edge proves its side with error ``alpha``."""
    if s1 <= 0.0:
        return True
    if away <= 0.0:
        return False
    anywhere = FAR_WEIGHT if s1 > FAR_BUFFERS * radius else ANYWHERE_WEIGHT
    if away * away >= 2.0 * _log_inverse(alpha * anywhere):
        return True
    threshold = _log_inverse(alpha)
    total = 0.0
    for distance, weight in alternatives:
        delta = distance * radius
        eta = delta / s1
        excess = _OVERSHOOT * min(delta * step, _LARGEST_STEP)
        total += weight * _exp(eta * away - 0.5 * eta * eta + excess - threshold)
    return total >= 1.0


def more_rounds(offset: Offset, rounds: int, policy: Policy, hope: float = 1.0) -> int:
    """Further rounds expected to settle it; −1 where the part that does not shrink forbids any outcome.

    None can settle it only if none could from anywhere that the estimate may still move to. ``hope``: the share of the
    part that does not shrink with rounds that may be left if the drone flies on as it does (``travel.hope``).
    """
    axes = offset.covariance.ellipse()
    floor = offset.floor.along(axes.east, axes.north)
    white = max(offset.covariance.along(axes.east, axes.north) - floor, 0.0)
    distance = sqrt(offset.east * offset.east + offset.north * offset.north)
    more = _more(distance, white, floor, rounds, policy)
    if more < 0 and hope < 1.0:
        more = _more(distance, white, floor * hope, rounds, policy)
        return max(more, rounds) if more > 0 else more
    return more


def _more(distance: float, white: float, floor: float, rounds: int, policy: Policy) -> int:
    """Further rounds for an estimate ``distance`` from its claim with these variances by now; −1 where none help."""
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


def settled_variance(policy: Policy) -> float:
    """Largest variance (mm², along the ellipse's long axis) with which a claim that is exactly right is verified."""
    radius = float(policy.buffer_mm)
    return _largest_variance(INSIDE, _alpha(1_000_000 - policy.verify_ppm), radius, radius)


def _alpha(ppm: int) -> float:
    return ppm / 1_000_000.0


def _largest_variance(alternatives: Alternatives, alpha: float, radius: float, margin: float) -> float:
    """Largest variance (mm²) with which a margin (mm) to the edge proves a side."""
    low = margin * margin / (2.0 * _log_inverse(alpha * ANYWHERE_WEIGHT))
    for distance, weight in alternatives:
        delta = distance * radius
        low = max(low, delta * (margin - 0.5 * delta) / _log_inverse(alpha * weight))
    high = low * _MIXTURE_GAIN
    for _ in range(_ROOM_HALVINGS):
        middle = 0.5 * (low + high)
        s1 = sqrt(middle)
        if s1 > 0.0 and proved(alternatives, alpha, radius, s1, margin / s1, 0.0):
            low = middle
        else:
            high = middle
    return low


def _exp(x: float) -> float:
    """e^x, from 1e-304 to 1e304."""
    return exp_negative(x) if x <= 0.0 else 1.0 / exp_negative(-min(x, _LARGEST_EXPONENT))


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
