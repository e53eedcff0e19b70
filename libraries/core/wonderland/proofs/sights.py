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
        left = [residual for residual in residuals if residual is not None]
        base: list[list[float]] = []
        for direction in (
            [self.sights[index][0] for index in heard],
            [self.sights[index][1] for index in heard],
            [self._climbs[index] for index in heard],
        ):
            rest = direction
            for other in base:
                rest = _without(rest, other)
            if _dot(rest, rest) > _SINGULAR * _dot(direction, direction):
                length = sqrt(_dot(rest, rest))
                base.append([value / length for value in rest])
        for other in base:
            left = _without(left, other)
        return _dot(left, left), len(heard) - len(base)


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    total = 0.0
    for x, y in zip(one, other, strict=True):
        total += x * y
    return total


def _without(vector: Sequence[float], unit: Sequence[float]) -> list[float]:
    """A vector without its part along a unit vector."""
    along = _dot(vector, unit)
    return [x - along * y for x, y in zip(vector, unit, strict=True)]
