"""Looks at thousands of tries at once, and says of which the decision's answer is beyond doubt.

The lab asks of each look: refuted, still open, or near enough to an edge that the decision itself has to say. A
permission is never given here: whatever could be verified is put before ``wonderland.proofs.verdict.decide``. The
arithmetic is that of the decision (reduction to one virtual range for each anchor, generalised least squares, leaving
one anchor out where they contradict one another, distance to the buffer) written for arrays, with a margin at each
threshold; the thresholds are read off the decision's own functions. Every run compares a sample with the decision.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import lru_cache, partial
from typing import Final

import numpy as np

from wonderland.proofs import stopping
from wonderland.proofs.agreement import REFUTING_ANCHORS
from wonderland.proofs.estimate import MIRROR_CHI2
from wonderland.proofs.leaving import NEWEST
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.one_claim import FEW_CLAIMS
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.reduction import (
    CLAIM_CLOCK_SIGMA_MS,
    HEIGHT_SIGMA_FLOOR_MM,
    MIN_TORN,
    MIN_VALUES,
    MOST_CORRELATED,
    OUTLIER_FLOOR_MM,
    OUTLIER_SIGMAS,
    STUCK_SHARE,
)
from wonderland.proofs.rounds import MIN_ANCHORS
from wonderland.proofs.special import CHI2_LIMITS, CHI2_MILLIONTH
from wonderland_research.attack_lab.batch import Batch, path_at_rounds
from wonderland_research.attack_lab.least_squares import Problem
from wonderland_research.attack_lab.places import ROUND_MS, Booleans, Floats, Integers

MARGIN: Final = 0.02
"""Share of a threshold within which the decision itself is asked."""
_PER_95_HEIGHT: Final = 0.5102
_CONVERGED_MM: Final = 1.0
_CONTRADICTS: Final = 4.0
_STUCK: Final = 20.0
"""A χ² this many times its limit is a contradiction that noise neither made nor can undo."""
_DIRECTIONS: Final = 24
_GRID: Final = 160
_LARGEST_STEP: Final = 1e9
"""1/mm: as if the last round had told everything; the decision holds its correction at a limit."""


class Look(IntEnum):
    """What a look at one try says."""

    OPEN = 0
    REFUTED = 1
    ASK = 2
    STUCK = 3
    """Open, and so far from settled that further rounds of the same kind change nothing."""


@dataclass(frozen=True)
class _Means:
    """One virtual range for each anchor of each try; anchors without one have ``present`` False."""

    residual: Floats
    white: Floats
    present: Booleans
    middle: Floats
    """(B, 3): mean claimed place of the usable rounds."""
    unsure: Booleans
    """(B,): tries on which arrays say too little."""
    nothing: Booleans
    """(B,): tries with too few usable rounds to decide anything."""

    def of(self, rows: Integers) -> _Means:
        """The same means for these rows (tries) alone."""
        return _Means(*(getattr(self, field.name)[rows] for field in fields(self)))


@dataclass(frozen=True)
class _Fits:
    """Estimates of B tries from one choice of anchors."""

    offset: Floats
    covariance: Floats
    chi2: Floats
    freedom: int
    unsure: Booleans
    problem: Problem


def screen_looks(batch: Batch, rows: Integers, rounds: int) -> Integers:
    """``Look`` for each of these tries after so many rounds."""
    claimed = path_at_rounds(batch.claims[rows])[:, :rounds]
    means = _reduce(batch, batch.range_mm[rows, :rounds], claimed)
    middle = means.middle
    velocity = (claimed[:, -1, :2] - claimed[:, 0, :2]) / float(batch.t_ms[rounds - 1] - batch.t_ms[0])
    answer = np.full(len(rows), Look.ASK, dtype=np.int64)
    whole = means.present.all(axis=1) & ~means.unsure
    everyone = tuple(range(len(batch.pad.anchors)))
    fits = _fit(batch, means, middle, velocity, everyone)
    limit = _limit(CHI2_LIMITS, fits.freedom)
    sure = whole & ~fits.unsure
    agree = sure & (fits.chi2 <= limit * (1.0 - MARGIN))
    answer[agree] = _sides(batch, fits, middle, len(everyone))[agree]
    contradict = np.nonzero(sure & (fits.chi2 > limit * (1.0 + MARGIN)))[0]
    if len(contradict):
        answer[contradict] = _without_one(batch, means.of(contradict), velocity[contradict])
    answer[means.nothing] = Look.STUCK if batch.steady else Look.OPEN
    if not batch.steady and rounds > NEWEST:
        answer[answer == Look.OPEN] = Look.ASK  # its newest rounds alone may tell more
    if rounds * ROUND_MS <= (FEW_CLAIMS + 1) * batch.claim_ms:
        answer[answer == Look.REFUTED] = Look.ASK  # not where it rests on one claim
    return answer


def _reduce(batch: Batch, range_mm: Integers, claimed: Floats) -> _Means:
    anchors = batch.pad.anchors
    sigma = float(batch.commissioning.range_sigma_mm)
    usable = range_mm > 0
    usable &= range_mm <= batch.commissioning.max_range_mm
    kept_rounds = usable.sum(axis=2) >= MIN_ANCHORS
    usable &= kept_rounds[:, :, None]
    expected = np.linalg.norm(claimed[:, :, None, :] - anchors, axis=-1)
    residual = np.where(usable, range_mm - expected, np.nan)
    count_rounds = kept_rounds.sum(axis=1)
    middle = (claimed * kept_rounds[:, :, None]).sum(axis=1) / np.maximum(count_rounds, 1)[:, None]
    middle[count_rounds == 0] = claimed[count_rounds == 0, 0]
    # Of a moving drone the velocity is that over the usable rounds; the arrays here take it over all of them.
    first, last = kept_rounds[:, 0], kept_rounds[:, -1]
    still = np.ptp(claimed, axis=1).max(axis=1) < 1.0
    kept = _without_bursts(residual, max(OUTLIER_SIGMAS * sigma, OUTLIER_FLOOR_MM))
    values = np.where(kept, residual, 0.0)
    count = kept.sum(axis=1)
    present = count >= MIN_VALUES
    safe = np.maximum(count, 1)
    mean = values.sum(axis=1) / safe
    centred = np.where(kept & present[:, None, :], residual - mean[:, None, :], 0.0)
    spread = (centred**2).sum(axis=(1, 2))
    steps = _steps(centred, kept & present[:, None, :])
    total = (count * present).sum(axis=1)
    longest = (count * present).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = 1.0 - 0.5 * steps / spread
        deviation = 1.0 / np.sqrt(total)
        found = found + 4.0 * np.maximum(found, 0.0) / longest
    commissioned = batch.commissioning.correlation_ppm
    if commissioned is None:
        correlation = found + deviation
    else:
        known = commissioned / 1e6
        correlation = np.where(found <= known + 3.0 * deviation, known, found + deviation)
    correlation = np.clip(correlation, 0.0, MOST_CORRELATED)
    worth = (1.0 - correlation) / (1.0 + correlation)
    white = sigma**2 / (safe * worth[:, None])
    # Rounds that half of the anchors tear are for the decision itself to judge.
    apart = (usable & ~kept).sum(axis=2)
    torn = ((apart >= MIN_TORN) & (2 * apart >= usable.sum(axis=2))).any(axis=1)
    # So are rounds in which an anchor is missing: they may not know their place.
    ever = np.asarray(kept.any(axis=1))
    gaps = (~kept & kept_rounds[:, :, None] & ever[:, None, :]).any(axis=(1, 2))
    stuck = spread <= 2.0 * STUCK_SHARE * sigma * sigma * total
    unsure = stuck | ~(still | (first & last)) | torn | gaps
    few = count_rounds < batch.policy.min_rounds
    nothing = few | (present.sum(axis=1) < MIN_ANCHORS)
    return _Means(mean, white, present, middle, unsure, nothing)


def _without_bursts(residual: Floats, limit: float) -> Booleans:
    """Values near their anchor's median; only columns that spread far are sorted."""
    there = np.isfinite(residual)
    with np.errstate(invalid="ignore"):
        spread = np.nanmax(np.where(there, residual, -np.inf), axis=1) - np.nanmin(
            np.where(there, residual, np.inf), axis=1
        )
    wide = np.nonzero(spread > limit)
    kept = there.copy()
    if len(wide[0]):
        columns = residual[wide[0], :, wide[1]]
        ordered = np.sort(columns, axis=1)  # NaN goes last
        middle = np.isfinite(columns).sum(axis=1) // 2
        median = ordered[np.arange(len(ordered)), np.minimum(middle, ordered.shape[1] - 1)]
        with np.errstate(invalid="ignore"):
            kept[wide[0], :, wide[1]] = np.abs(columns - median[:, None]) <= limit
    return kept


