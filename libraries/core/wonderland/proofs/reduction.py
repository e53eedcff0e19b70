"""From rounds to one virtual range for each anchor: part of step 5 of the verdict.

Each range is corrected by its anchor's bias and compared with the one that the claim of its moment would give, so that
a moving drone needs no special case; the mean of these residuals, put back onto the mean claimed position, is one
virtual range for each anchor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Final, NamedTuple

from wonderland.proofs.claims import ClaimedPath, LocalClaim, Track
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.rounds import UsableRounds
from wonderland.proofs.sustained import heard_in, vague_rounds
from wonderland.proofs.travel import bias_left

OUTLIER_SIGMAS: Final = 6.0
"""A residual this far from its anchor's median is a burst, not noise."""
OUTLIER_FLOOR_MM: Final = 150.0
"""Never call an error below this a burst: the white noise is not the only one."""
MIN_TORN: Final = 2
"""One anchor alone tears no round: that is its own burst."""
MIN_VALUES: Final = 3
"""Fewer usable ranges of an anchor tell nothing about it."""
MOST_CORRELATED: Final = 0.95
STUCK_SHARE: Final = 0.01
"""Residuals whose variance is below this share of the commissioned noise repeat one another."""
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


class Series(NamedTuple):
    """One anchor's residuals in order of time."""

    anchor: int
    """Its position in the commissioning."""
    rounds: Sequence[int]
    """Which of the track's moments each value belongs to."""
    values: list[float]
    """Measured, corrected, minus claimed, mm."""


@dataclass(frozen=True, slots=True)
class Residuals:
    """What the ranges say against the claimed path, round by round."""

    track: Track
    """The moments of the rounds that are left."""
    raw: list[Series]
    """Of all rounds that have a claim; each anchor's ``rounds`` count these, not those that are left."""
    whole: bool
    """Whether each anchor has one for each round."""
    series: list[tuple[Series, float]]
    """Without bursts, of the anchors that have enough; with their mean."""
    bursts: int
    """Values left out because few anchors saw them: a radio's errors."""
    torn: int
    """Rounds left out because half of the anchors or more saw them: there the claim jumped, not the radio."""
    claimed: Track
    """The moments of all rounds that have a claim and know their place."""
    span_ms: tuple[int, int]
    """First and last moment that was ranged, whether its round counts or not."""
    vague: int = 0
    """Rounds left out because the anchors that measured there leave a second place open (``sustained``)."""


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
    moment: LocalClaim | None = None
    """The claim of one moment of the session: a mean place is none where a drone was that flew a curve."""
    moment_spread: Matrix2 | None = None
    """How well that claim is known by itself, mm² (``standing``)."""
    bias_left: float = 1.0
    """Share of the biases' variance that the drone's way leaves, of the anchor where most is left (``travel``)."""


