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

from wonderland.proofs.claims import ClaimedPath, Track
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.travel import bias_left

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


@dataclass(slots=True)
class AnchorMean:
    """One anchor's ranges, taken together. Never changed: freezing would cost more than the means."""

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
class Residuals:
    """What the ranges say against the claimed path, round by round."""

    track: Track
    raw: list[tuple[int, list[float]]]
    """For each anchor: its position in the commissioning and its residuals (mm), in order of time."""
    whole: bool
    """Whether each anchor has one for each round."""
    series: list[tuple[int, list[float], float]]
    """Without bursts, of the anchors that have enough; with their mean."""
    bursts: int


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
    residuals: Residuals | None = None
    """What the means were taken of."""
    bias_left: float = 1.0
    """Share of the biases' variance that the drone's way leaves, of the anchor where most is left (``travel``)."""


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
    seen = residuals_of(rounds, commissioning, path)
    if seen is None or len(seen.series) < 3:
        return None
    track = seen.track
    count = len(track.kept)
    east, north, up = mean(track.east), mean(track.north), mean(track.up)
    series = [values for _, values, _ in seen.series]
    means = [middle for _, _, middle in seen.series]
    correlation = correlation_of(series, means, commissioning.correlation_ppm)
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma2 = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)
    left = _bias_left(rounds, seen, commissioning)
    anchors = []
    for index, values, residual in seen.series:
        anchor = commissioning.anchors[index]
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        anchors.append(
            anchor_mean(
                index,
                anchor,
                expected,
                residual,
                count=len(values),
                white=sigma2 / (len(values) * worth),
                left=left.get(index, 1.0),
            )
        )
    velocity_east, velocity_north = track.velocity()
    return Reduced(
        anchors=tuple(anchors),
        east=east,
        north=north,
        up=up,
        t_ms=rounds.t_ms[len(rounds.t_ms) // 2],
        rounds=count,
        effective=count * worth,
        bursts=seen.bursts,
        height_sigma_mm=max(path.height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM),
        installation_sigma_mm=float(commissioning.installation_sigma_mm),
        velocity_east=velocity_east,
        velocity_north=velocity_north,
        clock_sigma_ms=clock_sigma_ms,
        residuals=seen,
        bias_left=max(left.values(), default=1.0),
    )


def anchor_mean(
    index: int, anchor: Anchor, expected: float, residual: float, *, count: int, white: float, left: float = 1.0
) -> AnchorMean:
    """One anchor's virtual range (mm), with what is known of its errors at that distance.

    ``left``: share of the bias's variance that the way which the drone went leaves (``travel``).
    """
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
        floor=bias_sigma * bias_sigma * left + float(anchor.survey_sigma_mm * anchor.survey_sigma_mm),
    )


def distance(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return sqrt(x * x + y * y + z * z)


def residuals_of(rounds: UsableRounds, commissioning: Commissioning, path: ClaimedPath) -> Residuals | None:
    """What each anchor's ranges say against the claimed path; None where no round has a claim."""
    track = path.along(rounds.t_ms)
    if not track.kept:
        return None
    all_claimed = len(track.kept) == len(rounds.t_ms)
    whole = all_claimed
    raw = []
    for index, column in zip(rounds.anchor_indices, rounds.range_mm, strict=True):
        values = column if all_claimed else [column[position] for position in track.kept]
        residuals = _residuals(commissioning.anchors[index], values, track)
        whole = whole and len(residuals) == len(column)
        raw.append((index, residuals))
    return _sifted(track, raw, commissioning, whole=whole)


def newest_of(seen: Residuals, count: int, commissioning: Commissioning) -> Residuals:
    """The same of the newest rounds alone, where ``seen`` is whole."""
    return _sifted(seen.track, [(index, values[-count:]) for index, values in seen.raw], commissioning, whole=True)


def _sifted(
    track: Track, raw: list[tuple[int, list[float]]], commissioning: Commissioning, *, whole: bool
) -> Residuals:
    series = []
    bursts = 0
    for index, values in raw:
        kept = without_bursts(values, float(commissioning.range_sigma_mm))
        bursts += len(values) - len(kept)
        if len(kept) >= MIN_VALUES:
            series.append((index, kept, mean(kept)))
    return Residuals(track, raw, whole, series, bursts)


def _residuals(anchor: Anchor, values: Sequence[int], track: Track) -> list[float]:
    """Measured, corrected, minus claimed: for each round that has both."""
    at_east, at_north, at_up = float(anchor.east_mm), float(anchor.north_mm), float(anchor.up_mm)
    _, _, easts, norths, ups = track
    if NO_RANGE in values:
        heard = [position for position, value in enumerate(values) if value != NO_RANGE]
        values = [values[position] for position in heard]
        _, _, easts, norths, ups = track.only(heard)
    corrected = {value: value - bias_at(anchor, float(value))[0] for value in set(values)}  # whole centimetres repeat
    return [
        corrected[value] - sqrt((x := east - at_east) * x + (y := north - at_north) * y + (z := up - at_up) * z)
        for value, east, north, up in zip(values, easts, norths, ups, strict=True)
    ]


def without_bursts(values: list[float], sigma: float) -> list[float]:
    """The values that are no bursts: not far from their median."""
    if not values:
        return []
    limit = max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)
    if max(values) - min(values) <= limit:
        return values
    median = sorted(values)[len(values) // 2]
    return [value for value in values if -limit <= value - median <= limit]


def _bias_left(rounds: UsableRounds, seen: Residuals, commissioning: Commissioning) -> dict[int, float]:
    """By anchor, where not 1: the share of its bias's variance that the drone's way leaves in its mean.

    From the raw ranges that are in the means, and no others.
    """
    if commissioning.bias_length_mm is None:
        return {}
    means = {index: values for index, values, _ in seen.series}
    columns: list[Sequence[int]] = []
    for (index, residuals), column in zip(seen.raw, rounds.range_mm, strict=True):
        ranges = column if len(seen.track.kept) == len(column) else [column[position] for position in seen.track.kept]
        if len(means.get(index, ())) < len(residuals):
            kept = set(means.get(index, ()))
            each = iter(residuals)
            ranges = [value if value != NO_RANGE and next(each) in kept else NO_RANGE for value in ranges]
        columns.append(ranges)
    return dict(zip(rounds.anchor_indices, bias_left(columns, commissioning), strict=True))


def correlation_of(series: Sequence[Sequence[float]], means: Sequence[float], commissioned_ppm: int | None) -> float:
    """Lag-1 correlation of the residuals over time, about their means, all anchors together; 0 to MOST_CORRELATED.

    The sample's (von Neumann's ratio: right on average where there is none, too small by about 4ρ/N where there is
    some) is known to 1/√(values). Where the pad was commissioned with a correlation, that one counts unless the sample
    shows significantly more; otherwise the sample's, one standard deviation up.
    """
    steps = spread = 0.0
    count = longest = 0
    for values, middle in zip(series, means, strict=True):
        before = values[0] if values else 0.0
        for value in values:
            away = value - middle
            step = value - before
            spread += away * away
            steps += step * step
            before = value
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


def mean(values: Sequence[float]) -> float:
    """Added up one by one: ``sum()`` of floats is another one since Python 3.12."""
    total = 0.0
    for value in values:
        total += value
    return total / len(values)
