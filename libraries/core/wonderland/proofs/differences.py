"""Step 7 of the verdict: the time stamps of the drone's frames, judged against its claim and against the ranges.

A drone that lies about its own time stamps makes two-way ranges fit any claim, exactly. It cannot lie to four anchors
that time-stamp the *same* frame on the pad's clock: one antenna gives no anchor a delay of its own. So assurance 3 is
given only where these differences **alone** prove the drone within the buffer of its claim, whatever its height
(``heights``), by the same sequential proof as the ranges (``stopping``), and where one place explains both. What the
differences cannot exclude at a place (far from a small pad: another distance on the same bearing) is then not proved,
and the verdict says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from math import sqrt
from operator import add, sub
from typing import Final

from wonderland.proofs.claims import ClaimedPath, Track
from wonderland.proofs.estimate import Offset
from wonderland.proofs.heights import UNKNOWN_HEIGHT_MM, Heights
from wonderland.proofs.hyperbolic import CLEARLY_WORSE, Heard, Place, TimeFix, pull_of
from wonderland.proofs.likelihood import Matrix2, inside_disc
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import NO_TICK, TICKS_PER_SECOND, TimeStamps
from wonderland.proofs.reduction import HEIGHT_SIGMA_FLOOR_MM, correlation_of, distance, mean
from wonderland.proofs.special import CHI2_LIMITS
from wonderland.proofs.stopping import (
    INSIDE,
    MAX_MORE_ROUNDS,
    more_rounds,
    proved,
    proved_outside,
    rounds_needed,
    sides,
    step_of,
)

MIN_ANCHORS: Final = 4
"""Three anchors give two differences, which fit some place whatever they are: nothing would be checked."""
MIN_FRAMES: Final = 10
"""Fewer frames that all anchors heard say nothing."""
MIN_SHARE: Final = 0.5
"""An anchor that heard fewer of the frames is left out, not the frames."""
MM_PER_TICK: Final = 299_792_458_000.0 / TICKS_PER_SECOND
CLOCK_SIGMAS: Final = 3.0
"""How far a claim may be off along its path because its time is, before a refutation."""
_WELL_WITHIN: Final = 0.999
"""Share of a limit below which rounding can not carry a χ² over it."""
OUTLIER_SIGMAS: Final = 6.0
OUTLIER_FLOOR_MM: Final = 150.0
"""As for ranges: a frame one of whose stamps is this far from its anchor's median is a burst."""


@dataclass(frozen=True, slots=True)
class Stamped:
    """The usable frames, taken together, about the mean claimed position."""

    fix: TimeFix
    east: float
    north: float
    frames: int
    effective: float
    bursts: int
    velocity_east: float
    velocity_north: float


@dataclass(frozen=True, slots=True)
class Timed:
    """What the time stamps say of one claim."""

    frames: int
    finding: str
    """inside, outside, vague or inconsistent (``records.verdicts.TIMED``)."""
    agrees: bool
    more_frames: int
    error: float
    likelihood: float
    covariance: Matrix2 | None
    chi2: float
    limit: float
    significance: float
    """How clearly (σ) every place within the buffer is excluded; 0 where none is."""
    suspects: tuple[int, ...] = ()
    """Where the stamps contradict one another: the anchors (positions in the commissioning) without one of which they
    would not, as far as anybody can tell."""


def stamped(stamps: TimeStamps, commissioning: Commissioning, path: ClaimedPath) -> Stamped | None:
    """The means over the usable frames, or None where there are too few frames or anchors with a common clock."""
    sigma = commissioning.timestamp_sigma_mm
    if sigma is None:
        return None
    columns = _columns(stamps, commissioning)
    times = list(accumulate(stamps.gap_ms, initial=stamps.start_ms))[1:]
    track = path.along(times)
    deaf = {
        position
        for _, column in columns
        if NO_TICK in column
        for position, ticks in enumerate(column)
        if ticks == NO_TICK
    }
    if deaf:
        track = track.only([at for at, position in enumerate(track.kept) if position not in deaf])
    if len(columns) < MIN_ANCHORS or len(track.kept) < MIN_FRAMES:
        return None
    series = _residuals(columns, track, commissioning)
    keep = _without_bursts(series, float(sigma))
    bursts = len(track.kept) - len(keep)
    if len(keep) < MIN_FRAMES:
        return None
    if bursts:
        track = track.only(keep)
        series = [[values[position] for position in keep] for values in series]
    return _mean_of(columns, series, track, commissioning, path.height_sigma_mm, bursts)