def _steps(centred: Floats, kept: Booleans) -> Floats:
    """Sum of squared steps between neighbouring kept values, all anchors together."""
    if kept.all():
        return np.asarray((np.diff(centred, axis=1) ** 2).sum(axis=(1, 2)), dtype=np.float64)
    order = np.argsort(~kept, axis=1, kind="stable")
    values = np.take_along_axis(centred, order, axis=1)
    there = np.take_along_axis(kept, order, axis=1)
    pairs = there[:, 1:] & there[:, :-1]
    return np.asarray((np.where(pairs, np.diff(values, axis=1), 0.0) ** 2).sum(axis=(1, 2)), dtype=np.float64)


def _fit(batch: Batch, means: _Means, middle: Floats, velocity: Floats, chosen: tuple[int, ...]) -> _Fits:
    """Generalised least squares from two starts: the claim, and differences of squared ranges."""
    columns = list(chosen)
    anchors = batch.pad.anchors[columns]
    surveyed = [batch.commissioning.anchors[index] for index in columns]
    virtual = np.linalg.norm(middle[:, None, :] - anchors, axis=-1) + means.residual[:, columns]
    floor = np.array([float(a.bias[0].sigma_mm) ** 2 + float(a.survey_sigma_mm) ** 2 for a in surveyed])
    own = np.maximum(means.white[:, columns] + floor, 1.0)
    problem = Problem(
        anchors,
        middle,
        np.where(np.isfinite(virtual), virtual, 0.0),
        own,
        float(batch.commissioning.installation_sigma_mm),
        max(batch.height_accuracy_mm * _PER_95_HEIGHT, HEIGHT_SIGMA_FLOOR_MM),
    )
    found = [problem.solve(np.zeros((len(middle), 2))), problem.solve(problem.linear_start())]
    better = found[1].chi2 < found[0].chi2
    best = np.where(better[:, None], found[1].offset, found[0].offset)
    found.append(problem.solve(problem.mirrored(best)))
    each = np.stack([fix.chi2 for fix in found])
    least = each.min(axis=0)
    # Among places that the ranges cannot tell apart the drone has the benefit of the doubt.
    away = np.where(each - least < MIRROR_CHI2, np.stack([np.linalg.norm(f.offset, axis=1) for f in found]), np.inf)
    choice = away.argmin(axis=0)
    rows = np.arange(len(middle))
    offset = np.stack([fix.offset for fix in found])[choice, rows]
    chi2 = each[choice, rows]
    doubtful = (np.abs(each - least - MIRROR_CHI2) < MARGIN * MIRROR_CHI2).any(axis=0)
    # A fix that still moves matters where its χ² could still fall below what contradicts.
    hopeless = _CONTRADICTS * _limit(CHI2_MILLIONTH, len(columns) - 2)
    lost = np.stack([~(fix.moved < _CONVERGED_MM) & (fix.chi2 < hopeless) for fix in found])
    doubtful &= least < hopeless
    covariance, singular = problem.covariance(offset)
    drift = velocity * CLAIM_CLOCK_SIGMA_MS
    covariance = covariance + drift[:, :, None] * drift[:, None, :]
    unsure = doubtful | lost.any(axis=0) | singular | ~np.isfinite(chi2)
    return _Fits(offset, covariance, chi2, len(columns) - 2, unsure, problem)


