"""Step 6 of the verdict: the time stamps of the drone's frames, judged against its claim and against the ranges.

A drone that lies about its own time stamps makes two-way ranges fit any claim, exactly. It cannot lie to four anchors
that time-stamp the *same* frame on the pad's clock: one antenna gives no anchor a delay of its own. So assurance 3 is
given only where these differences **alone** prove the drone within the buffer of its claim, by the same sequential
proof as the ranges (``stopping``), and where one place explains both. What the differences cannot exclude at a place
(far from a small pad: another distance on the same bearing) is then not proved, and the verdict says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.claims import ClaimedPath, LocalClaim
from wonderland.proofs.estimate import Offset
from wonderland.proofs.hyperbolic import CLEARLY_WORSE, Heard, Place, TimeFix, pull_of
from wonderland.proofs.likelihood import Matrix2, inside_disc
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import NO_TICK, TICKS_PER_SECOND, TimeStamps
from wonderland.proofs.reduction import HEIGHT_SIGMA_FLOOR_MM, correlation_of, distance
from wonderland.proofs.special import CHI2_LIMITS
from wonderland.proofs.stopping import INSIDE, more_rounds, proved, proved_outside, rounds_needed, sides, step_of

MIN_ANCHORS: Final = 4
"""Three anchors give two differences, which fit some place whatever they are: nothing would be checked."""
MIN_FRAMES: Final = 10
"""Fewer frames that all anchors heard say nothing."""
MIN_SHARE: Final = 0.5
"""An anchor that heard fewer of the frames is left out, not the frames."""
MM_PER_TICK: Final = 299_792_458_000.0 / TICKS_PER_SECOND
CLOCK_SIGMAS: Final = 3.0
"""How far a claim may be off along its path because its time is, before a refutation."""
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


def stamped(stamps: TimeStamps, commissioning: Commissioning, path: ClaimedPath) -> Stamped | None:
    """The means over the usable frames, or None where there are too few frames or anchors with a common clock."""
    sigma = commissioning.timestamp_sigma_mm
    if sigma is None:
        return None
    columns = _columns(stamps, commissioning)
    times: list[int] = []
    t_ms = stamps.start_ms
    for gap_ms in stamps.gap_ms:
        t_ms += gap_ms
        times.append(t_ms)
    claimed = [path.at(moment) for moment in times]
    chosen = [
        position
        for position, point in enumerate(claimed)
        if point is not None and all(column[position] != NO_TICK for _, column in columns)
    ]
    if len(columns) < MIN_ANCHORS or len(chosen) < MIN_FRAMES:
        return None
    points = [point for point in (claimed[position] for position in chosen) if point is not None]
    series = _residuals(columns, chosen, points, commissioning)
    keep = _without_bursts(series, float(sigma))
    bursts = len(chosen) - len(keep)
    if len(keep) < MIN_FRAMES:
        return None
    points = [points[position] for position in keep]
    series = [[values[position] for position in keep] for values in series]
    return _mean_of(columns, series, points, commissioning, path.height_sigma_mm, bursts)


def judge_times(
    stamped: Stamped, policy: Policy, ranged: tuple[float, float, Matrix2] | None, clock_sigma_ms: float
) -> Timed:
    """What the differences prove of the claim; ``ranged`` is the ranges' estimate (east, north, covariance), mm."""
    fix, radius = stamped.fix, float(policy.buffer_mm)
    limit = CHI2_LIMITS[min(len(fix.heard) - 3, len(CHI2_LIMITS)) - 1]
    best = fix.best(stamped.east, stamped.north, limit)
    east, north = best.east - stamped.east, best.north - stamped.north
    found = fix.covariance(best.east, best.north)
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
    )