def judge_times(
    stamped: Stamped, policy: Policy, ranged: tuple[float, float, Matrix2] | None, clock_sigma_ms: float
) -> Timed:
    """What the differences prove of the claim; ``ranged`` is the ranges' estimate (east, north, covariance), mm."""
    fix, radius = stamped.fix, float(policy.buffer_mm)
    limit = CHI2_LIMITS[min(len(fix.heard) - 3, len(CHI2_LIMITS)) - 1]
    best = fix.best(stamped.east, stamped.north, limit)
    east, north = best.east - stamped.east, best.north - stamped.north
    # To exclude the claim its own height is believed; to prove it, no height is.
    free = fix.with_height_sigma(UNKNOWN_HEIGHT_MM)
    found = free.covariance(best.east, best.north)
    consistent = best.chi2 <= limit
    more = -1
    inside = outside = False
    likelihood = significance = 0.0
    covariance = None
    s1 = 0.0
    if found is not None:
        x, y = stamped.velocity_east * clock_sigma_ms, stamped.velocity_north * clock_sigma_ms
        total = found[0] + Matrix2(x * x, x * y, y * y)
        covariance = total
        s1 = total.ellipse().s1
        likelihood = inside_disc(east, north, total, radius)
        step = step_of(total, found[0] + found[1].scaled(-1.0), stamped.frames)
        inside = (
            sides(east, north, total, policy, step).inside
            and int(likelihood * 1e6) >= policy.verify_ppm
            and _profile_inside(stamped, best, policy, s1, step)
            and _inside_at_any_height(stamped, policy)
        )
        floor = found[1] + Matrix2(x * x, x * y, y * y)
        offset = Offset(east, north, total, floor, best.chi2, 0.0, len(fix.heard) - 3)
        more = -1 if inside else more_rounds(offset, stamped.frames, policy)
    if not inside and distance(east, north, 0.0) > radius:
        # Not by the ellipse: far away it is a bent valley. What the claims' times are known to widens the buffer.
        drift = distance(stamped.velocity_east, stamped.velocity_north, 0.0) * clock_sigma_ms
        worse = fix.least_within(stamped.east, stamped.north, radius + CLOCK_SIGMAS * drift) - best.chi2
        significance = sqrt(worse) if worse > 0.0 else 0.0
        outside = proved_outside(significance, s1 if s1 > 0.0 else 1e9, policy)
    if not consistent:
        finding = "inconsistent"
    elif inside:
        finding = "inside"
    elif outside:
        finding = "outside"
    else:
        finding = "vague"
    agrees = consistent and (ranged is None or _one_place(fix, best, ranged))
    return Timed(
        stamped.frames,
        finding,
        agrees,
        more,
        distance(east, north, 0.0),
        likelihood,
        covariance,
        best.chi2,
        limit,
        significance,
        () if consistent else _suspects(stamped, ranged),
    )


def frames_needed(
    commissioning: Commissioning,
    policy: Policy,
    east: float,
    north: float,
    up: float,
) -> int:
    """Frames with which the differences alone prove an honest drone at a place (mm) within the buffer.

    −1 where no number does, 0 where the pad has no common clock: what level 3 can be had at a place, before ranging.
    """
    sigma = commissioning.timestamp_sigma_mm
    anchors = [(i, a) for i, a in enumerate(commissioning.anchors) if a.clock_sigma_mm is not None]
    if sigma is None or len(anchors) < MIN_ANCHORS:
        return 0
    heard = []
    for index, anchor in anchors:
        away = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        heard.append(_heard(index, commissioning, away, float(sigma * sigma)))
    found = TimeFix(heard, up, UNKNOWN_HEIGHT_MM).covariance(east, north)
    if found is None:
        return -1
    axes = found[0].ellipse()
    floor = found[1].along(axes.east, axes.north)
    white = max(found[0].along(axes.east, axes.north) - floor, 0.0)
    frames = rounds_needed(0.0, white, floor, policy)
    # The ellipse knows nothing of bent valleys and of second places that fit: the proof itself is asked.
    if frames < 0 or not _proved_after(MAX_MORE_ROUNDS, heard, (east, north, up), policy):
        return -1
    while not _proved_after(frames, heard, (east, north, up), policy):
        frames *= 2
        if frames > MAX_MORE_ROUNDS:
            return MAX_MORE_ROUNDS
    return frames


