"""Swings: a drone that comes and goes about its claims, seen in means over stretches of time.

Errors of a radio that change slowly look alike in one anchor, but no place explains them: a drone that swings is where
some place explains all anchors. So what no place explains tells how much of the stretches' scatter is the radio's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from math import inf, sqrt
from typing import Final

from wonderland.proofs.claims import Track
from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import Reduced, Residuals, Series
from wonderland.proofs.sights import Sights
from wonderland.proofs.special import CHI2_LIMITS

TWENTIETH_Z: Final = 1.6449
"""Standard deviations that one in twenty exceeds, on one side."""
THOUSANDTH_Z: Final = 3.0902
"""Standard deviations that one in a thousand exceeds, on one side."""
_CORNER_MM: Final = 100
_SHORTEST: Final = 3
"""Rounds of the shortest one."""
_ROUNDED_MM2: Final = 100.0 / 12.0
"""Variance of what rounding to 10 mm leaves."""


class _Places:
    """The directions from places that a drone claims, to a decimetre: most drones that are judged hover."""

    def __init__(self, reduced: Reduced, offset: Offset, claimed: Track) -> None:
        self._reduced = reduced
        self._offset = offset
        self._claimed = claimed
        self._seen: dict[tuple[int, int, int], Sights] = {}
        low, high = ((edge(claimed.east), edge(claimed.north), edge(claimed.up)) for edge in (min, max))
        hovers = _corner(*low) == _corner(*high)
        self._all: Sights | None = self._at(_corner(*low)) if hovers else None

    def at(self, position: int) -> Sights:
        """Those of the corner next to where the drone claims to be in a round."""
        claimed = self._claimed
        return self._all or self._at(_corner(claimed.east[position], claimed.north[position], claimed.up[position]))

    def _at(self, corner: tuple[int, int, int]) -> Sights:
        found = self._seen.get(corner)
        if found is None:
            found = Sights(self._reduced, self._offset, *(float(_CORNER_MM * axis) for axis in corner))
            self._seen[corner] = found
        return found


def _corner(east: float, north: float, up: float) -> tuple[int, int, int]:
    return round(east / _CORNER_MM), round(north / _CORNER_MM), round(up / _CORNER_MM)


class _Total:
    """One anchor's residuals summed up to each round, so that any stretch's mean is a difference."""

    def __init__(self, column: Series, middle_mm: float, count: int) -> None:
        self.middle_mm: Final = middle_mm
        each: Sequence[float] = column.values
        self.heard: Sequence[int] = range(count + 1)
        if len(each) < count:
            values, heard = [0.0] * count, [0] * count
            for position, value in zip(column.rounds, column.values, strict=True):
                values[position], heard[position] = value, 1
            each, self.heard = values, [0, *accumulate(heard)]
        self.sums: Final = [0.0, *accumulate(each)]

    def means(self, edges: Sequence[int]) -> list[float | None]:
        """Of the stretches between these rounds, about the whole (mm); None where the anchor was not heard."""
        sums, heard = self.sums, self.heard
        return [
            (sums[after] - sums[before]) / (heard[after] - heard[before]) - self.middle_mm
            if heard[after] > heard[before]
            else None
            for before, after in pairwise(edges)
        ]


def swing_of(reduced: Reduced, offset: Offset, seen: Residuals, clear_mm: float) -> float:
    """Mean square (mm²) of the offsets of stretches of time about the whole, where more than noise; else 0.

    Of halves, quarters, eighths and so on, the largest: a swing that one length of stretch averages out another shows.
    """
    count = len(seen.claimed.kept)
    modelled, least = _noise(reduced, seen)
    places = _Places(reduced, offset, seen.claimed)
    totals = [_Total(column, middle_mm, count) for column, middle_mm in seen.series]
    largest = 0.0
    parts = 2
    while parts == 2 or parts * _SHORTEST <= count:
        share = parts / count
        square, spread = _of_stretches(places, totals, parts, modelled * share, least * share)
        largest = max(largest, square)
        if spread > clear_mm * clear_mm:
            break
        parts *= 2
    return largest


def _noise(reduced: Reduced, seen: Residuals) -> tuple[float, float]:
    """Variance (mm²) of one range, mean of the anchors: for means over many rounds, and from one round to the next.

    The first counts that errors of neighbouring rounds are alike, which a drone that swings about its claims can feign.
    The second is half the mean square of successive differences (von Neumann), which it can not.
    """
    modelled = least = 0.0
    for anchor, (column, _) in zip(reduced.anchors, seen.series, strict=True):
        square = 0.0
        for earlier, later in pairwise(column.values):
            square += (later - earlier) * (later - earlier)
        modelled += anchor.white * anchor.count
        least += square / (2.0 * max(len(column.values) - 1, 1))
    anchors = len(reduced.anchors)
    return modelled / anchors, max(least / anchors, _ROUNDED_MM2)


def _of_stretches(
    places: _Places, totals: Sequence[_Total], parts: int, modelled: float, least: float
) -> tuple[float, float]:
    """(mean square of the offsets of so many stretches where more than noise, that which noise alone makes), mm².

    ``modelled``, ``least``: the variance of a stretch's mean by the session's correlation, and without any. What no
    place explains tells which it is: errors of the radio are there as well, a drone that swings is not.
    """
    count = len(totals[0].heard) - 1
    edges = [-(-part * count // parts) for part in range(parts + 1)]
    away = [total.means(edges) for total in totals]
    explained = square = spread = left = 0.0
    freedom = 0
    for part, residuals in enumerate(zip(*away, strict=True)):
        # The middle round of a stretch stands for it.
        found = places.at((2 * part + 1) * count // (2 * parts)).of(residuals)
        if found is not None:
            fan, values = found
            east, north, by_offset, unexplained = fan.split(values)
            explained += by_offset
            left += unexplained
            square += east * east + north * north
            spread += fan.spread
            freedom += fan.freedom
    square, spread = square / parts, spread / parts
    below = freedom * (parts - 1) // parts
    told = max(least, left / below) if below else modelled
    variance = min(modelled, told)
    noise = variance * spread * (parts - 1) / parts
    over = 2 * (parts - 1)
    if explained / variance <= (_limit(over) if told >= modelled else _ratio_limit(over, below)):
        return 0.0, noise
    return max(square - noise, 0.0), noise


def _limit(freedom: int) -> float:
    """χ² that one in a thousand exceeds; beyond the table by Wilson and Hilferty's cube."""
    if freedom <= len(CHI2_LIMITS):
        return CHI2_LIMITS[freedom - 1]
    part = 2.0 / (9.0 * freedom)
    root = 1.0 - part + THOUSANDTH_Z * sqrt(part)
    return freedom * root * root * root


def _ratio_limit(freedom: int, below: int) -> float:
    """Explained over the variance of ``below`` degrees of freedom that one in twenty exceeds, without a swing.

    Fisher's F by Paulson's cube, times ``freedom``; without end where so few say nothing. One in twenty, as the
    variance is only guessed: a swing that is none costs an honest drone a part of its reach, seldom the permission.
    """
    over, under = 2.0 / (9.0 * freedom), 2.0 / (9.0 * below)
    z2 = TWENTIETH_Z * TWENTIETH_Z
    a, b, c = (1.0 - under) * (1.0 - under) - z2 * under, (1.0 - over) * (1.0 - under), (1.0 - over) * (1.0 - over)
    if a <= 0.0:
        return inf
    root = (b + sqrt(b * b - a * (c - z2 * over))) / a
    return freedom * root * root * root
