"""The claimed height against the ranges: proved, contradicted, or the drone's word with the interval that is open.

Ranges prove a height where the geometry tells it: anchors at different heights, or all around the drone, and four or
more of them. It is proved where the claimed height is within ``height_buffer_mm`` of the measured one, by the same
sequential test as the place on the map. It is contradicted beyond the policy's buffer *and* twice the accuracy that the
drone states for its own height: an honest drone whose receiver knows its height badly, and says so, convicts itself of
nothing. And only where no anchor does it alone: each set without one of five or more anchors has to say the same.

As on the map, a mean can be balanced; so heights that waver beyond what the ranges follow prove and contradict nothing.
All of this rests on two-way ranges, and so on the drone's radio telling its times truly (``upper_bound``).
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, replace
from math import sqrt
from typing import Final

from wonderland.proofs.claims import MAX_ACCELERATION_MM_MS2, LocalClaim, Track
from wonderland.proofs.differences import Stamped
from wonderland.proofs.estimate import without
from wonderland.proofs.judgement import STATED_ACCURACIES, Measured, ppm
from wonderland.proofs.moments import LIE_SHARE, MIXED_SHARE, QUIET_SHARE, ROUGH_BUFFERS
from wonderland.proofs.motion import LARGEST_MM
from wonderland.proofs.records.policies import MAX_BUFFER_MM, Policy
from wonderland.proofs.reduction import AnchorMean, Reduced, Residuals, Series, mean
from wonderland.proofs.space import FOUR, Solid, chi2_at_height, solve_in_space
from wonderland.proofs.special import CHI2_LIMITS, CHI2_MILLIONTH, normal_half
from wonderland.proofs.stopping import MAX_MORE_ROUNDS, proved_inside, proved_outside, rounds_needed, step_between

TIME_DIFFERENCES: Final = 3
"""From this assurance on nothing rests on the drone's own clock."""
CONTRADICTING_ANCHORS: Final = 5
"""Three unknowns and two to contradict them: the redundancy with which four anchors refute a place on the map."""
INTERVAL_SIGMAS: Final = 3.0
"""The interval that is said to be open; beyond it is what 3 of 1,000 honest measurements would exclude."""
_TRIED: Final = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Heights within a tolerance, in tolerances, of which none may explain the ranges."""
_STRETCHES: Final = ((80, 8), (20, 4), (0, 2))
"""(rounds, stretches of time) into which so many rounds and more are cut."""
UNKNOWN_MM: Final = 1e6
"""Standard deviation of what all anchors' lengths have in common where nothing is known of it."""
OTHER_STARTS_MM: Final = (-10_000.0, -5_000.0, -2_000.0, 2_000.0, 5_000.0, 10_000.0, 20_000.0)
"""Differences fit at a second height that is no mirror image: it is looked for from these as well."""


@dataclass(frozen=True, slots=True)
class Vertical:
    """What the ranges say of the height."""

    outcome: str
    """proved, contradicted or claimed."""
    solid: Solid
    tolerance_mm: float
    """Beyond this from the claimed height it is contradicted."""
    low: float
    high: float
    """The interval that is open, as offsets from the claimed height, mm."""
    likelihood_ppm: int
    significance: float
    """Standard deviations between the measured height and the nearest that is tolerated; 0 within."""
    more: int
    """Further rounds expected to prove or contradict it; −1: none would."""

    @property
    def doubted(self) -> bool:
        """Whether the interval leaves no room for what the drone claims, proved or not."""
        return self.outcome == "contradicted" or self.significance > INTERVAL_SIGMAS