def _columns(stamps: TimeStamps, commissioning: Commissioning) -> list[tuple[int, Sequence[int]]]:
    """(position in the commissioning, ticks) of the anchors that share the clock and heard enough."""
    known = {
        anchor.anchor_id: index
        for index, anchor in enumerate(commissioning.anchors)
        if anchor.clock_sigma_mm is not None
    }
    columns: list[tuple[int, Sequence[int]]] = []
    for anchor in stamps.anchors:
        index = known.get(anchor.anchor_id)
        if index is None:
            continue
        missing = anchor.ticks.count(NO_TICK)
        if len(anchor.ticks) - missing > MIN_SHARE * len(anchor.ticks):
            columns.append((index, anchor.ticks))
    columns.sort(key=lambda column: column[0])
    return columns


def _residuals(
    columns: Sequence[tuple[int, Sequence[int]]], track: Track, commissioning: Commissioning
) -> list[list[float]]:
    """For each anchor and frame: stamp minus claimed distance (mm), about the mean of the frame's anchors."""
    kept, _, easts, norths, ups = track
    series: list[list[float]] = []
    for index, ticks in columns:
        anchor = commissioning.anchors[index]
        at_east, at_north, at_up = float(anchor.east_mm), float(anchor.north_mm), float(anchor.up_mm)
        late = float(anchor.clock_offset_mm or 0)
        stamps = ticks if len(kept) == len(ticks) else [ticks[position] for position in kept]
        series.append(
            [
                stamp * MM_PER_TICK
                - late
                - sqrt((x := east - at_east) * x + (y := north - at_north) * y + (z := up - at_up) * z)
                for stamp, east, north, up in zip(stamps, easts, norths, ups, strict=True)
            ]
        )
    count = float(len(columns))
    totals: Iterable[float] = series[0]
    for values in series[1:]:
        totals = map(add, totals, values)
    means = [total / count for total in totals]
    return [list(map(sub, values, means)) for values in series]


