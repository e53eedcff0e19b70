"""A position from one range for each anchor, at once and without a start: for first guesses and live displays.

With the anchors' middle as origin, the squared horizontal ranges give two things that need no iteration. Their mean is
the squared distance from the middle plus a constant, exactly, whatever the noise of the bearing. Their differences are
linear in the position, and this solution's *direction* is as good as any, its length is not (it is the difference of
two large squares). So: direction from the differences, distance from the mean, and one Gauss–Newton step from there (a
second where the first was long), which makes it a maximum-likelihood estimate for equal errors. Its error and its speed
beside SciPy's: ``tests/bench/test_fix.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Final

from wonderland.proofs.errors import GeometryError

MIN_ANCHORS: Final = 3
_COLLINEAR: Final = 1e-6
"""Ratio of the anchors' spreads (in squares) below which differences of ranges tell nothing across their line."""
_STEPS: Final = 2
_SHORT_STEP: Final = 4e-4
"""Square of a step, as a share of the distance, after which directions have hardly turned: no second one is due."""


class Multilateration:
    """What depends on the anchors alone, computed once; then a fix for each set of ranges."""

    __slots__ = ("_anchors", "_constant", "_count", "_middle")

    def __init__(self, anchors: Sequence[tuple[float, float, float]]) -> None:
        """``anchors``: east, north and up in mm (or any one unit), at least three that are not in a line.

        Raises GeometryError.
        """
        count = len(anchors)
        if count < MIN_ANCHORS:
            raise GeometryError(f"{count} anchors give no position; at least {MIN_ANCHORS} are needed")
        middle_east = middle_north = 0.0
        for east, north, _ in anchors:
            middle_east += east
            middle_north += north
        middle_east, middle_north = middle_east / count, middle_north / count
        ee = en = nn = 0.0
        for east, north, _ in anchors:
            x, y = east - middle_east, north - middle_north
            ee += x * x
            en += x * y
            nn += y * y
        determinant = ee * nn - en * en
        if determinant <= _COLLINEAR * (ee + nn) * (ee + nn):
            raise GeometryError("the anchors stand in a line; ranges to them have a mirror image and give no position")
        rows = []
        for east, north, up in anchors:
            x, y = east - middle_east, north - middle_north
            gain_east = -0.5 * (nn * x - en * y) / determinant
            gain_north = -0.5 * (ee * y - en * x) / determinant
            rows.append((x, y, float(up), gain_east, gain_north, x * x + y * y))
        self._anchors = tuple(rows)
        self._count = float(count)
        self._constant = (ee + nn) / count
        self._middle = (middle_east, middle_north)

    def fix(self, ranges: Sequence[float], up: float) -> tuple[float, float] | None:
        """East and north from one range for each anchor, in their order, and the known height ``up``.

        None on top of an anchor, where directions end.
        """
        start = self.start(ranges, up)
        middle_east, middle_north = self._middle
        east, north = start[0] - middle_east, start[1] - middle_north
        for _ in range(_STEPS):
            ee = en = nn = be = bn = 0.0
            for (x, y, height, _, _, _), range_ in zip(self._anchors, ranges, strict=True):
                dx, dy, dz = east - x, north - y, up - height
                away = sqrt(dx * dx + dy * dy + dz * dz)
                if away <= 0.0:
                    return None
                ue, un = dx / away, dy / away
                residual = range_ - away
                ee += ue * ue
                en += ue * un
                nn += un * un
                be += ue * residual
                bn += un * residual
            determinant = ee * nn - en * en
            if determinant <= 0.0:
                return None
            step_east = (nn * be - en * bn) / determinant
            step_north = (ee * bn - en * be) / determinant
            east += step_east
            north += step_north
            if step_east * step_east + step_north * step_north <= _SHORT_STEP * (east * east + north * north):
                break
        return middle_east + east, middle_north + north

    def start(self, ranges: Sequence[float], up: float) -> tuple[float, float]:
        """The same before its Gauss–Newton step."""
        square = east = north = 0.0
        for (_, _, height, gain_east, gain_north, constant), range_ in zip(self._anchors, ranges, strict=True):
            dz = up - height
            horizontal = range_ * range_ - dz * dz
            square += horizontal
            horizontal -= constant
            east += gain_east * horizontal
            north += gain_north * horizontal
        square = square / self._count - self._constant
        length = east * east + north * north
        # Ranges shorter than the heights alone leave no distance to scale to: the linear solution as it is.
        scale = sqrt(square / length) if square > 0.0 and length > 0.0 else 1.0
        middle_east, middle_north = self._middle
        return middle_east + scale * east, middle_north + scale * north