def frames_needed(
    commissioning: Commissioning,
    policy: Policy,
    east: float,
    north: float,
    up: float,
    *,
    height_sigma_mm: float = HEIGHT_SIGMA_FLOOR_MM,
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
    fix = TimeFix(heard, up, max(height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM))
    found = fix.covariance(east, north)
    if found is None:
        return -1
    axes = found[0].ellipse()
    floor = found[1].along(axes.east, axes.north)
    white = max(found[0].along(axes.east, axes.north) - floor, 0.0)
    return rounds_needed(0.0, white, floor, policy)


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
    columns: Sequence[tuple[int, Sequence[int]]],
    chosen: Sequence[int],
    points: Sequence[LocalClaim],
    commissioning: Commissioning,
) -> list[list[float]]:
    """For each anchor and frame: stamp minus claimed distance (mm), about the mean of the frame's anchors."""
    series: list[list[float]] = [[] for _ in columns]
    anchors = [commissioning.anchors[index] for index, _ in columns]
    places = [(float(a.east_mm), float(a.north_mm), float(a.up_mm), float(a.clock_offset_mm or 0)) for a in anchors]
    count = len(columns)
    for position, point in zip(chosen, points, strict=True):
        values = []
        total = 0.0
        for (_, ticks), (east, north, up, late) in zip(columns, places, strict=True):
            x, y, z = point.east - east, point.north - north, point.up - up
            value = ticks[position] * MM_PER_TICK - late - sqrt(x * x + y * y + z * z)
            values.append(value)
            total += value
        mean = total / count
        for column, value in zip(series, values, strict=True):
            column.append(value - mean)
    return series


def _without_bursts(series: Sequence[Sequence[float]], sigma: float) -> list[int]:
    """Frames none of whose stamps is far from its anchor's median."""
    limit = max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM)
    medians = []
    for values in series:
        ordered = sorted(values)
        medians.append(ordered[len(ordered) // 2])
    return [
        position
        for position in range(len(series[0]))
        if all(-limit <= values[position] - median <= limit for values, median in zip(series, medians, strict=True))
    ]


def _mean_of(
    columns: Sequence[tuple[int, Sequence[int]]],
    series: Sequence[Sequence[float]],
    points: Sequence[LocalClaim],
    commissioning: Commissioning,
    height_sigma_mm: float,
    bursts: int,
) -> Stamped:
    count = len(points)
    east = north = up = 0.0
    for point in points:
        east += point.east
        north += point.north
        up += point.up
    east, north, up = east / count, north / count, up / count
    correlation = correlation_of(series, None)
    worth = (1.0 - correlation) / (1.0 + correlation)
    sigma = float(commissioning.timestamp_sigma_mm or 0)
    heard = []
    for (index, _), values in zip(columns, series, strict=True):
        anchor = commissioning.anchors[index]
        total = 0.0
        for value in values:
            total += value
        expected = distance(east - anchor.east_mm, north - anchor.north_mm, up - anchor.up_mm)
        heard.append(_heard(index, commissioning, expected + total / count, sigma * sigma / (count * worth)))
    first, last = points[0], points[-1]
    span = last.t_ms - first.t_ms
    return Stamped(
        fix=TimeFix(heard, up, max(height_sigma_mm, HEIGHT_SIGMA_FLOOR_MM)),
        east=east,
        north=north,
        frames=count,
        effective=count * worth,
        bursts=bursts,
        velocity_east=(last.east - first.east) / span if span > 0 else 0.0,
        velocity_north=(last.north - first.north) / span if span > 0 else 0.0,
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


def _one_place(fix: TimeFix, best: Place, ranged: tuple[float, float, Matrix2]) -> bool:
    """Whether one place explains both: the least χ² of both together is hardly worse than each alone."""
    east, north, covariance = ranged
    together = fix.descend(east, north, pull_of(east, north, covariance))
    return together.chi2 - best.chi2 <= CHI2_LIMITS[1]


def halved(policy: Policy) -> Policy:
    """The policy with half the error for refuting: where two proofs may each refute, they share it."""
    return replace(policy, refute_ppm=policy.refute_ppm // 2)