def _sides(batch: Batch, fits: _Fits, middle: Floats, anchors: int) -> Integers:
    """What one estimate of each try says; REFUTED and OPEN only with a margin."""
    not_inside, outside, not_outside = _compare(batch, fits, middle)
    if anchors < REFUTING_ANCHORS:
        outside, not_outside = np.zeros_like(outside), np.ones_like(outside)
    return np.where(outside, Look.REFUTED, np.where(not_inside & not_outside, Look.OPEN, Look.ASK))


def _without_one(batch: Batch, means: _Means, velocity: Floats) -> Integers:
    """Every subset that may be the good one has to say the same, and one has to be good beyond doubt."""
    count = len(batch.pad.anchors)
    middle = means.middle
    good, unlikely, unsure = [], [], np.zeros(len(middle), dtype=bool)
    inside_excluded = np.zeros(len(middle), dtype=bool)
    outside_all = np.ones(len(middle), dtype=bool)
    outside_excluded = np.zeros(len(middle), dtype=bool)
    hopeless = np.full(len(middle), fill_value=batch.steady)
    for left_out in range(count):
        fits = _fit(batch, means, middle, velocity, tuple(i for i in range(count) if i != left_out))
        passing, possible = _limit(CHI2_LIMITS, fits.freedom), _limit(CHI2_MILLIONTH, fits.freedom)
        near = _near(fits.chi2, passing) | _near(fits.chi2, possible)
        unsure |= fits.unsure | near
        candidate = fits.chi2 <= possible
        good.append(fits.chi2 <= passing)
        unlikely.append(~candidate)
        not_inside, outside, not_outside = _compare(batch, fits, middle)
        hopeless &= fits.chi2 > _STUCK * passing
        inside_excluded |= candidate & not_inside
        outside_all &= ~candidate | outside
        outside_excluded |= candidate & not_outside
    none_good = ~np.any(good, axis=0)
    if count - 1 < REFUTING_ANCHORS:
        outside_all[:] = False
        outside_excluded[:] = True
    some = ~np.all(unlikely, axis=0)
    answer = np.where(
        none_good,
        np.where(hopeless, Look.STUCK, Look.OPEN),
        np.where(outside_all & some, Look.REFUTED, np.where(inside_excluded & outside_excluded, Look.OPEN, Look.ASK)),
    )
    return np.where(unsure, Look.ASK, answer)