def judge_vertical(
    policy: Policy,
    measured: Measured,
    claims: tuple[LocalClaim, ...],
    stated_mm: float,
    stamps: Stamped | None = None,
) -> Vertical | None:
    """The claimed height judged; None where the geometry tells nothing of it, or the ranges contradict one another.

    ``claims``: all that were made in the session; ``stated_mm``: the largest accuracy (95 %) that they state for it;
    ``stamps``: of the drone's frames, where they are tied to the session. A policy that trusts no drone's clock wants
    the height proved by these as well.
    """
    reduced = measured.reduced
    whole = solve_in_space(reduced, measured.offset.east, measured.offset.north)
    if whole is None:
        return None
    found = _candidates(reduced, whole)
    if not found:
        return None
    buffer = float(policy.height_buffer_mm)
    tolerance = max(buffer, STATED_ACCURACIES * stated_mm)
    solid = found[0].solid
    significance = min(_outside(one, tolerance) for one in found)
    outcome, more = "claimed", -1
    if all(_inside(policy, one) for one in found):
        if _steady(reduced, whole, claims, sqrt(LIE_SHARE) * buffer, LIE_SHARE):
            outcome = "proved"
    elif _contradicts(policy, found, tolerance, significance) and _steady(
        reduced, whole, claims, ROUGH_BUFFERS * tolerance, MIXED_SHARE
    ):
        outcome = "contradicted"
    else:
        more = max(_more(policy, one) for one in found)
    if outcome == "proved" and policy.min_assurance >= TIME_DIFFERENCES:
        timed = _of_stamps(stamps)
        if timed is None or not _inside(policy, timed):
            outcome, more = "claimed", -1 if timed is None else _more(policy, timed)
    return Vertical(
        outcome=outcome,
        solid=solid,
        tolerance_mm=tolerance,
        low=min(one.lowest for one in found),
        high=max(one.highest for one in found),
        likelihood_ppm=ppm(min(one.likelihood(buffer) for one in found)),
        significance=significance,
        more=more,
    )


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A set of anchors that agree, and the place that fits them best."""

    reduced: Reduced
    solid: Solid

    @property
    def heights(self) -> tuple[float, ...]:
        """Of all places that fit, as offsets from the claimed one, mm."""
        return (self.solid.up, *self.solid.others)

    @property
    def deviation(self) -> float:
        return sqrt(self.solid.uu)

    @property
    def lowest(self) -> float:
        return min(self.heights) - INTERVAL_SIGMAS * self.deviation

    @property
    def highest(self) -> float:
        return max(self.heights) + INTERVAL_SIGMAS * self.deviation

    @property
    def step(self) -> float:
        """How much the last round told (``stopping.step_between``)."""
        return step_between(self.solid.uu, max(self.solid.uu - self.solid.floor, 0.0), self.reduced.rounds)

    def likelihood(self, buffer: float) -> float:
        """That the drone's height is within the buffer."""
        return min(
            normal_half((buffer - up) / self.deviation) + normal_half((buffer + up) / self.deviation)
            for up in self.heights
        )


def _candidates(reduced: Reduced, whole: Solid) -> list[_Candidate]:
    """All anchors where they agree; else each set without one that does, as ``agreement`` has it."""
    if whole.chi2 <= _limit(CHI2_LIMITS, whole.freedom):
        return [_Candidate(reduced, whole)]
    found = []
    passes = False
    for position in range(len(reduced.anchors)):
        rest = without(reduced, position)
        part = solve_in_space(rest, whole.east, whole.north)
        if part is None:
            return []
        if part.chi2 <= _limit(CHI2_MILLIONTH, part.freedom):
            found.append(_Candidate(rest, part))
            passes = passes or part.chi2 <= _limit(CHI2_LIMITS, part.freedom)
    found.sort(key=lambda one: one.solid.chi2)
    return found if passes else []


def _of_stamps(stamps: Stamped | None) -> _Candidate | None:
    """The place by the time stamps alone: when a frame was sent is common to all anchors, and not known."""
    if stamps is None or len(stamps.fix.heard) <= FOUR:
        return None
    anchors = tuple(
        AnchorMean(one.index, one.east, one.north, one.up, one.length, 0.0, stamps.frames, one.white, one.floor)
        for one in stamps.fix.heard
    )
    reduced = Reduced(
        anchors=anchors,
        east=stamps.east,
        north=stamps.north,
        up=stamps.fix.up,
        t_ms=0,
        rounds=stamps.frames,
        effective=stamps.effective,
        bursts=stamps.bursts,
        height_sigma_mm=0.0,
        installation_sigma_mm=UNKNOWN_MM,
    )
    solid = solve_in_space(reduced, 0.0, 0.0, OTHER_STARTS_MM)
    if solid is None or solid.chi2 > _limit(CHI2_LIMITS, solid.freedom - 1):
        return None
    return _Candidate(reduced, solid)


