"""Where the drone is in three dimensions, by the ranges alone: no word of the claim on its height.

Generalised least squares as in ``estimate``, with the height as a third unknown and without the claimed one as an
observation. Anchors nearly in one plane leave two places, one on each side of it; both are found, and both count.
Near that plane the likelihood is no bell (the height enters by its square), so what a height costs is asked of the
ranges themselves (``least_chi2_at``), not of the covariance alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

from wonderland.proofs.claims import LOWEST_MM
from wonderland.proofs.estimate import MIRROR_APART_MM, MIRROR_CHI2, least_chi2_at
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reduction import Reduced, distance
from wonderland.proofs.weighing import Line, Weights, weighed_lines, with_shared_error

FOUR: Final = 4
"""Three unknowns, and one anchor to contradict them."""
_ITERATIONS: Final = 16
_HALVINGS: Final = 8
_CONVERGED_MM: Final = 0.05
_MAX_STEP_MM: Final = 20_000.0
_SINGULAR: Final = 1e-9

Normal = tuple[float, float, float, float, float, float]
"""A symmetric matrix: ee, en, eu, nn, nu, uu."""
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Solid:
    """Estimate minus claim in the pad's frame (mm), with its covariance (mm²)."""

    east: float
    north: float
    up: float
    horizontal: Matrix2
    eu: float
    nu: float
    uu: float
    floor: float
    """Part of the vertical variance that more rounds do not shrink."""
    gains: tuple[float, ...]
    """How far the height moves for one millimetre of each anchor's range."""
    chi2: float
    freedom: int
    others: tuple[float, ...] = ()
    """Heights (offsets) of further places that these ranges cannot tell from this one."""


@dataclass(frozen=True, slots=True)
class _Spot:
    place: Vector
    chi2: float


def solve_in_space(reduced: Reduced, east: float, north: float, others: Sequence[float] = ()) -> Solid | None:
    """The place that fits best, from a start (offset from the claim, mm) at the claimed height, and at ``others``.

    None where four anchors have no ranges, or their geometry leaves the height open.
    """
    if len(reduced.anchors) < FOUR:
        return None
    problem = _Problem(reduced)
    starts = [problem.descend((east, north, up)) for up in (0.0, *others)]
    spots = [spot for spot in starts if spot is not None]
    if not spots:
        return None
    image = problem.mirrored(spots[0].place)
    if reduced.up + image[2] >= problem.lowest - MIRROR_APART_MM:  # below that nobody ranges from
        mirrored = problem.descend(image)
        if mirrored is not None:
            spots.append(mirrored)
    spots = [spot for spot in spots if reduced.up + spot.place[2] >= problem.lowest]
    if not spots:
        return None
    least = min(spot.chi2 for spot in spots)
    # Among places that the ranges cannot tell apart the drone has the benefit of the doubt.
    alike = [spot for spot in spots if spot.chi2 - least < MIRROR_CHI2]
    best = min(alike, key=lambda spot: abs(spot.place[2]))
    away = tuple(spot.place[2] for spot in alike if abs(spot.place[2] - best.place[2]) > MIRROR_APART_MM)
    return problem.described(best, away)


def chi2_at_height(reduced: Reduced, solid: Solid, up: float) -> float:
    """χ² of the best place at a height (offset from the claimed one, mm): what that height costs."""
    along = (up - solid.up) / solid.uu
    return least_chi2_at(reduced, up, solid.east + along * solid.eu, solid.north + along * solid.nu)


