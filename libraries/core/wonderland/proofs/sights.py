"""What residuals at one moment come to as an offset on the map: part of step 8."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Final

from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import Reduced, distance

_SINGULAR: Final = 1e-6


class Sights:
    """The directions from the anchors to a claimed place, and the offset that residuals along them come to.

    Of that moment, not of the mean: a drone that flies past a small pad is seen from all sides.
    """

    def __init__(self, reduced: Reduced, offset: Offset, east: float, north: float, up: float) -> None:
        self.sights: Final[list[tuple[float, float]]] = []
        self._climbs: Final[list[float]] = []
        self._base: list[list[float]] | None = None
        for anchor in reduced.anchors:
            x, y = east + offset.east - anchor.east, north + offset.north - anchor.north
            away = max(distance(x, y, up - anchor.up), 1.0)
            self.sights.append((x / away, y / away))
            self._climbs.append((up - anchor.up) / away)

    def offset(self, residuals: Sequence[float | None]) -> tuple[float, float, float] | None:
        """Offset (east, north, mm) that fits one residual for each anchor best, and its χ² for 1 mm; None without one.

        None among the residuals: that anchor has none.
        """
        ee = en = nn = be = bn = 0.0
        for (x, y), residual in zip(self.sights, residuals, strict=True):
            if residual is None:
                continue
            ee += x * x
            en += x * y
            nn += y * y
            be += x * residual
            bn += y * residual
        determinant = ee * nn - en * en
        if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
            return None
        east, north = (nn * be - en * bn) / determinant, (ee * bn - en * be) / determinant
        return east, north, be * east + bn * north

    def spread(self) -> float:
        """Mean square of the offset that 1 mm of noise in each residual makes; 0 where none can be told."""
        ee = en = nn = 0.0
        for x, y in self.sights:
            ee += x * x
            en += x * y
            nn += y * y
        determinant = ee * nn - en * en
        return (ee + nn) / determinant if determinant > _SINGULAR * (ee + nn) * (ee + nn) else 0.0

    def unexplained(self, residuals: Sequence[float | None]) -> tuple[float, int]:
        """(Sum of squares that no offset on the map or in height explains, its degrees of freedom)."""
        heard = [index for index, residual in enumerate(residuals) if residual is not None]
        values = [residual for residual in residuals if residual is not None]
        if len(heard) == len(self.sights):
            if self._base is None:
                self._base = self._directions(heard)
            base = self._base
        else:
            base = self._directions(heard)
        left = _dot(values, values)
        for unit in base:
            along = _dot(unit, values)
            left -= along * along
        return max(left, 0.0), len(heard) - len(base)

    def _directions(self, heard: Sequence[int]) -> list[list[float]]:
        """What an offset does to the ranges of these anchors: unit vectors at right angles, three at most."""
        base: list[list[float]] = []
        for direction in (
            [self.sights[index][0] for index in heard],
            [self.sights[index][1] for index in heard],
            [self._climbs[index] for index in heard],
        ):
            rest = direction
            for unit in base:
                along = _dot(rest, unit)
                rest = [x - along * y for x, y in zip(rest, unit, strict=True)]
            square = _dot(rest, rest)
            if square > _SINGULAR * _dot(direction, direction):
                length = sqrt(square)
                base.append([value / length for value in rest])
        return base


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(one, other, strict=True):
        total += x * y
    return total