def _inside(policy: Policy, one: _Candidate) -> bool:
    """Whether every height outside of the buffer is excluded, by the covariance and by the ranges themselves."""
    buffer, deviation, solid = float(policy.height_buffer_mm), one.deviation, one.solid
    if any(abs(up) >= buffer for up in one.heights) or one.likelihood(buffer) * 1e6 < policy.verify_ppm:
        return False
    depth = (buffer - abs(solid.up)) / deviation
    if not proved_inside(depth, deviation, buffer, policy, one.step):
        return False
    worse = min(chi2_at_height(one.reduced, solid, edge) for edge in (-buffer, buffer)) - solid.chi2
    depth = min(depth, sqrt(worse)) if worse > 0.0 else 0.0
    return proved_inside(depth, deviation, buffer, policy, one.step)


def _outside(one: _Candidate, tolerance: float) -> float:
    """Standard deviations by which every tolerated height is excluded; 0 where one is not."""
    away = min(abs(up) for up in one.heights) - tolerance
    if away <= INTERVAL_SIGMAS * one.deviation:
        return max(away, 0.0) / one.deviation
    # Near the anchors' plane the likelihood is no bell: what a tolerated height costs is for the ranges to say.
    worse = min(chi2_at_height(one.reduced, one.solid, tried * tolerance) for tried in _TRIED) - one.solid.chi2
    return min(away / one.deviation, sqrt(worse)) if worse > 0.0 else 0.0


def _contradicts(policy: Policy, found: list[_Candidate], tolerance: float, significance: float) -> bool:
    """Whether the height is proved to be another one, by all anchors together and without each of them."""
    whole = found[0]
    reduced = whole.reduced
    if len(found) > 1 or len(reduced.anchors) < CONTRADICTING_ANCHORS or significance <= INTERVAL_SIGMAS:
        return False
    against = replace(policy, buffer_mm=min(int(tolerance), MAX_BUFFER_MM))
    if not proved_outside(significance, whole.deviation, against, whole.step):
        return False
    for position in range(len(reduced.anchors)):
        rest = without(reduced, position)
        part = solve_in_space(rest, whole.solid.east, whole.solid.north)
        if part is None:
            return False
        if part.chi2 > _limit(CHI2_MILLIONTH, part.freedom):
            continue  # these contradict one another: it is not that anchor which misleads the others
        one = _Candidate(rest, part)
        if not proved_outside(_outside(one, tolerance), one.deviation, against, one.step):
            return False
    return True


def _more(policy: Policy, one: _Candidate) -> int:
    """Further rounds, or frames, that settle it; −1 where none do."""
    rounds = one.reduced.rounds
    white = max(one.solid.uu - one.solid.floor, 0.0) * rounds
    wanted = replace(policy, buffer_mm=policy.height_buffer_mm)
    total = rounds_needed(abs(one.solid.up), white, one.solid.floor, wanted)
    return min(max(total - rounds, 1), MAX_MORE_ROUNDS) if total > 0 else -1


def _steady(reduced: Reduced, solid: Solid, claims: tuple[LocalClaim, ...], most_mm: float, torn_share: float) -> bool:
    """Whether the claimed heights waver about the drone's by less than this, and few rounds contradict the others."""
    seen = reduced.residuals
    if seen is None:
        return False
    if seen.torn >= torn_share * len(seen.claimed.kept):
        return False
    ups = [*seen.claimed.up, *[claim.up for claim in claims]]
    level = max(ups) - min(ups) <= most_mm  # then every claim is on the way
    if not level and any(not _on_the_way(seen.claimed, claim, most_mm) for claim in claims):
        return False
    return _waver(reduced, solid, seen, QUIET_SHARE * most_mm) <= most_mm


def _on_the_way(track: Track, claim: LocalClaim, most_mm: float) -> bool:
    """Whether a claim made between two rounds has the height that these have, give or take a drone's climb."""
    times = track.t_ms
    after = bisect_right(times, claim.t_ms)
    if not 0 < after < len(times):
        return True
    gap = times[after] - times[after - 1]
    share = (claim.t_ms - times[after - 1]) / gap
    up = track.up[after - 1] + (track.up[after] - track.up[after - 1]) * share
    return abs(claim.up - up) <= most_mm + MAX_ACCELERATION_MM_MS2 * gap * gap / 8.0


