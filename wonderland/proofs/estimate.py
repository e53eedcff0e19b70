"""From virtual ranges to the offset between where the drone is and where it says that it is: step 8 of the verdict.

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
from wonderland.proofs.reduction import AnchorMean, Reduced, distance

MIRROR_CHI2: Final = 13.815510557964274
"""A second position is excluded only if its χ² is worse by this (a likelihood a thousand times smaller)."""
MIRROR_APART_MM: Final = 100.0
"""Two solutions nearer to each other than this are one."""
_ITERATIONS: Final = 12
_CONVERGED_MM: Final = 0.01
_LINES: Final = 8
"""Lines on each side of the middle on which a disc is crossed."""
_LINE_STEPS: Final = 4
_REWEIGH_MM: Final = 10.0
"""After a step longer than this the weights are another place's: a fix from afar would end beside the best one."""
_SINGULAR: Final = 1e-9
_MAX_STEP_MM: Final = 20_000.0

Weights = tuple[tuple[float, ...], ...]
"""Inverse covariance of the virtual ranges, 1/mm²."""


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
    fixes = [fix for fix in (_fix(reduced, (0.0, 0.0)), _fix(reduced, _claim_free(reduced))) if fix is not None]
    if not fixes:
        return None
    best = min(fixes, key=lambda fix: fix.chi2)
    mirrored = _fix(reduced, _mirrored(reduced, best))
    if mirrored is not None:
        fixes.append(mirrored)
        best = min(fixes, key=lambda fix: fix.chi2)
    # Among solutions that the ranges cannot tell apart the drone has the benefit of the doubt.
    alike = [fix for fix in fixes if fix.chi2 - best.chi2 < MIRROR_CHI2]
    best = min(alike, key=lambda fix: fix.east * fix.east + fix.north * fix.north)
    others = [fix for fix in alike if distance(fix.east - best.east, fix.north - best.north, 0.0) > MIRROR_APART_MM]
    covariances = _covariances(reduced, best)
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
        _quadratic(_weights(reduced, 0.0, 0.0), residuals),
        len(reduced.anchors) - 2,
        (others[0].east, others[0].north) if others else None,
    )


def least_chi2_within(reduced: Reduced, east: float, north: float, radius: float) -> float:
    """Least χ² of the ranges over a disc about an offset: how well any place within the buffer explains them.

    Where the ellipse is longer than the buffer the covariance at the estimate says little about places far from it;
    this asks the ranges themselves. The places that fit lie on an arc about the anchors, so that the disc is crossed on
    a few lines towards the anchors, each searched by Gauss–Newton along itself.
    """
    count = len(reduced.anchors)
    x, y = reduced.east + east, reduced.north + north
    for anchor in reduced.anchors:
        x -= anchor.east / count
        y -= anchor.north / count
    away = distance(x, y, 0.0)
    ux, uy = (x / away, y / away) if away > 0.0 else (1.0, 0.0)
    weights = _weights(reduced, east, north)
    best = _quadratic(weights, _residuals(reduced, east, north))
    for line in range(-_LINES, _LINES + 1):
        aside = radius * line / _LINES
        half = sqrt(max((radius - aside) * (radius + aside), 0.0))
        start_east, start_north = east - aside * uy, north + aside * ux
        along = 0.0
        for _ in range(_LINE_STEPS):
            normal = _normal(reduced, weights, start_east + along * ux, start_north + along * uy)
            if normal is None:
                break
            ee, en, nn, be, bn, chi2 = normal
            best = min(best, chi2)
            curvature = ee * ux * ux + 2.0 * en * ux * uy + nn * uy * uy
            if curvature <= 0.0:
                break
            along = max(-half, min(half, along + (be * ux + bn * uy) / curvature))
    return best


def without(reduced: Reduced, position: int) -> Reduced:
    """The same without one anchor, by its position in ``reduced.anchors``."""
    return replace(reduced, anchors=reduced.anchors[:position] + reduced.anchors[position + 1 :])


def _fix(reduced: Reduced, start: tuple[float, float] | None) -> _Fix | None:
    """Gauss–Newton from a start; None where the normal equations are singular. The weights follow the position."""
    if start is None:
        return None
    east, north = start
    chi2 = length = 0.0
    weights: Weights = ()
    for iteration in range(_ITERATIONS):
        if iteration < 3 or length > _REWEIGH_MM:  # nearer than that the shared errors' directions hardly change
            weights = _weights(reduced, east, north)
        normal = _normal(reduced, weights, east, north)
        if normal is None:
            return None
        ee, en, nn, be, bn, chi2 = normal
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


