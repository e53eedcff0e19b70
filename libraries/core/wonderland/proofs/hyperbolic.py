"""Where the drone is by the time stamps of its frames alone: an estimate in which its own clock has no part.

All anchors time-stamp one frame on one clock. When it was sent nobody has to know: that moment is common to all stamps
and is taken out, so that only differences are left (hyperbolas). Far from a small pad they tell the bearing well and
the distance badly; so places are judged by the χ² of the differences themselves, not by an ellipse alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reduction import distance
from wonderland.proofs.weighing import Line, weighed_lines, weighed_pairs

CLEARLY_WORSE: Final = 13.815510557964274
"""A place whose χ² is larger by this is excluded: its likelihood is a thousand times smaller."""
_ITERATIONS: Final = 16
_CONVERGED_MM: Final = 0.05
_SINGULAR: Final = 1e-12
_MAX_STEP_MM: Final = 5_000.0
_HALVINGS: Final = 8
_STARTS_MM: Final = (1_500.0, 4_000.0, 10_000.0, 25_000.0, 60_000.0)
"""Distances from the anchors' middle at which fixes begin where the one from the claim does not explain the stamps."""
_QUARTER: Final = (
    (1.0, 0.0),
    (0.9238795325112867, 0.3826834323650898),
    (0.7071067811865476, 0.7071067811865476),
    (0.3826834323650898, 0.9238795325112867),
)
"""A quarter of a circle in steps of π/8; the other three follow by turning."""
_CIRCLE: Final = tuple(turned for x, y in _QUARTER for turned in ((x, y), (-y, x), (-x, -y), (y, -x)))
_LINES: Final = 6
_LINE_STEPS: Final = 5

Normal = tuple[float, float, float, float, float, float]
"""Normal equations: matrix (ee, en, nn), right side (be, bn), and χ²."""


@dataclass(slots=True)
class Heard:
    """One anchor's mean time stamp as a length: distance from the drone plus what is common to all anchors, mm."""

    index: int
    """Position in the commissioning's list of anchors."""
    east: float
    north: float
    up: float
    length: float
    white: float
    """Variance that more frames make smaller, mm²."""
    floor: float
    """Variance that they do not: clock synchronisation and survey, mm²."""


@dataclass(frozen=True, slots=True)
class Place:
    """A place in the pad's frame with the χ² of the differences there."""

    east: float
    north: float
    chi2: float