def said_at(reduced: Reduced) -> LocalClaim:
    """Where the drone claims to be at one moment in the middle of what was measured."""
    return reduced.moment or LocalClaim(reduced.t_ms, reduced.east, reduced.north, reduced.up)


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
    series = [column.values for column, _ in seen.series]
    means = [middle for _, middle in seen.series]
    correlation = correlation_of(series, means, commissioning.correlation_ppm, float(commissioning.range_sigma_mm))
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma2 = float(commissioning.range_sigma_mm * commissioning.range_sigma_mm)
    left = _bias_left(rounds, seen, commissioning)
    anchors = []
    for column, residual in seen.series:
        anchor = commissioning.anchors[column.anchor]
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        heard = len(column.values)
        anchors.append(
            anchor_mean(
                column.anchor,
                anchor,
                expected,
                residual,
                count=heard,
                white=sigma2 / (heard * worth),
                left=left.get(column.anchor, 1.0),
            )
        )
    velocity_east, velocity_north = track.velocity()
    return Reduced(
        anchors=tuple(anchors),
        east=east,
        north=north,
        up=up,
        t_ms=track.mean_ms(),
        rounds=count,
        effective=count * worth,
        bursts=seen.bursts,
        height_sigma_mm=max(path.height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM),
        installation_sigma_mm=float(commissioning.installation_sigma_mm),
        velocity_east=velocity_east,
        velocity_north=velocity_north,
        clock_sigma_ms=clock_sigma_ms,
        residuals=seen,
        moment=track.middle(),
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
        series = _residuals(index, commissioning.anchors[index], values, track)
        whole = whole and len(series.values) == len(column)
        raw.append(series)
    return _sifted(track, raw, commissioning, rounds.span_ms, whole=whole)


def newest_of(seen: Residuals, count: int, commissioning: Commissioning) -> Residuals:
    """The same of the newest rounds alone, where ``seen`` is whole."""
    rows = range(len(seen.claimed.kept))[-count:]
    raw = [Series(column.anchor, range(len(rows)), column.values[-count:]) for column in seen.raw]
    newest = seen.claimed.only(rows)
    return _sifted(newest, raw, commissioning, (newest.t_ms[0], newest.t_ms[-1]), whole=True)


def _sifted(
    track: Track, raw: list[Series], commissioning: Commissioning, span_ms: tuple[int, int], *, whole: bool
) -> Residuals:
    sigma = float(commissioning.range_sigma_mm)
    rounds = len(track.kept)
    while True:
        marked = [_bursts(column.values, sigma) for column in raw]
        torn = _torn(raw, marked) if any(marked) else set()
        vague = _vague(track, raw, marked, torn, commissioning) if any(marked) or not whole else frozenset()
        if not vague:
            break
        track, raw = _without(track, raw, vague)
        whole = False
    series = []
    bursts = 0
    for column, apart in zip(raw, marked, strict=True):
        kept = _left(column, apart, torn) if apart or torn else column
        bursts += sum(1 for position in apart if column.rounds[position] not in torn)
        if len(kept.values) >= MIN_VALUES:
            series.append((kept, mean(kept.values)))
    left = track.only([position for position in range(len(track.kept)) if position not in torn]) if torn else track
    return Residuals(left, raw, whole, series, bursts, len(torn), track, span_ms, rounds - len(track.kept))


def _vague(
    track: Track, raw: list[Series], marked: Sequence[Sequence[int]], torn: set[int], commissioning: Commissioning
) -> frozenset[int]:
    """Rounds that are not torn, and whose anchors leave a second place open."""
    fitting = [
        (column.anchor, column.rounds, frozenset(column.rounds[position] for position in apart))
        for column, apart in zip(raw, marked, strict=True)
    ]
    heard = heard_in(len(track.kept), fitting)
    return vague_rounds(track, heard, commissioning, _burst_mm(float(commissioning.range_sigma_mm))) - torn


def loses_its_place(seen: Residuals, anchor: int, commissioning: Commissioning) -> bool:
    """Whether without an anchor (position in the commissioning) some round no longer knows its place."""
    others = [(column.anchor, column.rounds, frozenset[int]()) for column, _ in seen.series if column.anchor != anchor]
    heard = heard_in(len(seen.claimed.kept), others)
    vague = vague_rounds(seen.claimed, heard, commissioning, _burst_mm(float(commissioning.range_sigma_mm)))
    left = frozenset(seen.track.kept)
    return any(seen.claimed.kept[position] in left for position in vague)


def _without(track: Track, raw: list[Series], out: frozenset[int]) -> tuple[Track, list[Series]]:
    """The track and the columns without some rounds."""
    rows = [position for position in range(len(track.kept)) if position not in out]
    new = {old: position for position, old in enumerate(rows)}
    columns = []
    for column in raw:
        left = [
            (new[moment], value) for moment, value in zip(column.rounds, column.values, strict=True) if moment in new
        ]
        columns.append(Series(column.anchor, [moment for moment, _ in left], [value for _, value in left]))
    return track.only(rows), columns


def _torn(raw: list[Series], marked: Sequence[Sequence[int]]) -> set[int]:
    """Rounds in which at least half of the anchors that measured burst, and more than one."""
    burst: dict[int, int] = {}
    for column, apart in zip(raw, marked, strict=True):
        for position in apart:
            moment = column.rounds[position]
            burst[moment] = burst.get(moment, 0) + 1
    heard = dict.fromkeys(burst, 0)
    for column in raw:
        for moment in column.rounds:
            if moment in heard:
                heard[moment] += 1
    return {moment for moment, count in burst.items() if count >= MIN_TORN and 2 * count >= heard[moment]}


def _left(column: Series, apart: Sequence[int], torn: set[int]) -> Series:
    """A column without its bursts and without torn rounds."""
    out = set(apart)
    rows = [position for position, moment in enumerate(column.rounds) if position not in out and moment not in torn]
    return Series(
        column.anchor, [column.rounds[position] for position in rows], [column.values[position] for position in rows]
    )


def _residuals(index: int, anchor: Anchor, values: Sequence[int], track: Track) -> Series:
    """Measured, corrected, minus claimed: for each round that has both."""
    at_east, at_north, at_up = float(anchor.east_mm), float(anchor.north_mm), float(anchor.up_mm)
    _, _, easts, norths, ups = track
    heard: Sequence[int] = range(len(values))
    if NO_RANGE in values:
        heard = [position for position, value in enumerate(values) if value != NO_RANGE]
        values = [values[position] for position in heard]
        _, _, easts, norths, ups = track.only(heard)
    corrected = {value: value - bias_at(anchor, float(value))[0] for value in set(values)}  # whole centimetres repeat
    return Series(
        index,
        heard,
        [
            corrected[value] - sqrt((x := east - at_east) * x + (y := north - at_north) * y + (z := up - at_up) * z)
            for value, east, north, up in zip(values, easts, norths, ups, strict=True)
        ],
    )


def _burst_mm(sigma: float) -> float:
    return max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)