def _near(value: Floats, limit: float) -> Booleans:
    return np.asarray(np.abs(value - limit) <= MARGIN * limit)


def _compare(batch: Batch, fits: _Fits, middle: Floats) -> tuple[Booleans, Booleans, Booleans]:
    """(surely not proved inside, surely proved outside, surely not proved outside) for each try."""
    radius = float(batch.policy.buffer_mm)
    values, vectors = np.linalg.eigh(fits.covariance)
    s2, s1 = np.sqrt(np.maximum(values[:, 0], 1e-6)), np.sqrt(np.maximum(values[:, 1], 1e-6))
    offset, long, bent = _straightened(batch, fits.offset, middle, s1, s2)
    m1 = np.einsum("bi,bi->b", offset, vectors[:, :, 1])
    m2 = np.einsum("bi,bi->b", offset, vectors[:, :, 0])
    edges = _edges(batch.policy)
    beyond = np.hypot(m1, m2) - radius
    depth = _depth_at_most(m1, m2, s1, s2, radius)
    not_inside = (beyond > 1.0) | ((beyond < -1.0) & (depth < edges.inside_least.at(s1) * (1.0 - MARGIN)))
    away = _distance_to_disc(m1, m2, s1, s2, radius)
    enough = edges.outside_most.at(s1) * (1.0 + MARGIN)
    outside = (beyond > 1.0) & (away > enough) & ~long  # on an arc the decision asks the flat map as well
    rows = np.nonzero(outside)[0]
    worse = fits.problem.of(rows).least_chi2_within(radius) - fits.chi2[rows]
    outside[rows] = worse > enough[rows] ** 2
    not_outside = (beyond < -1.0) | ((beyond > 1.0) & (away < edges.outside_least.at(s1) * (1.0 - MARGIN)))
    return not_inside & ~bent, outside, not_outside


def _straightened(
    batch: Batch, offset: Floats, middle: Floats, s1: Floats, s2: Floats
) -> tuple[Floats, Booleans, Booleans]:
    """The offset on the arc about the anchors where the ellipse is long, where it is, and where one cannot be sure."""
    x = middle[:, :2] + offset - batch.pad.anchors[:, :2].mean(axis=0)
    away = np.maximum(np.linalg.norm(x, axis=1), 1e-9)
    long = s1 * s1 > away * s2 * (1.0 - MARGIN)
    if not long.any():
        return offset, long, long
    unit = x / away[:, None]
    claim = x - offset
    claim_away = np.maximum(np.linalg.norm(claim, axis=1), 1e-9)
    along = (claim * unit).sum(axis=1)
    sine = (claim[:, 1] * unit[:, 0] - claim[:, 0] * unit[:, 1]) / claim_away
    arc = -away * np.arcsin(np.clip(sine, -0.87, 0.87))
    radial = away - claim_away
    curved = np.stack((radial * unit[:, 0] - arc * unit[:, 1], radial * unit[:, 1] + arc * unit[:, 0]), axis=1)
    behind = along <= 0.52 * claim_away
    either = long & (s1 * s1 < away * s2 * (1.0 + MARGIN))
    bent = np.where((long & ~behind & ~either)[:, None], curved, offset)
    return bent, long, either | (long & behind & (along > 0.48 * claim_away))