def _without_bursts(series: Sequence[Sequence[float]], sigma: float) -> Sequence[int]:
    """Frames none of whose stamps is far from its anchor's median."""
    limit = max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)
    count = len(series[0])
    bursts: set[int] = set()
    for values in series:
        if max(values) - min(values) > limit:
            median = sorted(values)[count // 2]
            bursts.update(position for position, value in enumerate(values) if not -limit <= value - median <= limit)
    return [position for position in range(count) if position not in bursts] if bursts else range(count)


def _mean_of(
    columns: Sequence[tuple[int, Sequence[int]]],
    series: Sequence[Sequence[float]],
    track: Track,
    commissioning: Commissioning,
    height_sigma_mm: float,
    bursts: int,
) -> Stamped:
    count = len(track.kept)
    east, north, up = mean(track.east), mean(track.north), mean(track.up)
    means = [mean(values) for values in series]
    correlation = correlation_of(series, means, None, 0.0)
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma = float(commissioning.timestamp_sigma_mm or 0)
    heard = []
    for (index, _), residual in zip(columns, means, strict=True):
        anchor = commissioning.anchors[index]
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        heard.append(_heard(index, commissioning, expected + residual, sigma * sigma / (count * worth)))
    velocity_east, velocity_north = track.velocity()
    return Stamped(
        fix=TimeFix(heard, up, max(height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM)),
        east=east,
        north=north,
        frames=count,
        effective=count * worth,
        bursts=bursts,
        velocity_east=velocity_east,
        velocity_north=velocity_north,
    )


def _heard(index: int, commissioning: Commissioning, length: float, white: float) -> Heard:
    anchor = commissioning.anchors[index]
    clock, survey = float(anchor.clock_sigma_mm or 0), float(anchor.survey_sigma_mm)
    return Heard(
        index=index,
        east=float(anchor.east_mm),
        north=float(anchor.north_mm),
        up=float(anchor.up_mm),
        length=length,
        white=white,
        floor=clock * clock + survey * survey,
    )


def _profile_inside(stamped: Stamped, best: Place, policy: Policy, s1: float, step: float) -> bool:
    """Whether the differences themselves exclude the buffer's edge, and no second place beyond it fits.

    The ellipse at the estimate says too little where the places that fit make a long, bent valley along a bearing.
    """
    fix, radius = stamped.fix, float(policy.buffer_mm)
    worse = fix.least_on_circle(stamped.east, stamped.north, radius) - best.chi2
    depth = sqrt(worse) if worse > 0.0 else 0.0
    if not proved(INSIDE, (1_000_000 - policy.verify_ppm) / 1_000_000.0, radius, s1, depth, step):
        return False
    other = fix.mirrored(best)
    apart = distance(other.east - stamped.east, other.north - stamped.north, 0.0)
    return apart <= radius or other.chi2 - best.chi2 > CLEARLY_WORSE


def _inside_at_any_height(stamped: Stamped, policy: Policy) -> bool:
    """Whether the differences exclude every place beyond the buffer whatever height the drone has."""
    return _proved_at_any_height(stamped.fix.heard, stamped.east, stamped.north, stamped.fix.up, policy)


def _proved_after(frames: int, heard: Sequence[Heard], place: tuple[float, float, float], policy: Policy) -> bool:
    """Whether so many frames of an honest drone at a place (east, north, up) prove it, as they are on average."""
    after = tuple(replace(one, white=one.white / frames) for one in heard)
    return _proved_at_any_height(after, *place, policy)


def _proved_at_any_height(heard: tuple[Heard, ...], east: float, north: float, up: float, policy: Policy) -> bool:
    radius = float(policy.buffer_mm)
    found = Heights(heard, east, north, radius).margin(up)
    if found.sigmas <= 0.0:
        return False
    known = max(found.away_mm, 1.0) / found.sigmas
    return proved(INSIDE, (1_000_000 - policy.verify_ppm) / 1_000_000.0, radius, known, found.sigmas, 0.0)


def _one_place(fix: TimeFix, best: Place, ranged: tuple[float, float, Matrix2]) -> bool:
    """Whether one place explains both: the least χ² of both together is hardly worse than each alone."""
    east, north, covariance = ranged
    enough = best.chi2 + _WELL_WITHIN * CHI2_LIMITS[1]
    together = fix.descend(east, north, pull_of(east, north, covariance), enough)
    return together.chi2 - best.chi2 <= CHI2_LIMITS[1]


def _suspects(stamped: Stamped, ranged: tuple[float, float, Matrix2] | None) -> tuple[int, ...]:
    """Anchors whose clock may be off: without one of them the others agree, and with the ranges where there are any.

    Three anchors that are left agree with some place always: without ranges four cannot name the bad one.
    """
    fix = stamped.fix
    freedom = len(fix.heard) - (4 if ranged is None else 2)
    if freedom < 1:
        return ()
    limit = CHI2_LIMITS[min(freedom, len(CHI2_LIMITS)) - 1]
    pull = None if ranged is None else pull_of(*ranged)
    east, north = (stamped.east, stamped.north) if ranged is None else ranged[:2]
    return tuple(
        one.index
        for position, one in enumerate(fix.heard)
        if fix.without(position).descend(east, north, pull).chi2 <= limit
    )


def halved(policy: Policy) -> Policy:
    """The policy with half the error for refuting: where two proofs may each refute, they share it."""
    return replace(policy, refute_ppm=policy.refute_ppm // 2)