def _bursts(values: list[float], sigma: float) -> Sequence[int]:
    """Positions of the values that are bursts: far from their median."""
    if not values:
        return ()
    limit = _burst_mm(sigma)
    if max(values) - min(values) <= limit:
        return ()
    median = sorted(values)[len(values) // 2]
    return [position for position, value in enumerate(values) if not -limit <= value - median <= limit]


def _bias_left(rounds: UsableRounds, seen: Residuals, commissioning: Commissioning) -> dict[int, float]:
    """By anchor, where not 1: the share of its bias's variance that the drone's way leaves in its mean.

    From the raw ranges that are in the means, and no others.
    """
    if commissioning.bias_length_mm is None:
        return {}
    ranges = dict(zip(rounds.anchor_indices, rounds.range_mm, strict=True))
    kept = seen.claimed.kept
    columns: list[Sequence[int]] = []
    for column, _ in seen.series:
        measured = ranges[column.anchor]
        if len(column.values) == len(measured):  # nothing was left out
            columns.append(measured)
            continue
        heard = [NO_RANGE] * len(kept)
        for position in column.rounds:
            heard[position] = measured[kept[position]]
        columns.append(heard)
    anchors = [column.anchor for column, _ in seen.series]
    return dict(zip(anchors, bias_left(columns, commissioning), strict=True))


def correlation_of(
    series: Sequence[Sequence[float]], means: Sequence[float], commissioned_ppm: int | None, sigma_mm: float
) -> float:
    """Lag-1 correlation of the residuals over time, about their means, all anchors together; 0 to MOST_CORRELATED.

    The sample's (von Neumann's ratio: right on average where there is none, too small by about 4ρ/N where there is
    some) is known to 1/√(values). Where the pad was commissioned with a correlation, that one counts unless the sample
    shows significantly more; otherwise the sample's, one standard deviation up. ``sigma_mm``: noise as
    commissioned; 0 where values that repeat one another count in full.
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
    if spread <= STUCK_SHARE * sigma_mm * sigma_mm * count:
        # No radio is so quiet: these are one round, told again and again.
        return MOST_CORRELATED if sigma_mm > 0.0 else 0.0
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