def _depth_at_most(m1: Floats, m2: Floats, s1: Floats, s2: Floats, radius: float) -> Floats:
    """An upper bound on the distance (σ) from a point in the disc to its edge: the least of some directions."""
    best = np.full_like(m1, np.inf)
    for angle in np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS):
        u1, u2 = np.cos(angle), np.sin(angle)
        along = m1 * u1 + m2 * u2
        reach = -along + np.sqrt(np.maximum(along**2 + radius**2 - m1**2 - m2**2, 0.0))
        best = np.minimum(best, reach * np.sqrt((u1 / s1) ** 2 + (u2 / s2) ** 2))
    return best


def _distance_to_disc(m1: Floats, m2: Floats, s1: Floats, s2: Floats, radius: float) -> Floats:
    """Distance (σ) from points outside to the disc, by bisection for the multiplier of its edge."""
    low, high = np.full_like(m1, -30.0), np.full_like(m1, 10.0)
    for _ in range(45):
        multiplier = np.exp(0.5 * (low + high))
        q1, q2 = m1 / (1.0 + multiplier * s1**2), m2 / (1.0 + multiplier * s2**2)
        too_far = q1 * q1 + q2 * q2 > radius * radius
        middle = 0.5 * (low + high)
        low, high = np.where(too_far, middle, low), np.where(too_far, high, middle)
    multiplier = np.exp(0.5 * (low + high))
    q1, q2 = m1 / (1.0 + multiplier * s1**2), m2 / (1.0 + multiplier * s2**2)
    return np.asarray(np.hypot((m1 - q1) / s1, (m2 - q2) / s2), dtype=np.float64)


@dataclass(frozen=True)
class _Threshold:
    """Standard deviations that prove a side, as a function of the ellipse's long axis."""

    log_s1: Floats
    needed: Floats

    def at(self, s1: Floats) -> Floats:
        """At these axes (mm)."""
        return np.asarray(np.interp(np.log(s1), self.log_s1, self.needed), dtype=np.float64)


@dataclass(frozen=True)
class _Edges:
    """What proves a side, at least and at most: it also depends on how much the last round told."""

    inside_least: _Threshold
    outside_least: _Threshold
    outside_most: _Threshold


@lru_cache(maxsize=8)
def _edges(policy: Policy) -> _Edges:
    """Read off the decision's own functions by bisection."""
    radius = float(policy.buffer_mm)
    grid = np.exp(np.linspace(np.log(0.005 * radius), np.log(50.0 * radius), _GRID))

    def inside(s1: float, depth: float) -> bool:
        if depth * s1 >= radius:  # deeper than any place in the disc
            return True
        covariance = Matrix2(s1 * s1, 0.0, s1 * s1)
        return stopping.sides(radius - depth * s1, 0.0, covariance, policy, _LARGEST_STEP).inside

    def outside(s1: float, away: float, step: float) -> bool:
        return stopping.proved_outside(away, s1, policy, step)

    return _Edges(
        _Threshold(np.log(grid), np.array([_least(partial(inside, s1)) for s1 in grid])),
        _Threshold(np.log(grid), np.array([_least(partial(outside, s1, step=_LARGEST_STEP)) for s1 in grid])),
        _Threshold(np.log(grid), np.array([_least(partial(outside, s1, step=0.0)) for s1 in grid])),
    )


def _least(holds: Callable[[float], bool]) -> float:
    """The least value from which on ``holds``."""
    low, high = 0.0, 50.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def _limit(limits: tuple[float, ...], freedom: int) -> float:
    return limits[min(max(freedom, 1), len(limits)) - 1]