def _normal(
    reduced: Reduced, weights: Weights, east: float, north: float
) -> tuple[float, float, float, float, float, float] | None:
    """Normal equations (matrix, right side) and χ² at an offset; None on top of an anchor, where directions end."""
    directions: list[tuple[float, float, float]] = []
    for anchor in reduced.anchors:
        x = reduced.east + east - anchor.east
        y = reduced.north + north - anchor.north
        away = distance(x, y, reduced.up - anchor.up)
        if away < 1.0:
            return None
        directions.append((x / away, y / away, anchor.range_mm - away))
    ee = en = nn = be = bn = chi2 = 0.0
    for row, (ue, un, residual) in zip(weights, directions, strict=True):
        we = wn = wr = 0.0
        for weight, (ve, vn, other) in zip(row, directions, strict=True):
            we += weight * ve
            wn += weight * vn
            wr += weight * other
        ee += ue * we
        en += ue * wn
        nn += un * wn
        be += ue * wr
        bn += un * wr
        chi2 += residual * wr
    return ee, en, nn, be, bn, max(chi2, 0.0)


def _weights(reduced: Reduced, east: float, north: float) -> Weights:
    """Inverse of diag(white + floor) + installation²·11ᵀ + height²·hhᵀ (Sherman and Morrison, twice).

    With d the inverse of the diagonal: diag(d) − α·ddᵀ − β·qqᵀ.
    """
    own: list[float] = []
    heights: list[float] = []
    total = weighted = 0.0
    x, y, z = reduced.east + east, reduced.north + north, reduced.up
    for anchor in reduced.anchors:
        rise = z - anchor.up
        away = distance(x - anchor.east, y - anchor.north, rise)
        height = rise / away if away >= 1.0 else 1.0
        inverse = 1.0 / max(anchor.white + anchor.floor, 1.0)
        own.append(inverse)
        heights.append(height)
        total += inverse
        weighted += inverse * height
    sigma = reduced.installation_sigma_mm
    alpha = 1.0 / (1.0 / (sigma * sigma) + total) if sigma > 0.0 else 0.0
    shared = alpha * weighted
    second: list[float] = []
    gain = 0.0
    for inverse, height in zip(own, heights, strict=True):
        value = inverse * (height - shared)
        second.append(value)
        gain += height * value
    sigma = reduced.height_sigma_mm
    beta = 1.0 / (1.0 / (sigma * sigma) + gain) if sigma > 0.0 else 0.0
    pairs = tuple(zip(own, second, strict=True))
    return tuple(
        tuple(
            (left if i == j else 0.0) - alpha * left * right - beta * of_left * of_right
            for j, (right, of_right) in enumerate(pairs)
        )
        for i, (left, of_left) in enumerate(pairs)
    )


def _covariances(reduced: Reduced, fix: _Fix) -> tuple[Matrix2, Matrix2] | None:
    """(total, floor) covariance of the fix: the inverse normal matrix, and the clock's part along the velocity."""
    weights = _weights(reduced, fix.east, fix.north)
    normal = _normal(reduced, weights, fix.east, fix.north)
    if normal is None:
        return None
    ee, en, nn = normal[:3]
    determinant = ee * nn - en * en
    if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
        return None
    inverse = Matrix2(nn / determinant, -en / determinant, ee / determinant)
    directions = [_direction(reduced, anchor, fix) for anchor in reduced.anchors]
    white = Matrix2(0.0, 0.0, 0.0)
    for position, anchor in enumerate(reduced.anchors):
        # How far the solution moves for one millimetre of error in this anchor's range.
        we = wn = 0.0
        for weight, (ue, un) in zip(weights[position], directions, strict=True):
            we += weight * ue
            wn += weight * un
        east = inverse.ee * we + inverse.en * wn
        north = inverse.en * we + inverse.nn * wn
        white += Matrix2(east * east, east * north, north * north).scaled(anchor.white)
    x, y = reduced.velocity_east * reduced.clock_sigma_ms, reduced.velocity_north * reduced.clock_sigma_ms
    total = inverse + Matrix2(x * x, x * y, y * y)
    return total, total + white.scaled(-1.0)


def _residuals(reduced: Reduced, east: float, north: float) -> list[float]:
    return [
        anchor.range_mm
        - distance(reduced.east + east - anchor.east, reduced.north + north - anchor.north, reduced.up - anchor.up)
        for anchor in reduced.anchors
    ]


def _direction(reduced: Reduced, anchor: AnchorMean, fix: _Fix) -> tuple[float, float]:
    x = reduced.east + fix.east - anchor.east
    y = reduced.north + fix.north - anchor.north
    away = distance(x, y, reduced.up - anchor.up)
    return x / away, y / away


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