class _Problem:
    def __init__(self, reduced: Reduced) -> None:
        self._reduced = reduced
        self._weights: Weights = with_shared_error(
            [1.0 / max(anchor.white + anchor.floor, 1.0) for anchor in reduced.anchors],
            reduced.installation_sigma_mm,
        )[1]
        self._places = tuple((anchor.east, anchor.north, anchor.up, anchor.range_mm) for anchor in reduced.anchors)
        self.lowest = min(anchor.up for anchor in reduced.anchors) - LOWEST_MM

    def _lines(self, place: Vector) -> list[Line]:
        """From each anchor: direction (east, north, up) and range minus way, mm."""
        east, north, up = (
            self._reduced.east + place[0],
            self._reduced.north + place[1],
            self._reduced.up + place[2],
        )
        lines = []
        for at_east, at_north, at_up, range_mm in self._places:
            x, y, z = east - at_east, north - at_north, up - at_up
            away = max(sqrt(x * x + y * y + z * z), 1.0)
            lines.append((x / away, y / away, z / away, range_mm - away))
        return lines

    def descend(self, place: Vector) -> _Spot | None:
        """Gauss–Newton whose steps are halved until they improve; None where a direction is left open."""
        lines = self._lines(place)
        matrix, right, chi2 = _normal(self._weights, lines)
        for _ in range(_ITERATIONS):
            inverse = _inverse(matrix)
            if inverse is None:
                return None
            step = _times(inverse, right)
            length = distance(*step)
            if length < _CONVERGED_MM:
                break
            scale = min(1.0, _MAX_STEP_MM / length)
            for _ in range(_HALVINGS):
                tried = (place[0] + scale * step[0], place[1] + scale * step[1], place[2] + scale * step[2])
                lines = self._lines(tried)
                after = _normal(self._weights, lines)
                if after[2] <= chi2:
                    break
                scale *= 0.5
            else:
                break
            place = tried
            matrix, right, chi2 = after
        return _Spot(place, chi2)

    def mirrored(self, place: Vector) -> Vector:
        """The place on the other side of the plane through the anchors, at the same place on the map.

        The plane is that of least squares over the ground: the anchors of a pad stand side by side.
        """
        count = len(self._places)
        east = north = up = 0.0
        for x, y, z, _ in self._places:
            east, north, up = east + x / count, north + y / count, up + z / count
        ee = en = nn = eu = nu = 0.0
        for at_east, at_north, at_up, _ in self._places:
            x, y, z = at_east - east, at_north - north, at_up - up
            ee, en, nn, eu, nu = ee + x * x, en + x * y, nn + y * y, eu + x * z, nu + y * z
        determinant = ee * nn - en * en
        slope_east = slope_north = 0.0
        if determinant > _SINGULAR * (ee + nn) * (ee + nn):
            slope_east, slope_north = (nn * eu - en * nu) / determinant, (ee * nu - en * eu) / determinant
        x, y = self._reduced.east + place[0] - east, self._reduced.north + place[1] - north
        over = self._reduced.up + place[2] - (up + slope_east * x + slope_north * y)
        square = 1.0 + slope_east * slope_east + slope_north * slope_north
        back = 2.0 * over / square
        return place[0] + back * slope_east, place[1] + back * slope_north, place[2] - back

    def described(self, spot: _Spot, others: tuple[float, ...]) -> Solid | None:
        """The place with its covariance, the clock's part along the claimed velocity with it."""
        lines = self._lines(spot.place)
        inverse = _inverse(_normal(self._weights, lines)[0])
        if inverse is None:
            return None
        ee, en, eu, nn, nu, uu = inverse
        gains = tuple([eu * we + nu * wn + uu * wu for we, wn, wu, _ in weighed_lines(self._weights, lines)])
        white = 0.0
        for gain, anchor in zip(gains, self._reduced.anchors, strict=True):
            white += gain * gain * anchor.white
        reduced = self._reduced
        clock = reduced.clock_sigma_ms
        x, y, z = reduced.velocity_east * clock, reduced.velocity_north * clock, _climb(reduced) * clock
        return Solid(
            east=spot.place[0],
            north=spot.place[1],
            up=spot.place[2],
            horizontal=Matrix2(ee + x * x, en + x * y, nn + y * y),
            eu=eu + x * z,
            nu=nu + y * z,
            uu=uu + z * z,
            floor=max(uu - white, 0.0) + z * z,
            gains=gains,
            chi2=spot.chi2,
            freedom=len(lines) - 3,
            others=others,
        )


def _climb(reduced: Reduced) -> float:
    """Mean claimed vertical velocity over the rounds, mm/ms."""
    track = reduced.residuals.track if reduced.residuals is not None else None
    if track is None or track.t_ms[-1] <= track.t_ms[0]:
        return 0.0
    return (track.up[-1] - track.up[0]) / (track.t_ms[-1] - track.t_ms[0])


def _normal(weights: Weights, lines: Sequence[Line]) -> tuple[Normal, Vector, float]:
    """Normal equations (matrix, right side) and χ²."""
    ee = en = eu = nn = nu = uu = be = bn = bu = chi2 = 0.0
    for (we, wn, wu, wr), (e, n, u, residual) in zip(weighed_lines(weights, lines), lines, strict=True):
        ee += e * we
        en += e * wn
        eu += e * wu
        nn += n * wn
        nu += n * wu
        uu += u * wu
        be += e * wr
        bn += n * wr
        bu += u * wr
        chi2 += residual * wr
    return (ee, en, eu, nn, nu, uu), (be, bn, bu), max(chi2, 0.0)


def _inverse(matrix: Normal) -> Normal | None:
    ee, en, eu, nn, nu, uu = matrix
    a, b, c = nn * uu - nu * nu, eu * nu - en * uu, en * nu - eu * nn
    determinant = ee * a + en * b + eu * c
    third = (ee + nn + uu) / 3.0
    if determinant <= _SINGULAR * third * third * third:
        return None
    return (
        a / determinant,
        b / determinant,
        c / determinant,
        (ee * uu - eu * eu) / determinant,
        (en * eu - ee * nu) / determinant,
        (ee * nn - en * en) / determinant,
    )


def _times(matrix: Normal, vector: Vector) -> Vector:
    ee, en, eu, nn, nu, uu = matrix
    x, y, z = vector
    return ee * x + en * y + eu * z, en * x + nn * y + nu * z, eu * x + nu * y + uu * z
