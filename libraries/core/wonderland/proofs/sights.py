"""What residuals at one moment come to as an offset on the map, and what no offset explains: part of step 8."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Final

from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import Reduced, distance
from wonderland.proofs.weighing import dot

_SINGULAR: Final = 1e-6
_Sight = tuple[float, float, float]
"""Unit vector from an anchor to the drone: east, north, up."""


class Fan:
    """Lines of sight from some anchors to one place, and what the least squares along them need."""

    def __init__(self, sights: Sequence[_Sight]) -> None:
        ee = en = nn = eu = nu = uu = 0.0
        for x, y, z in sights:
            ee, en, nn = ee + x * x, en + x * y, nn + y * y
            eu, nu, uu = eu + x * z, nu + y * z, uu + z * z
        determinant = ee * nn - en * en
        self.flat: Final = determinant > _SINGULAR * (ee + nn) * (ee + nn)
        """Whether they tell a place on the map."""
        inverse = 1.0 / determinant if self.flat else 0.0
        self._ee, self._en, self._nn = nn * inverse, -en * inverse, ee * inverse
        self.spread: Final = self._ee + self._nn
        """Mean square of the offset that 1 mm of noise in each residual makes."""
        # The part of the vertical that no offset on the map explains.
        a, b = self._ee * eu + self._en * nu, self._en * eu + self._nn * nu
        climbs = [z - a * x - b * y for x, y, z in sights]
        square = 0.0
        for climb in climbs:
            square += climb * climb
        tall = square > _SINGULAR * uu
        length = sqrt(square) if tall else 1.0
        self._lines: Final = (
            [x for x, _, _ in sights],
            [y for _, y, _ in sights],
            [climb / length if tall else 0.0 for climb in climbs],
        )
        self.freedom: Final = len(sights) - (3 if tall else 2)
        """Degrees of freedom of what is not explained."""

    def split(self, residuals: Sequence[float]) -> tuple[float, float, float, float]:
        """(east, north, explained, unexplained) of one residual (mm) for each anchor; only where the fan is ``flat``.

        The offset (mm) that fits them best, the sum of squares (mm²) that it explains, which is its χ² for a noise of
        1 mm, and the sum that no offset explains, on the map or in height.
        """
        easts, norths, climbs = self._lines
        be, bn, bu = dot(easts, residuals), dot(norths, residuals), dot(climbs, residuals)
        square = dot(residuals, residuals)
        east, north = self._ee * be + self._en * bn, self._en * be + self._nn * bn
        explained = be * east + bn * north
        left = square - explained - bu * bu
        return east, north, explained, max(left, 0.0)


class Sights:
    """The directions from the anchors to a claimed place.

    Of that moment, not of the mean: a drone that flies past a small pad is seen from all sides.
    """

    def __init__(self, reduced: Reduced, offset: Offset, east: float, north: float, up: float) -> None:
        self._sights: Final[list[_Sight]] = []
        for anchor in reduced.anchors:
            x, y, z = east + offset.east - anchor.east, north + offset.north - anchor.north, up - anchor.up
            away = max(distance(x, y, z), 1.0)
            self._sights.append((x / away, y / away, z / away))
        self._all: Final = Fan(self._sights)

    def of(self, residuals: Sequence[float | None]) -> tuple[Fan, Sequence[float]] | None:
        """The fan of the anchors that have a residual, and theirs; None where they do not tell a place."""
        fan, values = self._all, [residual for residual in residuals if residual is not None]
        if len(values) < len(residuals):
            fan = Fan([sight for sight, value in zip(self._sights, residuals, strict=True) if value is not None])
        return (fan, values) if fan.flat else None
