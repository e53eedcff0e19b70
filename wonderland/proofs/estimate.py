"""From ranges to the offset between where the drone is and where it says that it is.

Each range is compared with the one that the claim of its moment would give, so a moving drone needs no special case;
the mean of these residuals, put back onto the mean claimed position, is one virtual range for each anchor, and a
least-squares fix on those gives the offset. Covariance = σ²/N_eff + bias² + survey² + height², of which only the first
part shrinks with the number of rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.rounds import UsableRounds

OUTLIER_SIGMAS: Final = 6.0
"""A residual this far from its anchor's median is a burst, not noise."""
OUTLIER_FLOOR_MM: Final = 150.0
"""Never call an error below this a burst: the white noise is not the only one."""
MIN_VALUES: Final = 3
"""Fewer usable ranges of an anchor tell nothing about it."""
_ITERATIONS: Final = 8
_CONVERGED_MM: Final = 0.01
_SINGULAR: Final = 1e-9
_MAX_STEP_MM: Final = 20_000.0


@dataclass(frozen=True, slots=True)
class AnchorMean:
    """One anchor's ranges, taken together."""

    index: int
    east: float
    north: float
    up: float
    range_mm: float
    """Corrected virtual range at the mean claimed position."""
    residual_mm: float
    """Mean of measured minus claimed."""
    count: int
    white: float
    """σ²/N_eff in mm²: the part that more rounds make smaller."""
    floor: float
    """Variance that no number of rounds makes smaller: bias and survey."""


@dataclass(frozen=True, slots=True)
class Reduced:
    """All anchors' means with the mean claimed position that they refer to."""

    anchors: tuple[AnchorMean, ...]
    east: float
    north: float
    up: float
    t_ms: int
    rounds: int
    effective: float
    """Rounds worth of independent measurements (correlated rounds count for less)."""
    bursts: int
    height_sigma_mm: float
    installation_sigma_mm: float


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


def bias_at(anchor: Anchor, range_mm: float) -> tuple[float, float]:
    """(bias, standard deviation) of an anchor's ranges at a distance: linear in its table, constant beyond."""
    table = anchor.bias
    if range_mm <= table[0].range_mm:
        return float(table[0].bias_mm), float(table[0].sigma_mm)
    for before, after in pairwise(table):
        if range_mm <= after.range_mm:
            share = (range_mm - before.range_mm) / (after.range_mm - before.range_mm)
            bias = before.bias_mm + (after.bias_mm - before.bias_mm) * share
            return bias, before.sigma_mm + (after.sigma_mm - before.sigma_mm) * share
    return float(table[-1].bias_mm), float(table[-1].sigma_mm)


