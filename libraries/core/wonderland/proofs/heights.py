"""Step 7, whatever the height: what time differences exclude when the drone's word on its height is not believed.

Far from a small pad the differences tell bearing and elevation well, and the distance by the front's curvature alone.
To believe the claimed height is to take the distance from the elevation; a drone that delays its answers *and* claims
a false height then fits ranges and differences at once. So every height is tried: the places that fit best at each of
them make one long, bent line, and all of it that cannot be excluded has to lie within the buffer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import sqrt
from typing import Final

from wonderland.proofs.claims import LOWEST_MM
from wonderland.proofs.hyperbolic import Heard, Place, TimeFix
from wonderland.proofs.likelihood import LARGE_DISTANCE, distance_to_outside
from wonderland.proofs.reduction import distance

UNKNOWN_HEIGHT_MM: Final = 1_000_000.0
"""Standard deviation of a height of which nothing is known."""
GIVEN_HEIGHT_MM: Final = 1.0
"""The same of a height that is tried."""
_LADDER: Final = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0)
"""Heights that are tried, in buffers above and below the claimed one."""
_FLAT: Final = 1e-3
"""Volume that four anchors span, in cubes of their largest distance, below which they are in one plane."""
_FOUR: Final = 4
_HALVINGS: Final = 5
_NARROWINGS: Final = 3
_SINGULAR: Final = 1e-12
_FITS: Final = 1.0
"""A second place whose χ² is larger by less fits as well: no need to look further."""


@dataclass(frozen=True, slots=True)
class Margin:
    """The best place outside of the buffer, at whatever height."""

    sigmas: float
    """How much worse it explains the differences than the best place: the root of the difference in χ²."""
    away_mm: float
    """How far it is from the best place."""


@dataclass(frozen=True, slots=True)
class _Rung:
    """What fits best at one height."""

    up: float
    place: Place
    outside: float
    """Least χ² of a place outside of the buffer at this height."""
    away: float
    """Distance of the place from the claim."""


class Heights:
    """The places that explain a set of time stamps best, height by height."""

    def __init__(self, heard: tuple[Heard, ...], east: float, north: float, radius: float) -> None:
        self._heard = heard
        self._east = east
        self._north = north
        self._radius = radius
        self._lowest = min(one.up for one in heard) - LOWEST_MM

    def margin(self, up: float) -> Margin:
        """How clearly every place outside of the buffer about the claim (at height ``up``, mm) is excluded."""
        start = self._rung(up, self._east, self._north)
        seconds = [self._rung(at, east, north) for east, north, at in self._exact()]
        for second in seconds:
            if second.outside - start.place.chi2 < _FITS:
                return self._between(start, second)
        rungs = [*reversed(self._walk(start, -1.0)), start, *self._walk(start, 1.0)]
        best = min(rungs, key=lambda rung: rung.place.chi2)
        return self._between(best, min((self._least_outside(rungs), *seconds), key=_by_outside))

    def _between(self, best: _Rung, other: _Rung) -> Margin:
        worse = other.outside - best.place.chi2
        away = distance(other.place.east - best.place.east, other.place.north - best.place.north, 0.0)
        return Margin(sqrt(worse) if worse > 0.0 else 0.0, max(away, self._radius - best.away))

    def _walk(self, start: _Rung, sign: float) -> list[_Rung]:
        rungs: list[_Rung] = []
        east, north, slope_east, slope_north = start.place.east, start.place.north, 0.0, 0.0
        before = start
        for step in _LADDER:
            up = start.up + sign * step * self._radius
            if up < self._lowest:
                break
            rise = up - before.up
            rung = self._rung(up, east + slope_east * rise, north + slope_north * rise)
            slope_east, slope_north = (rung.place.east - east) / rise, (rung.place.north - north) / rise
            east, north, before = rung.place.east, rung.place.north, rung
            rungs.append(rung)
        return rungs

    def _exact(self) -> list[tuple[float, float, float]]:
        """The places (east, north, up) that fit four anchors exactly: two, far apart, where these are in no plane.

        With ρ the stamps and b what is common to them, |x − a| = ρ + b; differences of the squares are linear in x
        and b, so that x = u + v·b, and the first square gives b.
        """
        if len(self._heard) != _FOUR:
            return []
        first, *others = self._heard
        arms = [(one.east - first.east, one.north - first.north, one.up - first.up) for one in others]
        volume = _dot(arms[0], _cross(arms[1], arms[2]))
        largest = max(distance(*arm) for arm in arms)
        if abs(volume) <= _FLAT * largest * largest * largest:
            return []
        later = [one.length - first.length for one in others]
        right = [0.5 * (_dot(arm, arm) - late * late) for arm, late in zip(arms, later, strict=True)]
        # About the first anchor, and with b counted from its stamp: |x| = b, arm·x = right − late·b.
        u, v = _solved(arms, right, volume), _solved(arms, [-late for late in later], volume)
        roots = _roots(_dot(v, v) - 1.0, _dot(u, v), _dot(u, u))
        places = [
            (first.east + u[0] + v[0] * b, first.north + u[1] + v[1] * b, first.up + u[2] + v[2] * b)
            for b in roots
            if b > 0.0 and all(b + late > 0.0 for late in later)
        ]
        return [place for place in places if place[2] >= self._lowest]

    def _rung(self, up: float, east: float, north: float) -> _Rung:
        """The place that fits best at a height, from a start near it."""
        fix = TimeFix(self._heard, up, GIVEN_HEIGHT_MM)
        place = fix.descend(east, north)
        off_east, off_north = place.east - self._east, place.north - self._north
        away = distance(off_east, off_north, 0.0)
        outside = place.chi2
        if away < self._radius:
            found = fix.covariance(place.east, place.north)
            # Where a direction is open even at a given height, nothing is excluded.
            depth = distance_to_outside(off_east, off_north, found[0], self._radius) if found is not None else 0.0
            outside += min(depth, LARGE_DISTANCE) * min(depth, LARGE_DISTANCE)
        return _Rung(up, place, outside, away)

    def _least_outside(self, rungs: list[_Rung]) -> _Rung:
        least = min(rungs, key=_by_outside)
        for before, after in pairwise(rungs):
            if (before.away < self._radius) != (after.away < self._radius):
                least = min(least, self._at_the_edge(before, after), key=_by_outside)
        for before, middle, after in zip(rungs, rungs[1:], rungs[2:], strict=False):
            if middle.away >= self._radius and middle.outside <= min(before.outside, after.outside):
                least = min(least, self._narrowed(before, middle, after), key=_by_outside)
        return least

    def _at_the_edge(self, before: _Rung, after: _Rung) -> _Rung:
        """Where the line of best places leaves the buffer: the least χ² of what is just outside of it."""
        inner, outer = (before, after) if before.away < self._radius else (after, before)
        for _ in range(_HALVINGS):
            middle = self._rung(0.5 * (inner.up + outer.up), inner.place.east, inner.place.north)
            if middle.away < self._radius:
                inner = middle
            else:
                outer = middle
        # What is just outside lies between the two: it counts as what fits best of either, which errs to the safe side.
        return replace(outer, outside=min(inner.place.chi2, outer.place.chi2))

    def _narrowed(self, before: _Rung, middle: _Rung, after: _Rung) -> _Rung:
        """A second place beyond the buffer that fits, between three heights."""
        for _ in range(_NARROWINGS):
            for low, high in ((before, middle), (middle, after)):
                tried = self._rung(0.5 * (low.up + high.up), middle.place.east, middle.place.north)
                if tried.place.chi2 < middle.place.chi2:
                    before, middle, after = low, tried, high
                    break
            else:
                before = self._rung(0.5 * (before.up + middle.up), middle.place.east, middle.place.north)
                after = self._rung(0.5 * (middle.up + after.up), middle.place.east, middle.place.north)
        return middle


Vector = tuple[float, float, float]


def _by_outside(rung: _Rung) -> float:
    return rung.outside


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _solved(arms: list[Vector], right: list[float], volume: float) -> Vector:
    """The x with arm·x = right for three arms (Cramer's rule by cross products)."""
    first, second, third = _cross(arms[1], arms[2]), _cross(arms[2], arms[0]), _cross(arms[0], arms[1])
    x, y, z = ((right[0] * first[i] + right[1] * second[i] + right[2] * third[i]) / volume for i in range(3))
    return x, y, z


def _roots(a: float, half: float, c: float) -> tuple[float, ...]:
    """Of a·b² + 2·half·b + c, as exactly as they can be told."""
    square = half * half - a * c
    if square < 0.0:
        return ()
    q = -(half + sqrt(square)) if half >= 0.0 else sqrt(square) - half
    found = [c / q] if q != 0.0 else []
    return (*found, q / a) if abs(a) > _SINGULAR else tuple(found)
