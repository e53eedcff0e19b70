"""From virtual ranges to the offset between where the drone is and where it says it is: part of step 5 of the verdict.

Generalised least squares: each anchor has its own error (σ²/N_eff + bias² + survey²), and all share two, the
installation's bias and the uncertainty of the claimed height. Only σ²/N_eff shrinks with the number of rounds. Three
starts (the claim, a fix that needs none, and the mirror image of what these find) keep the fix from a wrong
minimum and find the second one that anchors nearly in a line leave open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.fix import Multilateration
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.reduction import Reduced, distance
from wonderland.proofs.weighing import Line, Weights, less_outer, normal_on_the_map, weighed_lines, with_shared_error

MIRROR_CHI2: Final = 13.815510557964274
"""A second position is excluded only if its χ² is worse by this (a likelihood a thousand times smaller)."""
MIRROR_APART_MM: Final = 100.0
"""Two solutions nearer to each other than this are one."""
_ITERATIONS: Final = 12
_CONVERGED_MM: Final = 0.01
LINES: Final = 8
"""Lines on each side of the middle on which a disc is crossed."""
LINE_STEPS: Final = 4
_REWEIGH_MM: Final = 10.0
"""After a step longer than this the weights are another place's: a fix from afar would end beside the best one."""
_SINGULAR: Final = 1e-9
_MAX_STEP_MM: Final = 20_000.0


@dataclass(frozen=True, slots=True)
class Offset:
    """Estimate minus claim, in the pad's frame."""

    east: float
    north: float
    covariance: Matrix2
    floor: Matrix2
    """Part of the covariance that more rounds do not shrink."""
    chi2: float
    """Of the virtual ranges about the estimate."""
    chi2_claim: float
    """Of the virtual ranges about the claim."""
    freedom: int
    mirror: tuple[float, float] | None = None
    """A second offset that these ranges cannot tell from this one."""


@dataclass(frozen=True, slots=True)
class _Fix:
    east: float
    north: float
    chi2: float


def solve(reduced: Reduced) -> Offset | None:
    """The offset that fits the virtual ranges best, or None where the geometry gives none."""
    ranges = _Ranges(reduced)
    fixes = [fix for fix in (_fix(ranges, (0.0, 0.0)), _fix(ranges, _claim_free(reduced))) if fix is not None]
    if not fixes:
        return None
    best = min(fixes, key=lambda fix: fix.chi2)
    mirrored = _fix(ranges, _mirrored(reduced, best))
    if mirrored is not None:
        fixes.append(mirrored)
        best = min(fixes, key=lambda fix: fix.chi2)
    # Among solutions that the ranges cannot tell apart the drone has the benefit of the doubt.
    alike = [fix for fix in fixes if fix.chi2 - best.chi2 < MIRROR_CHI2]
    best = min(alike, key=lambda fix: fix.east * fix.east + fix.north * fix.north)
    others = [fix for fix in alike if distance(fix.east - best.east, fix.north - best.north, 0.0) > MIRROR_APART_MM]
    covariances = _covariances(ranges, best)
    if covariances is None:
        return None
    total, floor = covariances
    residuals = [anchor.residual_mm for anchor in reduced.anchors]
    return Offset(
        best.east,
        best.north,
        total,
        floor,
        best.chi2,
        _quadratic(ranges.weights_at(0.0, 0.0), residuals),
        len(reduced.anchors) - 2,
        (others[0].east, others[0].north) if others else None,
    )


def least_chi2_within(reduced: Reduced, east: float, north: float, radius: float) -> float:
    """Least χ² of the ranges over a disc about an offset: how well any place within the buffer explains them.

    Where the ellipse is longer than the buffer, or the drone above the anchors, the covariance at the estimate says
    little about places away from it; this asks the ranges themselves. The places that fit lie on an arc about the
    anchors, so that the disc is crossed on a few lines towards them, each searched by Gauss–Newton along itself.
    """
    count = len(reduced.anchors)
    x, y = reduced.east + east, reduced.north + north
    for anchor in reduced.anchors:
        x -= anchor.east / count
        y -= anchor.north / count
    away = distance(x, y, 0.0)
    ux, uy = (x / away, y / away) if away > 0.0 else (1.0, 0.0)
    ranges = _Ranges(reduced)
    weights = ranges.weights_at(east, north)
    best = _quadratic(weights, _residuals(reduced, east, north))
    for line in range(-LINES, LINES + 1):
        aside = radius * line / LINES
        half = sqrt(max((radius - aside) * (radius + aside), 0.0))
        start_east, start_north = east - aside * uy, north + aside * ux
        along = 0.0
        for _ in range(LINE_STEPS):
            lines = ranges.lines(start_east + along * ux, start_north + along * uy)
            if lines is None:
                break
            ee, en, nn, be, bn, chi2 = normal_on_the_map(weights, lines)
            best = min(best, chi2)
            curvature = ee * ux * ux + 2.0 * en * ux * uy + nn * uy * uy
            if curvature <= 0.0:
                break
            along = max(-half, min(half, along + (be * ux + bn * uy) / curvature))
    return best