def reduce(rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath) -> Reduced | None:
    """Means over the rounds, or None where fewer than three anchors are left."""
    claimed = [path.at(t_ms) for t_ms in rounds.t_ms]
    present = [point for point in claimed if point is not None]
    if not present:
        return None
    count = len(present)
    east = north = up = 0.0
    for claim in present:
        east += claim.east
        north += claim.north
        up += claim.up
    east, north, up = east / count, north / count, up / count

    series: list[tuple[int, list[float]]] = []
    bursts = 0
    for index, column in zip(rounds.anchor_indices, rounds.range_mm, strict=True):
        anchor = commissioning.anchors[index]
        residuals = []
        for value, point in zip(column, claimed, strict=True):
            if value == NO_RANGE or point is None:
                continue
            bias, _ = bias_at(anchor, float(value))
            expected = _distance(point.east - anchor.east_mm, point.north - anchor.north_mm, point.up - anchor.up_mm)
            residuals.append(value - bias - expected)
        kept = _without_bursts(residuals, float(commissioning.range_sigma_mm))
        bursts += len(residuals) - len(kept)
        if len(kept) >= MIN_VALUES:
            series.append((index, kept))
    if len(series) < 3:
        return None
    correlation = _correlation([values for _, values in series])
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma2 = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)

    anchors = []
    for index, values in series:
        anchor = commissioning.anchors[index]
        residual = _mean(values)
        expected = _distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        _, bias_sigma = bias_at(anchor, expected + residual)
        anchors.append(
            AnchorMean(
                index=index,
                east=float(anchor.east_mm),
                north=float(anchor.north_mm),
                up=float(anchor.up_mm),
                range_mm=expected + residual,
                residual_mm=residual,
                count=len(values),
                white=sigma2 / (len(values) * worth),
                floor=bias_sigma * bias_sigma + float(anchor.survey_sigma_mm * anchor.survey_sigma_mm),
            )
        )
    return Reduced(
        anchors=tuple(anchors),
        east=east,
        north=north,
        up=up,
        t_ms=rounds.t_ms[len(rounds.t_ms) // 2],
        rounds=count,
        effective=count * worth,
        bursts=bursts,
        height_sigma_mm=path.height_sigma_mm,
        installation_sigma_mm=float(commissioning.installation_sigma_mm),
    )


def solve(reduced: Reduced) -> Offset | None:
    """The offset that fits the virtual ranges best, or None where the geometry gives none."""
    best: tuple[float, float, float] | None = None
    for start in ((0.0, 0.0), _linear_start(reduced)):
        if start is None:
            continue
        found = _gauss_newton(reduced, start[0], start[1])
        if found is not None and (best is None or found[2] < best[2]):
            best = found
    if best is None:
        return None
    east, north, chi2 = best
    covariances = _covariances(reduced, east, north)
    if covariances is None:
        return None
    total, floor = covariances
    chi2_claim = 0.0
    for anchor in reduced.anchors:
        chi2_claim += anchor.residual_mm * anchor.residual_mm / (anchor.white + anchor.floor)
    return Offset(east, north, total, floor, chi2, chi2_claim, len(reduced.anchors) - 2)


def _gauss_newton(reduced: Reduced, east: float, north: float) -> tuple[float, float, float] | None:
    """(east, north, χ²) from a start; None where the normal equations are singular."""
    for _ in range(_ITERATIONS):
        normal = _normal(reduced, east, north)
        if normal is None:
            return None
        (ee, en, nn), (be, bn), _ = normal
        determinant = ee * nn - en * en
        if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
            return None
        step_east = (nn * be - en * bn) / determinant
        step_north = (ee * bn - en * be) / determinant
        length = sqrt(step_east * step_east + step_north * step_north)
        if length > _MAX_STEP_MM:
            step_east, step_north = step_east * _MAX_STEP_MM / length, step_north * _MAX_STEP_MM / length
        east += step_east
        north += step_north
        if length < _CONVERGED_MM:
            break
    final = _normal(reduced, east, north)
    return None if final is None else (east, north, final[2])


def _normal(
    reduced: Reduced, east: float, north: float
) -> tuple[tuple[float, float, float], tuple[float, float], float] | None:
    """Weighted normal equations and χ² at an offset; None on top of an anchor, where directions end."""
    ee = en = nn = be = bn = chi2 = 0.0
    for anchor in reduced.anchors:
        x = reduced.east + east - anchor.east
        y = reduced.north + north - anchor.north
        distance = _distance(x, y, reduced.up - anchor.up)
        if distance < 1.0:
            return None
        weight = 1.0 / (anchor.white + anchor.floor)
        ue, un = x / distance, y / distance
        residual = anchor.range_mm - distance
        ee += weight * ue * ue
        en += weight * ue * un
        nn += weight * un * un
        be += weight * ue * residual
        bn += weight * un * residual
        chi2 += weight * residual * residual
    return (ee, en, nn), (be, bn), chi2


def _covariances(reduced: Reduced, east: float, north: float) -> tuple[Matrix2, Matrix2] | None:
    """(total, floor) covariance of the weighted solution, with the errors that anchors share."""
    normal = _normal(reduced, east, north)
    if normal is None:
        return None
    (ee, en, nn), _, _ = normal
    determinant = ee * nn - en * en
    if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
        return None
    inverse_ee, inverse_en, inverse_nn = nn / determinant, -en / determinant, ee / determinant
    white = Matrix2(0.0, 0.0, 0.0)
    floor = Matrix2(0.0, 0.0, 0.0)
    common_east = common_north = height_east = height_north = 0.0
    for anchor in reduced.anchors:
        x = reduced.east + east - anchor.east
        y = reduced.north + north - anchor.north
        z = reduced.up - anchor.up
        distance = _distance(x, y, z)
        weight = 1.0 / (anchor.white + anchor.floor)
        # How far the solution moves for one millimetre of error in this anchor's range.
        gain_east = weight * (inverse_ee * x + inverse_en * y) / distance
        gain_north = weight * (inverse_en * x + inverse_nn * y) / distance
        outer = Matrix2(gain_east * gain_east, gain_east * gain_north, gain_north * gain_north)
        white += outer.scaled(anchor.white)
        floor += outer.scaled(anchor.floor)
        common_east += gain_east
        common_north += gain_north
        height_east += gain_east * z / distance
        height_north += gain_north * z / distance
    installation = reduced.installation_sigma_mm * reduced.installation_sigma_mm
    height = reduced.height_sigma_mm * reduced.height_sigma_mm
    for variance, x, y in ((installation, common_east, common_north), (height, height_east, height_north)):
        floor += Matrix2(x * x, x * y, y * y).scaled(variance)
    return white + floor, floor


def _linear_start(reduced: Reduced) -> tuple[float, float] | None:
    """Offset from differences of squared ranges: no start needed, so a lie of any size is found."""
    base = reduced.anchors[0]
    ee = en = nn = be = bn = 0.0
    for anchor in reduced.anchors[1:]:
        a = 2.0 * (anchor.east - base.east)
        b = 2.0 * (anchor.north - base.north)
        height = (reduced.up - base.up) * (reduced.up - base.up) - (reduced.up - anchor.up) * (reduced.up - anchor.up)
        value = base.range_mm * base.range_mm - anchor.range_mm * anchor.range_mm - height
        value += (
            anchor.east * anchor.east - base.east * base.east + anchor.north * anchor.north - base.north * base.north
        )
        ee += a * a
        en += a * b
        nn += b * b
        be += a * value
        bn += b * value
    determinant = ee * nn - en * en
    if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
        return None
    x = (nn * be - en * bn) / determinant
    y = (ee * bn - en * be) / determinant
    return x - reduced.east, y - reduced.north


def _without_bursts(values: Sequence[float], sigma: float) -> list[float]:
    if not values:
        return []
    ordered = sorted(values)
    median = ordered[len(ordered) // 2]
    limit = max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)
    return [value for value in values if -limit <= value - median <= limit]


def _correlation(series: Sequence[Sequence[float]]) -> float:
    """Lag-1 correlation of the residuals over time, all anchors together, with a margin; 0 to 0.95."""
    steps = spread = 0.0
    count = 0
    for values in series:
        mean = _mean(values)
        for value in values:
            spread += (value - mean) * (value - mean)
        for before, after in pairwise(values):
            steps += (after - before) * (after - before)
        count += len(values)
    if spread <= 0.0:
        return 0.0
    correlation = 1.0 - 0.5 * steps / spread + 1.0 / sqrt(float(count))
    return 0.0 if correlation < 0.0 else min(correlation, 0.95)


def _mean(values: Sequence[float]) -> float:
    total = 0.0
    for value in values:
        total += value
    return total / len(values)


def _distance(x: float, y: float, z: float) -> float:
    return sqrt(x * x + y * y + z * z)
