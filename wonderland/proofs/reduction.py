"""From rounds to one virtual range for each anchor: steps 4 and 7 of the verdict.

Each range is corrected by its anchor's bias and compared with the one that the claim of its moment would give, so that
a moving drone needs no special case; the mean of these residuals, put back onto the mean claimed position, is one
virtual range for each anchor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath, LocalClaim
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.rounds import UsableRounds

OUTLIER_SIGMAS: Final = 6.0
"""A residual this far from its anchor's median is a burst, not noise."""
OUTLIER_FLOOR_MM: Final = 150.0
"""Never call an error below this a burst: the white noise is not the only one."""
MIN_VALUES: Final = 3
"""Fewer usable ranges of an anchor tell nothing about it."""
MOST_CORRELATED: Final = 0.95
CLAIM_CLOCK_SIGMA_MS: Final = 50.0
"""How well a drone's clock agrees with the pad's: GNSS time and NTP, with the age of a position when it is claimed."""
HEIGHT_SIGMA_FLOOR_MM: Final = 50.0
"""Nobody knows a drone's antenna better than this, whatever accuracy it claims."""


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
    velocity_east: float = 0.0
    velocity_north: float = 0.0
    """Mean claimed velocity over the rounds, mm/ms: times the clock's uncertainty, one more error."""
    clock_sigma_ms: float = CLAIM_CLOCK_SIGMA_MS


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


def reduce(
    rounds: UsableRounds,
    commissioning: Commissioning,
    path: ClaimedPath,
    clock_sigma_ms: float = CLAIM_CLOCK_SIGMA_MS,
) -> Reduced | None:
    """Means over the rounds, or None where fewer than three anchors are left.

    ``clock_sigma_ms``: how well the claims' times are known on the pad's clock.
    """
    claimed = path.along(rounds.t_ms)
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
        residuals = _residuals(commissioning.anchors[index], column, claimed)
        kept = _without_bursts(residuals, float(commissioning.range_sigma_mm))
        bursts += len(residuals) - len(kept)
        if len(kept) >= MIN_VALUES:
            series.append((index, kept))
    if len(series) < 3:
        return None
    correlation = correlation_of([values for _, values in series], commissioning.correlation_ppm)
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma2 = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)
    anchors = []
    for index, values in series:
        anchor = commissioning.anchors[index]
        residual = _mean(values)
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        anchors.append(
            anchor_mean(index, anchor, expected, residual, count=len(values), white=sigma2 / (len(values) * worth))
        )
    first, last = present[0], present[-1]
    span = last.t_ms - first.t_ms
    return Reduced(
        anchors=tuple(anchors),
        east=east,
        north=north,
        up=up,
        t_ms=rounds.t_ms[len(rounds.t_ms) // 2],
        rounds=count,
        effective=count * worth,
        bursts=bursts,
        height_sigma_mm=max(path.height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM),
        installation_sigma_mm=float(commissioning.installation_sigma_mm),
        velocity_east=(last.east - first.east) / span if span > 0 else 0.0,
        velocity_north=(last.north - first.north) / span if span > 0 else 0.0,
        clock_sigma_ms=clock_sigma_ms,
    )


def anchor_mean(
    index: int, anchor: Anchor, expected: float, residual: float, *, count: int, white: float
) -> AnchorMean:
    """One anchor's virtual range (mm), with what is known of its errors at that distance."""
    _, bias_sigma = bias_at(anchor, expected + residual)
    return AnchorMean(
        index=index,
        east=float(anchor.east_mm),
        north=float(anchor.north_mm),
        up=float(anchor.up_mm),
        range_mm=expected + residual,
        residual_mm=residual,
        count=count,
        white=white,
        floor=bias_sigma * bias_sigma + float(anchor.survey_sigma_mm * anchor.survey_sigma_mm),
    )


def distance(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return sqrt(x * x + y * y + z * z)


def _residuals(anchor: Anchor, column: Sequence[int], claimed: Sequence[LocalClaim | None]) -> list[float]:
    """Measured, corrected, minus claimed: for each round that has both."""
    residuals = []
    anchor_east, anchor_north, anchor_up = float(anchor.east_mm), float(anchor.north_mm), float(anchor.up_mm)
    biases: dict[int, float] = {}  # ranges are whole centimetres and repeat
    for value, point in zip(column, claimed, strict=True):
        if value == NO_RANGE or point is None:
            continue
        bias = biases.get(value)
        if bias is None:
            bias = biases[value] = bias_at(anchor, float(value))[0]
        x, y, z = point.east - anchor_east, point.north - anchor_north, point.up - anchor_up
        residuals.append(value - bias - sqrt(x * x + y * y + z * z))
    return residuals


def _without_bursts(values: Sequence[float], sigma: float) -> list[float]:
    if not values:
        return []
    ordered = sorted(values)
    median = ordered[len(ordered) // 2]
    limit = max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)
    return [value for value in values if -limit <= value - median <= limit]


def correlation_of(series: Sequence[Sequence[float]], commissioned_ppm: int | None) -> float:
    """Lag-1 correlation of the residuals over time, all anchors together; 0 to MOST_CORRELATED.

    The sample's (von Neumann's ratio: right on average where there is none, too small by about 4ρ/N where there is
    some) is known to 1/√(values). Where the pad was commissioned with a correlation, that one counts unless the sample
    shows significantly more; otherwise the sample's, one standard deviation up.
    """
    steps = spread = 0.0
    count = longest = 0
    for values in series:
        mean = _mean(values)
        for value in values:
            spread += (value - mean) * (value - mean)
        for before, after in pairwise(values):
            steps += (after - before) * (after - before)
        count += len(values)
        longest = max(longest, len(values))
    if spread <= 0.0:
        return 0.0 if commissioned_ppm is None else commissioned_ppm / 1_000_000.0
    found = 1.0 - 0.5 * steps / spread
    deviation = 1.0 / sqrt(float(count))
    found += 4.0 * max(found, 0.0) / longest
    if commissioned_ppm is not None:
        known = commissioned_ppm / 1_000_000.0
        found = known if found <= known + 3.0 * deviation else found + deviation
    else:
        found += deviation
    return min(max(found, 0.0), MOST_CORRELATED)


def _mean(values: Sequence[float]) -> float:
    total = 0.0
    for value in values:
        total += value
    return total / len(values)
