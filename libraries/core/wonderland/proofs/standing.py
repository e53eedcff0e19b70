"""Of which moment a verdict's place is, and where that was claimed to be: part of step 5.

The place in a verdict is a claim of one moment, moved by the offset that all rounds measured. Claims that waver less
than would matter for the whole may still be off by metres at a single moment, and so may be a drone that swings out and
comes back while its claims stand still. So a session is cut into stretches, and the moment is the middle of that one
whose ranges scatter least about what all of them say: there the drone followed its claims. The claim of that moment is
read off a parabola through the stretch's claims, since a single one has its receiver's noise; what is left of it, and
what an uncertain clock means at the speed of that moment, stands beside it.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

from wonderland.proofs.claims import LocalClaim, Track
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reduction import Reduced, Residuals

STRETCHES: Final = 6
"""A session is cut into so many, and each two neighbours' halves make one more."""
LEAST_ROUNDS: Final = 6
"""Fewer rounds by themselves tell too little, and give no parabola."""
APART_MS: Final = 400
"""Through rounds farther apart than this goes no parabola: the claim of the middle one stands for itself."""
PARABOLA: Final = 2.25
"""The middle of a parabola through evenly spaced values has so many times the variance of their mean."""
_SINGULAR: Final = 1e-9


class Standing(NamedTuple):
    """Where the drone claims to have been at the moment that the place is of."""

    claim: LocalClaim
    spread: Matrix2
    """How well that is known, mm²: the claims' own noise, and the clock's; the offset's covariance is not in it."""


def standing_at(reduced: Reduced, claims: Sequence[LocalClaim]) -> Standing | None:
    """The moment of the verdict's place; None where nothing was ranged. ``claims``: all that were signed, in order."""
    seen = reduced.residuals
    if seen is None:
        return None
    rows = _calmest(seen)
    track = seen.claimed.only(rows)
    fit = _Parabola(track)
    speed_east = fit.velocity_east - reduced.velocity_east
    speed_north = fit.velocity_north - reduced.velocity_north
    clock = reduced.clock_sigma_ms * reduced.clock_sigma_ms
    moved = Matrix2(speed_east * speed_east, speed_east * speed_north, speed_north * speed_north).scaled(clock)
    return Standing(fit.middle, _noise(track, claims) + moved)


def _calmest(seen: Residuals) -> Sequence[int]:
    """The stretch (positions in the claimed track) whose residuals scatter least about the means of all rounds."""
    steady = _steady(seen)
    length = max(LEAST_ROUNDS, len(steady) // STRETCHES)
    if len(steady) <= length:
        return steady
    rounds = len(seen.claimed.kept)
    squares, counts = [0.0] * rounds, [0] * rounds
    for column, mean in seen.series:
        about = [(value - mean) * (value - mean) for value in column.values]
        if len(about) == rounds:
            squares = [total + square for total, square in zip(squares, about, strict=True)]
            counts = [count + 1 for count in counts]
            continue
        for position, square in zip(column.rounds, about, strict=True):
            squares[position] += square
            counts[position] += 1
    sums = [0.0, *accumulate([squares[position] for position in steady])]
    heard = [0, *accumulate([counts[position] for position in steady])]
    best, least = 0, -1.0
    for start in [*range(0, len(steady) - length, max(length // 2, 1)), len(steady) - length]:
        end = start + length
        count = heard[end] - heard[start]
        if count and (least < 0.0 or (sums[end] - sums[start]) / count < least):
            best, least = start, (sums[end] - sums[start]) / count
    return steady[best : best + length]


def _steady(seen: Residuals) -> list[int]:
    """Rounds (positions in the claimed track) that are neither torn nor next to one that is; else all that are left."""
    left = set(seen.track.kept)
    kept = [position for position, moment in enumerate(seen.claimed.kept) if moment in left]
    if not seen.torn:
        return kept
    torn = [moment not in left for moment in seen.claimed.kept]
    near = {at + side for at, (one, other) in enumerate(pairwise(torn)) if one != other for side in (0, 1)}
    steady = [position for position in kept if position not in near]
    return steady if len(steady) >= LEAST_ROUNDS else kept


class _Parabola:
    """Least squares through claimed places over time; a straight line, or their mean, where they are too few."""

    def __init__(self, track: Track) -> None:
        middle = len(track.t_ms) // 2
        at_ms = track.t_ms[middle]
        if max((after - before for before, after in pairwise(track.t_ms)), default=0) > APART_MS:
            self.middle = LocalClaim(at_ms, track.east[middle], track.north[middle], track.up[middle])
            self.velocity_east = self.velocity_north = 0.0
            return
        half = float(max(track.t_ms[-1] - at_ms, at_ms - track.t_ms[0], 1))
        times = [(t_ms - at_ms) / half for t_ms in track.t_ms]
        east, self.velocity_east = _at_zero(times, track.east, track.east[middle])
        north, self.velocity_north = _at_zero(times, track.north, track.north[middle])
        up, _ = _at_zero(times, track.up, track.up[middle])
        self.velocity_east, self.velocity_north = self.velocity_east / half, self.velocity_north / half
        self.middle = LocalClaim(at_ms, east, north, up)


def _at_zero(times: Sequence[float], values: Sequence[float], base: float) -> tuple[float, float]:
    """(value, slope) at time 0 of the parabola through values at times; ``base`` is taken off before, for the bits."""
    s0 = s1 = s2 = s3 = s4 = b0 = b1 = b2 = 0.0
    for time, value in zip(times, values, strict=True):
        square, above = time * time, value - base
        s0, s1, s2, s3, s4 = s0 + 1.0, s1 + time, s2 + square, s3 + square * time, s4 + square * square
        b0, b1, b2 = b0 + above, b1 + above * time, b2 + above * square
    a, b, c = s2 * s4 - s3 * s3, s2 * s3 - s1 * s4, s1 * s3 - s2 * s2
    determinant = s0 * a + s1 * b + s2 * c
    if determinant <= _SINGULAR * s0 * s2 * s4:
        return base + b0 / s0, 0.0
    d, e = s0 * s4 - s2 * s2, s1 * s2 - s0 * s3
    return base + (a * b0 + b * b1 + c * b2) / determinant, (b * b0 + d * b1 + e * b2) / determinant


def _noise(track: Track, claims: Sequence[LocalClaim]) -> Matrix2:
    """What the claims' own noise leaves at the middle of a stretch, from how each lies about its two neighbours."""
    first, last = bisect_left(claims, track.t_ms[0], key=_moment), bisect_right(claims, track.t_ms[-1], key=_moment)
    inside = max(last - first, 1)
    about = claims[max(first - 1, 0) : last + 1]
    ee = en = nn = 0.0
    count = 0
    for before, claim, after in zip(about, about[1:], about[2:], strict=False):
        span = after.t_ms - before.t_ms
        if span <= 0:
            continue
        share = (claim.t_ms - before.t_ms) / span
        east = claim.east - before.east - (after.east - before.east) * share
        north = claim.north - before.north - (after.north - before.north) * share
        worth = 1.0 + share * share + (1.0 - share) * (1.0 - share)
        ee, en, nn = ee + east * east / worth, en + east * north / worth, nn + north * north / worth
        count += 1
    if count == 0:
        return Matrix2(0.0, 0.0, 0.0)
    return Matrix2(ee, en, nn).scaled(min(PARABOLA / inside, 1.0) / count)


def _moment(claim: LocalClaim) -> int:
    return claim.t_ms