def least_chi2_at(reduced: Reduced, up: float, east: float, north: float) -> float:
    """χ² of the best place at another height (``up`` mm above the claimed one), from a start (offset, mm).

    0 where none is found: what cannot be computed excludes nothing.
    """
    fix = _fix(_Ranges(replace(reduced, up=reduced.up + up, height_sigma_mm=0.0)), (east, north))
    return fix.chi2 if fix is not None else 0.0


def without(reduced: Reduced, position: int) -> Reduced:
    """The same without one anchor, by its position in ``reduced.anchors``."""
    return replace(reduced, anchors=reduced.anchors[:position] + reduced.anchors[position + 1 :])


class _Ranges:
    """The virtual ranges as a problem of least squares: what stays the same wherever the drone is, computed once.

    Their covariance is diag(white + floor) + installation²·11ᵀ + height²·hhᵀ, h the directions' rise; inverted by
    Sherman and Morrison, twice. With d the inverse of the diagonal: diag(d) − α·ddᵀ − β·qqᵀ; only q depends on the
    place.
    """

    def __init__(self, reduced: Reduced) -> None:
        self.reduced: Final = reduced
        self._places: Final = tuple(
            (anchor.east, anchor.north, reduced.up - anchor.up, anchor.range_mm) for anchor in reduced.anchors
        )
        own = [1.0 / max(anchor.white + anchor.floor, 1.0) for anchor in reduced.anchors]
        alpha, rows = with_shared_error(own, reduced.installation_sigma_mm)
        sigma = reduced.height_sigma_mm
        self._own: Final = own
        self._alpha: Final = alpha
        self._rows: Final = rows
        """diag(d) − α·ddᵀ."""
        self._height: Final = 1.0 / (sigma * sigma) if sigma > 0.0 else None

    def lines(self, east: float, north: float) -> list[Line] | None:
        """From each anchor to an offset: direction (east, north, up), and range minus way, mm.

        None on top of an anchor, where directions end.
        """
        east, north = self.reduced.east + east, self.reduced.north + north
        lines = []
        for at_east, at_north, rise, range_mm in self._places:
            x, y = east - at_east, north - at_north
            away = sqrt(x * x + y * y + rise * rise)
            if away < 1.0:
                return None
            lines.append((x / away, y / away, rise / away, range_mm - away))
        return lines

    def weights_at(self, east: float, north: float) -> Weights:
        """The weights at an offset, on top of an anchor, too."""
        east, north = self.reduced.east + east, self.reduced.north + north
        heights = []
        for at_east, at_north, rise, _ in self._places:
            away = distance(east - at_east, north - at_north, rise)
            heights.append(rise / away if away >= 1.0 else 1.0)
        return self.weights(heights)

    def weights(self, heights: Sequence[float]) -> Weights:
        """Inverse covariance where the directions rise so."""
        if self._height is None:
            return self._rows
        weighted = 0.0
        for inverse, height in zip(self._own, heights, strict=True):
            weighted += inverse * height
        shared = self._alpha * weighted
        second: list[float] = []
        gain = 0.0
        for inverse, height in zip(self._own, heights, strict=True):
            value = inverse * (height - shared)
            second.append(value)
            gain += height * value
        return less_outer(self._rows, second, 1.0 / (self._height + gain))