class TimeFix:
    """The χ² of a set of mean time stamps over the places of a plane at height ``up``."""

    def __init__(self, heard: Sequence[Heard], up: float, height_sigma_mm: float) -> None:
        self.heard: Final = tuple(heard)
        self.up: Final = up
        self._height_sigma: Final = height_sigma_mm
        self._height: Final = 1.0 / (height_sigma_mm * height_sigma_mm)
        inverse = [1.0 / max(one.white + one.floor, 1.0) for one in self.heard]
        total = 0.0
        for weight in inverse:
            total += weight
        self._rows: Final = tuple(
            tuple((left if i == j else 0.0) - left * inverse[j] / total for j in range(len(inverse)))
            for i, left in enumerate(inverse)
        )
        """Inverse covariance with the common moment projected out."""
        self._places: Final = tuple((one.east, one.north, up - one.up, one.length) for one in self.heard)

    def without(self, position: int) -> TimeFix:
        """The same without one anchor, by its position in ``heard``."""
        return TimeFix(self.heard[:position] + self.heard[position + 1 :], self.up, self._height_sigma)

    def with_height_sigma(self, height_sigma_mm: float) -> TimeFix:
        """The same with another standard deviation of its height."""
        return TimeFix(self.heard, self.up, height_sigma_mm)

    @property
    def middle(self) -> tuple[float, float]:
        """The anchors' middle (east, north)."""
        east = north = 0.0
        for one in self.heard:
            east += one.east
            north += one.north
        return east / len(self.heard), north / len(self.heard)

    def _lines(self, east: float, north: float) -> list[Line]:
        """From each anchor to a place: direction (east, north, up), and stamp minus way, mm."""
        lines = []
        for at_east, at_north, z, length in self._places:
            x, y = east - at_east, north - at_north
            away = sqrt(x * x + y * y + z * z)
            if away < 1.0:  # noqa: PLR1730 - a call for each of hundreds
                away = 1.0
            lines.append((x / away, y / away, z / away, length - away))
        return lines

    def chi2(self, east: float, north: float) -> float:
        """χ² of the differences at a place: as in the normal equations, without what only a step needs."""
        pairs = []
        for at_east, at_north, z, length in self._places:
            x, y = east - at_east, north - at_north
            away = sqrt(x * x + y * y + z * z)
            if away < 1.0:  # noqa: PLR1730 - a call for each of hundreds
                away = 1.0
            pairs.append((z / away, length - away))
        chi2 = hr = hh = 0.0
        for (wz, wr), (uz, residual) in zip(weighed_pairs(self._rows, pairs), pairs, strict=True):
            chi2 += residual * wr
            hr += uz * wr
            hh += uz * wz
        scale = self._height + hh
        return max(chi2 - hr * hr / scale if scale > 0.0 else chi2, 0.0)

    def _normal(self, east: float, north: float) -> Normal:
        """Normal equations and χ²: weights with the height's uncertainty, which is a rank one."""
        lines = self._lines(east, north)
        return self._equations(lines, weighed_lines(self._rows, lines))

    def _equations(self, lines: Sequence[Line], weighed: Sequence[Line]) -> Normal:
        ee = en = nn = be = bn = chi2 = he = hn = hr = hh = 0.0
        for (we, wn, wz, wr), (ue, un, uz, residual) in zip(weighed, lines, strict=True):
            ee += ue * we
            en += ue * wn
            nn += un * wn
            be += ue * wr
            bn += un * wr
            chi2 += residual * wr
            he += uz * we
            hn += uz * wn
            hr += uz * wr
            hh += uz * wz
        scale = self._height + hh
        if scale > 0.0:
            ee -= he * he / scale
            en -= he * hn / scale
            nn -= hn * hn / scale
            be -= he * hr / scale
            bn -= hn * hr / scale
            chi2 -= hr * hr / scale
        return ee, en, nn, be, bn, max(chi2, 0.0)

    def descend(self, east: float, north: float, pull: Pull | None = None, enough: float = -1.0) -> Place:
        """The place of least χ² near a start: Gauss–Newton whose steps are halved until they improve.

        ``pull`` adds a second opinion as a quadratic (for the question whether one place explains both). Below a χ² of
        ``enough`` nobody asks for a smaller one.
        """
        state = self._pulled(east, north, pull)
        for _ in range(_ITERATIONS):
            ee, en, nn, be, bn, chi2 = state
            if chi2 <= enough:
                break
            determinant = ee * nn - en * en
            if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
                # Only one direction is told (a far bearing): along that one.
                spread = ee + nn
                if spread <= 0.0:
                    break
                step_east, step_north = be / spread, bn / spread
            else:
                step_east = (nn * be - en * bn) / determinant
                step_north = (ee * bn - en * be) / determinant
            length = distance(step_east, step_north, 0.0)
            if length < _CONVERGED_MM:
                break
            if length > _MAX_STEP_MM:
                step_east, step_north = step_east * _MAX_STEP_MM / length, step_north * _MAX_STEP_MM / length
            for _ in range(_HALVINGS):
                after = self._pulled(east + step_east, north + step_north, pull)
                if after[5] <= chi2:
                    break
                step_east, step_north = 0.5 * step_east, 0.5 * step_north
            else:
                break
            east, north, state = east + step_east, north + step_north, after
        return Place(east, north, state[5])

    def _pulled(self, east: float, north: float, pull: Pull | None) -> Normal:
        normal = self._normal(east, north)
        if pull is None:
            return normal
        ee, en, nn, be, bn, chi2 = normal
        x, y = pull.east - east, pull.north - north
        pe, pn = pull.inverse.ee * x + pull.inverse.en * y, pull.inverse.en * x + pull.inverse.nn * y
        return (
            ee + pull.inverse.ee,
            en + pull.inverse.en,
            nn + pull.inverse.nn,
            be + pe,
            bn + pn,
            chi2 + x * pe + y * pn,
        )

    def best(self, east: float, north: float, enough: float) -> Place:
        """The place that explains the differences best, from the claim (``east``, ``north``).

        Where that way ends at a χ² above ``enough``, further fixes are begun at several distances along the bearing
        that the claim has and the one that the fix found, and on the far side.
        """
        found = self.descend(east, north)
        if found.chi2 <= enough:
            return found
        for start_east, start_north in self._starts((east, north), (found.east, found.north)):
            other = self.descend(start_east, start_north)
            if other.chi2 < found.chi2:
                found = other
        return found

    def _starts(self, *towards: tuple[float, float]) -> Iterator[tuple[float, float]]:
        middle_east, middle_north = self.middle
        for east, north in towards:
            x, y = east - middle_east, north - middle_north
            away = distance(x, y, 0.0)
            x, y = (x / away, y / away) if away > 0.0 else (1.0, 0.0)
            for ux, uy in ((x, y), (-y, x), (-x, -y), (y, -x)):
                for reach in _STARTS_MM:
                    yield middle_east + reach * ux, middle_north + reach * uy

    def covariance(self, east: float, north: float) -> tuple[Matrix2, Matrix2] | None:
        """(total, floor) covariance of an estimate here, mm²; None where the differences leave a direction open."""
        lines = self._lines(east, north)
        weighed = weighed_lines(self._rows, lines)
        ee, en, nn, _, _, _ = self._equations(lines, weighed)
        determinant = ee * nn - en * en
        if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
            return None
        total = Matrix2(nn / determinant, -en / determinant, ee / determinant)
        white_ee = white_en = white_nn = 0.0
        for (we, wn, _, _), one in zip(weighed, self.heard, strict=True):
            de = total.ee * we + total.en * wn
            dn = total.en * we + total.nn * wn
            white_ee += de * de * one.white
            white_en += de * dn * one.white
            white_nn += dn * dn * one.white
        return total, total + Matrix2(-white_ee, -white_en, -white_nn)

    def least_on_circle(self, east: float, north: float, radius: float) -> float:
        """Least χ² on a circle: how well any place at the edge of the buffer explains the differences."""
        return min([self.chi2(east + radius * x, north + radius * y) for x, y in _CIRCLE])

    def least_within(self, east: float, north: float, radius: float) -> float:
        """Least χ² over a disc, crossed on a few lines towards the anchors, each searched along itself."""
        middle_east, middle_north = self.middle
        x, y = east - middle_east, north - middle_north
        away = distance(x, y, 0.0)
        ux, uy = (x / away, y / away) if away > 0.0 else (1.0, 0.0)
        best = self.chi2(east, north)
        for line in range(-_LINES, _LINES + 1):
            aside = radius * line / _LINES
            half = sqrt(max((radius - aside) * (radius + aside), 0.0))
            start_east, start_north = east - aside * uy, north + aside * ux
            along = 0.0
            for _ in range(_LINE_STEPS):
                ee, en, nn, be, bn, chi2 = self._normal(start_east + along * ux, start_north + along * uy)
                best = min(best, chi2)
                curvature = ee * ux * ux + 2.0 * en * ux * uy + nn * uy * uy
                if curvature <= 0.0:
                    break
                along = max(-half, min(half, along + (be * ux + bn * uy) / curvature))
            best = min(best, self.chi2(start_east + along * ux, start_north + along * uy))
        return best

    def mirrored(self, place: Place) -> Place:
        """Where the fix lands from the mirror image at the anchors' long axis: a line of anchors has two answers."""
        middle_east, middle_north = self.middle
        ee = en = nn = 0.0
        for one in self.heard:
            x, y = one.east - middle_east, one.north - middle_north
            ee += x * x
            en += x * y
            nn += y * y
        line = Matrix2(ee, en, nn).ellipse()
        x, y = place.east - middle_east, place.north - middle_north
        across = y * line.east - x * line.north
        return self.descend(place.east + 2.0 * across * line.north, place.north - 2.0 * across * line.east)


@dataclass(frozen=True, slots=True)
class Pull:
    """A second estimate as a quadratic: (p − place)ᵀ inverse (p − place)."""

    east: float
    north: float
    inverse: Matrix2


def pull_of(east: float, north: float, covariance: Matrix2) -> Pull:
    """The pull of an estimate with a covariance (mm²)."""
    determinant = max(covariance.ee * covariance.nn - covariance.en * covariance.en, 1e-6)
    return Pull(
        east,
        north,
        Matrix2(covariance.nn / determinant, -covariance.en / determinant, covariance.ee / determinant),
    )