def _waver(reduced: Reduced, solid: Solid, seen: Residuals, quiet_mm: float) -> float:
    """Bound (mm) on the root mean square of claimed minus flown height about their mean.

    Claims that spread by ``quiet_mm`` at most hide nothing more than that.
    """
    columns = [column for column, _ in seen.series]
    heights, moments = _heights(columns, [middle for _, middle in seen.series], solid.gains)
    if 2 * len(heights) < len(seen.track.kept) or len(heights) < 2:
        return LARGEST_MM
    variance = 0.0
    for gain, anchor in zip(solid.gains, reduced.anchors, strict=True):
        variance += gain * gain * anchor.white * anchor.count
    claimed = [seen.claimed.up[moment] for moment in moments]
    slow = _slow(heights, variance)
    extent = max(claimed) - min(claimed)
    if extent <= quiet_mm:
        return sqrt(extent * extent + slow)
    moved = max(_unfollowed(_level(claimed), heights, variance), _unfollowed(_less_line(claimed), heights, variance))
    return sqrt(moved * moved + slow)


def _heights(columns: list[Series], means: list[float], gains: tuple[float, ...]) -> tuple[list[float], list[int]]:
    """By round that all anchors measured: the height that its residuals add to the mean one, mm."""
    everywhere = len(columns[0].values)
    if all(len(column.values) == everywhere for column in columns) and all(
        column.rounds == columns[0].rounds for column in columns
    ):
        heights = [0.0] * everywhere
        for column, middle, gain in zip(columns, means, gains, strict=True):
            heights = [height + gain * (value - middle) for height, value in zip(heights, column.values, strict=True)]
        return heights, list(columns[0].rounds)
    values: dict[int, float] = {}
    counts: dict[int, int] = {}
    for column, middle, gain in zip(columns, means, gains, strict=True):
        for moment, value in zip(column.rounds, column.values, strict=True):
            values[moment] = values.get(moment, 0.0) + gain * (value - middle)
            counts[moment] = counts.get(moment, 0) + 1
    moments = [moment for moment in sorted(values) if counts[moment] == len(columns)]
    return [values[moment] for moment in moments], moments


def _level(values: list[float]) -> list[float]:
    middle = mean(values)
    return [value - middle for value in values]


def _less_line(values: list[float]) -> list[float]:
    """What no steady climb explains."""
    level = _level(values)
    middle = 0.5 * (len(values) - 1)
    along = spread = 0.0
    for position, value in enumerate(level):
        along += (position - middle) * value
        spread += (position - middle) * (position - middle)
    slope = along / spread if spread > 0.0 else 0.0
    return [value - slope * (position - middle) for position, value in enumerate(level)]


def _unfollowed(claimed: list[float], heights: list[float], variance: float) -> float:
    """Bound (root mean square, mm) on claimed climbs that the ranges do not follow: residuals are minus these."""
    square = product = 0.0
    for said, measured in zip(claimed, heights, strict=True):
        square += said * said
        product += said * measured
    if square <= 0.0:
        return 0.0
    share = abs(product) / square + INTERVAL_SIGMAS * sqrt(variance / square)
    return share * sqrt(square / len(claimed))


def _slow(heights: list[float], variance: float) -> float:
    """Mean square (mm²) of the heights of stretches of time about their mean, where more than noise; else 0."""
    count = len(heights)
    parts = next(parts for least, parts in _STRETCHES if count >= least)
    square = 0.0
    for part in range(parts):
        middle = mean(heights[count * part // parts : count * (part + 1) // parts])
        square += middle * middle / parts
    noise = variance * parts / count
    if square * parts <= _limit(CHI2_LIMITS, parts - 1) * noise:
        return 0.0
    return max(square - noise * (parts - 1) / parts, 0.0)


def _limit(limits: tuple[float, ...], freedom: int) -> float:
    return limits[min(max(freedom, 1), len(limits)) - 1]