def _fix(ranges: _Ranges, start: tuple[float, float] | None) -> _Fix | None:
    """Gauss–Newton from a start; None where the normal equations are singular. The weights follow the position."""
    if start is None:
        return None
    east, north = start
    chi2 = length = 0.0
    weights: Weights = ()
    for iteration in range(_ITERATIONS):
        lines = ranges.lines(east, north)
        if lines is None:
            return None
        if iteration < 3 or length > _REWEIGH_MM:  # nearer than that the shared errors' directions hardly change
            weights = ranges.weights([rise for _, _, rise, _ in lines])
        ee, en, nn, be, bn, chi2 = normal_on_the_map(weights, lines)
        determinant = ee * nn - en * en
        if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
            return None
        step_east = (nn * be - en * bn) / determinant
        step_north = (ee * bn - en * be) / determinant
        length = sqrt(step_east * step_east + step_north * step_north)
        if length < _CONVERGED_MM and iteration > 0:
            break
        if length > _MAX_STEP_MM:
            step_east, step_north = step_east * _MAX_STEP_MM / length, step_north * _MAX_STEP_MM / length
        east += step_east
        north += step_north
    return _Fix(east, north, chi2)


def _covariances(ranges: _Ranges, fix: _Fix) -> tuple[Matrix2, Matrix2] | None:
    """(total, floor) covariance of the fix: the inverse normal matrix, and the clock's part along the velocity."""
    reduced = ranges.reduced
    lines = ranges.lines(fix.east, fix.north)
    if lines is None:
        return None
    weights = ranges.weights([rise for _, _, rise, _ in lines])
    ee, en, nn = normal_on_the_map(weights, lines)[:3]
    determinant = ee * nn - en * en
    if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
        return None
    inverse = Matrix2(nn / determinant, -en / determinant, ee / determinant)
    white_ee = white_en = white_nn = 0.0
    for (we, wn, _, _), anchor in zip(weighed_lines(weights, lines), reduced.anchors, strict=True):
        # How far the solution moves for one millimetre of error in this anchor's range.
        east = inverse.ee * we + inverse.en * wn
        north = inverse.en * we + inverse.nn * wn
        white_ee += east * east * anchor.white
        white_en += east * north * anchor.white
        white_nn += north * north * anchor.white
    x, y = reduced.velocity_east * reduced.clock_sigma_ms, reduced.velocity_north * reduced.clock_sigma_ms
    total = inverse + Matrix2(x * x, x * y, y * y)
    return total, total + Matrix2(-white_ee, -white_en, -white_nn)


def _residuals(reduced: Reduced, east: float, north: float) -> list[float]:
    return [
        anchor.range_mm
        - distance(reduced.east + east - anchor.east, reduced.north + north - anchor.north, reduced.up - anchor.up)
        for anchor in reduced.anchors
    ]


def _quadratic(weights: Weights, residuals: Sequence[float]) -> float:
    total = 0.0
    for row, left in zip(weights, residuals, strict=True):
        for weight, right in zip(row, residuals, strict=True):
            total += left * weight * right
    return max(total, 0.0)


def _claim_free(reduced: Reduced) -> tuple[float, float] | None:
    """Offset to a fix that needs no start, so that a lie of any size is found; None for anchors in a line."""
    try:
        geometry = Multilateration([(anchor.east, anchor.north, anchor.up) for anchor in reduced.anchors])
    except GeometryError:
        return None
    found = geometry.fix([anchor.range_mm for anchor in reduced.anchors], reduced.up)
    return None if found is None else (found[0] - reduced.east, found[1] - reduced.north)


def _mirrored(reduced: Reduced, fix: _Fix) -> tuple[float, float]:
    """The fix mirrored at the line through the anchors: what ranges to a line of anchors cannot tell from it."""
    count = len(reduced.anchors)
    middle_east = middle_north = 0.0
    for anchor in reduced.anchors:
        middle_east += anchor.east
        middle_north += anchor.north
    middle_east, middle_north = middle_east / count, middle_north / count
    ee = en = nn = 0.0
    for anchor in reduced.anchors:
        x, y = anchor.east - middle_east, anchor.north - middle_north
        ee += x * x
        en += x * y
        nn += y * y
    line = Matrix2(ee, en, nn).ellipse()
    x, y = reduced.east + fix.east - middle_east, reduced.north + fix.north - middle_north
    across = y * line.east - x * line.north
    return (
        fix.east + 2.0 * across * line.north,
        fix.north - 2.0 * across * line.east,
    )
