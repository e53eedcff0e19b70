"""Is the drone where it claims at *every* claimed moment, or only on average: steps 1 and 7 of the verdict.

An estimate is a mean over rounds, and means can be balanced: a drone that tells the truth at some moments and lies at
others, or lies to both sides, keeps its mean claim where it is. So beside the mean stands the **waver**: the root mean
square, over the claimed moments, of claim minus drone about their mean. Where it is small no quarter of the moments can
be two buffers off; where it is not known to be small nothing is verified. A drone cannot jump and its claims can; so a
lie that changes is found in one of these:

- *torn rounds*: in half of the anchors or more the residual leaps, which no radio's error does (``reduction``);
- *unseen claims*: between the rounds, before the first or after the last, off the flight that the rounds' claims show;
- *stretches*: means over stretches of time, which lies that come and go slowly, and a drone that flies while it
  claims to hover, move;
- *motion*: the share of the claimed motion that the ranges do not follow, along the line of sight and across it, of
  the whole and of what no straight flight explains. That has to be *proved* small, since a far pad measures little.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple

from wonderland.proofs.claims import LocalClaim, Track
from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import Reduced, Residuals, Series, distance
from wonderland.proofs.special import CHI2_LIMITS

LIE_SHARE: Final = 0.2
"""No such share of the claimed moments may be ``LIE_BUFFERS`` buffers off or more: a quarter, less what counting blurs,
since a session has ten claims as well as a hundred."""
LIE_BUFFERS: Final = 2.0
MIXED_SHARE: Final = 0.15
"""From this share of torn rounds on the claims contradict one another: their mean refutes nobody either. Of 587 honest
windows on real ranges one in a hundred has so many, and none more than 0.4."""
ROUGH_BUFFERS: Final = 0.5
"""Claims that may jump to and fro by more than this (root mean square) have no mean that could refute."""
QUIET_SHARE: Final = 0.25
"""Claims that spread by less than this share of the buffer hide nothing that could win."""
PROVED_SIGMAS: Final = 4.0
"""Standard deviations with which motion that the ranges do not follow is bounded."""
MAX_ACCELERATION_MM_MS2: Final = 0.01
"""What a drone that lands on a pad may turn or brake with between two rounds: 10 m/s²."""
EDGE_MS: Final = 500
"""Over so long the velocity at the first and at the last round is taken."""
_STRETCHES: Final = ((80, 8), (20, 4), (0, 2))
"""(rounds, stretches of time) into which so many rounds and more are cut."""
_SINGULAR: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Moments:
    """How the claimed moments lie about what was measured, their mean apart."""

    off_share: float
    """Share of the rounds or of the claims, whichever is more, that contradict the others: torn, or unseen."""
    unseen_share: float
    """Share of the claims that no round saw and no flight explains."""
    waver_mm: float
    """Bound on the root mean square distance of the claims from where the drone was, about their mean."""
    rough_mm: float
    """The part of it that lies in motion which no straight flight explains: claims that jump to and fro."""

    def have_a_mean(self, buffer_mm: float) -> bool:
        """Whether the claims agree so far that their mean may speak against the drone.

        Where they contradict one another, or jump as the ranges do not, some are wrong and some may be right.
        """
        return self.off_share < MIXED_SHARE and self.rough_mm <= ROUGH_BUFFERS * buffer_mm

    def reach_mm(self, buffer_mm: float) -> float:
        """How far the mean may be off for a verified claim; the buffer, but where the claims waver; ≤ 0: nothing may.

        Were a quarter of the moments two buffers off, a mean m off, the waver would be √q·(2 − m) buffers or more, q
        the part of that quarter which is not torn and not unseen.
        """
        if self.off_share >= LIE_SHARE:
            return 0.0
        least = sqrt((LIE_SHARE - self.off_share) / (1.0 - self.off_share))
        return min(buffer_mm, LIE_BUFFERS * buffer_mm - self.waver_mm / least)


def moments_of(reduced: Reduced, offset: Offset, claims: Sequence[LocalClaim], buffer_mm: float) -> Moments:
    """Of a session's kept rounds and all of its claims (pad's frame, mm)."""
    seen = reduced.residuals
    if seen is None:  # nothing was ranged: a prospect
        return Moments(0.0, 0.0, 0.0, 0.0)
    quiet_mm = QUIET_SHARE * buffer_mm
    most = _extent_mm(seen.claimed, claims)
    slow = _stretches(reduced, offset, seen)
    if most <= quiet_mm:  # whatever the claims hide, it is less than could win
        return Moments(seen.torn_share, 0.0, sqrt(most * most + slow), most)
    left = set(seen.track.kept) if seen.torn else None
    unseen = torn = 0
    held = []
    for claim in claims:
        if not _explained(seen.claimed, claim, buffer_mm):
            unseen += 1
        elif left is not None and seen.claimed.kept[_nearest(seen.claimed, claim.t_ms)] not in left:
            torn += 1
        elif seen.claimed.t_ms[0] <= claim.t_ms <= seen.claimed.t_ms[-1]:
            held.append(claim)
    whole, rough = _motion(reduced, offset, seen, held, quiet_mm)
    moved = max(whole, rough)
    return Moments(
        off_share=max(seen.torn_share, (unseen + torn) / len(claims)),
        unseen_share=unseen / len(claims),
        waver_mm=sqrt(moved * moved + slow),
        rough_mm=rough,
    )


def _nearest(track: Track, t_ms: int) -> int:
    """The round next to a moment, by its position in the track."""
    after = bisect_right(track.t_ms, t_ms)
    if after == 0:
        return 0
    if after == len(track.t_ms) or t_ms - track.t_ms[after - 1] <= track.t_ms[after] - t_ms:
        return after - 1
    return after


def _explained(track: Track, claim: LocalClaim, buffer_mm: float) -> bool:
    """Whether a drone that flew by the rounds' claims can have been at this one, give or take a buffer."""
    times = track.t_ms
    after = bisect_right(times, claim.t_ms)
    if 0 < after < len(times):
        gap = times[after] - times[after - 1]
        share = (claim.t_ms - times[after - 1]) / gap
        east = track.east[after - 1] + (track.east[after] - track.east[after - 1]) * share
        north = track.north[after - 1] + (track.north[after] - track.north[after - 1]) * share
        turned = MAX_ACCELERATION_MM_MS2 * gap * gap / 8.0
    else:
        edge = 0 if after == 0 else len(times) - 1
        gap = claim.t_ms - times[edge]
        if abs(gap) > EDGE_MS:
            return True  # its moment is not one of the session's rounds: unjudged, like the request's
        velocity_east, velocity_north = _edge_velocity(track, edge)
        east, north = track.east[edge] + velocity_east * gap, track.north[edge] + velocity_north * gap
        turned = MAX_ACCELERATION_MM_MS2 * gap * gap / 2.0
    return distance(claim.east - east, claim.north - north, 0.0) <= buffer_mm + turned


def _edge_velocity(track: Track, edge: int) -> tuple[float, float]:
    """Claimed velocity (mm/ms) over the rounds next to the first or the last one."""
    times = track.t_ms
    if edge == 0:
        other = min(bisect_right(times, times[0] + EDGE_MS), len(times) - 1)
    else:
        other = max(bisect_right(times, times[-1] - EDGE_MS) - 1, 0)
    span = times[other] - times[edge]
    if span == 0:
        return 0.0, 0.0
    return (track.east[other] - track.east[edge]) / span, (track.north[other] - track.north[edge]) / span


def _line_of_sight(reduced: Reduced, offset: Offset) -> tuple[float, float]:
    """Unit vector from the anchors' middle to the estimate."""
    x, y = reduced.east + offset.east, reduced.north + offset.north
    count = len(reduced.anchors)
    for anchor in reduced.anchors:
        x -= anchor.east / count
        y -= anchor.north / count
    away = distance(x, y, 0.0)
    return (x / away, y / away) if away > 0.0 else (1.0, 0.0)


def _motion(
    reduced: Reduced, offset: Offset, seen: Residuals, claims: Sequence[LocalClaim], quiet_mm: float
) -> tuple[float, float]:
    """Bounds (root mean square, mm) on claimed motion that did not take place: of all, and of what is not straight.

    How much of it did not take place is for the rounds to say; how much there is, for the rounds or the claims,
    whichever say more: a claim between two rounds is a peak that the rounds see the slopes of.
    """
    track = seen.claimed
    sight = _line_of_sight(reduced, offset)
    flown = _turned(track.t_ms, track.east, track.north, reduced, sight)
    said = _turned(
        [claim.t_ms for claim in claims],
        [claim.east for claim in claims],
        [claim.north for claim in claims],
        reduced,
        sight,
    )
    left = _left_rounds(seen)
    whole = _Motion(flown, left, said)
    rough = _Motion(flown.less_line(left), left, said.less_line(range(len(claims))))
    stirred = [motion for motion in (whole, rough) if motion.spread > quiet_mm]
    ux, uy = sight
    for (column, _), anchor in zip(seen.series if stirred else (), reduced.anchors, strict=False):
        # Half-way between claim and mean the direction times the motion is what the range would change by.
        middle_east, middle_north = 0.5 * reduced.east - anchor.east, 0.5 * reduced.north - anchor.north
        sights = []
        for position in column.rounds:
            x, y = middle_east + 0.5 * track.east[position], middle_north + 0.5 * track.north[position]
            away = distance(x, y, track.up[position] - anchor.up)
            sights.append(((x * ux + y * uy) / away, (y * ux - x * uy) / away) if away >= 1.0 else (0.0, 0.0))
        for motion in stirred:
            motion.add(column, sights, anchor.white * anchor.count)
    return whole.bound_mm(), rough.bound_mm()


def _extent_mm(track: Track, claims: Sequence[LocalClaim]) -> float:
    """How far apart any two of the claimed places can be."""
    east = [*track.east, *[claim.east for claim in claims]]
    north = [*track.north, *[claim.north for claim in claims]]
    return distance(max(east) - min(east), max(north) - min(north), 0.0)


def _left_rounds(seen: Residuals) -> Sequence[int]:
    """Which of the claimed moments are not torn."""
    if seen.torn == 0:
        return range(len(seen.claimed.kept))
    kept = set(seen.track.kept)
    return [position for position, moment in enumerate(seen.claimed.kept) if moment in kept]


class _Turned(NamedTuple):
    """Claimed places at some moments about the mean of the kept ones: along the line of sight and across it, mm."""

    t_ms: Sequence[int]
    along: Sequence[float]
    across: Sequence[float]

    def less_line(self, left: Sequence[int]) -> _Turned:
        """The same without the straight flight that fits those that are left best."""
        return _Turned(self.t_ms, _less_line(self.along, self.t_ms, left), _less_line(self.across, self.t_ms, left))

    def energy(self, left: Sequence[int]) -> tuple[float, float]:
        """Mean squares of those that are left."""
        along = across = 0.0
        for position in left:
            along += self.along[position] * self.along[position]
            across += self.across[position] * self.across[position]
        count = max(len(left), 1)
        return along / count, across / count


def _turned(
    t_ms: Sequence[int],
    east: Sequence[float],
    north: Sequence[float],
    reduced: Reduced,
    sight: tuple[float, float],
) -> _Turned:
    ux, uy = sight
    along, across = [], []
    for at_east, at_north in zip(east, north, strict=True):
        x, y = at_east - reduced.east, at_north - reduced.north
        along.append(x * ux + y * uy)
        across.append(y * ux - x * uy)
    return _Turned(t_ms, along, across)


def _less_line(values: Sequence[float], times: Sequence[int], left: Sequence[int]) -> list[float]:
    """The values without the straight line that fits those that are left best."""
    count = len(left)
    middle_ms = mean = 0.0
    for position in left:
        middle_ms += (times[position] - times[0]) / count
        mean += values[position] / count
    square = slope = 0.0
    for position in left:
        t_ms = times[position] - times[0] - middle_ms
        square += t_ms * t_ms
        slope += t_ms * values[position]
    slope = slope / square if square > 0.0 else 0.0
    return [value - mean - slope * (t_ms - times[0] - middle_ms) for value, t_ms in zip(values, times, strict=True)]


class _Motion:
    """Which share of a claimed motion the residuals contradict, along the line of sight and across it.

    Did the motion not take place, each residual would be minus its projection on the way from the anchor.
    """

    def __init__(self, flown: _Turned, left: Sequence[int], said: _Turned) -> None:
        self._along: Final = flown.along
        self._across: Final = flown.across
        rounds, claims = flown.energy(left), said.energy(range(len(said.t_ms)))
        self._energy: Final = (max(rounds[0], claims[0]), max(rounds[1], claims[1]))
        self.spread: Final = sqrt(self._energy[0] + self._energy[1])
        self._aa = self._ab = self._bb = self._ar = self._br = 0.0

    def add(self, column: Series, sights: Sequence[tuple[float, float]], variance: float) -> None:
        """The residuals of one anchor about their mean; ``variance`` (mm²) of one of them."""
        count = len(column.rounds)
        along, across = self._along, self._across
        aa = ab = bb = ar = br = sum_a = sum_b = sum_r = 0.0
        for position, residual, (on_along, on_across) in zip(column.rounds, column.values, sights, strict=True):
            a, b = -on_along * along[position], -on_across * across[position]
            sum_a += a
            sum_b += b
            sum_r += residual
            aa += a * a
            ab += a * b
            bb += b * b
            ar += a * residual
            br += b * residual
        self._aa += (aa - sum_a * sum_a / count) / variance
        self._ab += (ab - sum_a * sum_b / count) / variance
        self._bb += (bb - sum_b * sum_b / count) / variance
        self._ar += (ar - sum_a * sum_r / count) / variance
        self._br += (br - sum_b * sum_r / count) / variance

    def bound_mm(self) -> float:
        """Root mean square of the motion that may not have taken place; never more than all of it or what was found."""
        determinant = self._aa * self._bb - self._ab * self._ab
        total = self._aa + self._bb
        if total <= 0.0:
            return self.spread
        if determinant <= _SINGULAR * total * total:
            return self._along_one_axis()
        a = (self._bb * self._ar - self._ab * self._br) / determinant
        b = (self._aa * self._br - self._ab * self._ar) / determinant
        along, across = self._energy
        found = sqrt(a * a * along + b * b * across)
        known = sqrt((self._bb * along + self._aa * across) / determinant)
        return min(found + PROVED_SIGMAS * known, max(self.spread, found))

    def _along_one_axis(self) -> float:
        """Where one axis hardly matters, or both are one to these anchors: each by itself, the worse one counts."""
        bound = 0.0
        for energy, square, product in zip(self._energy, (self._aa, self._bb), (self._ar, self._br), strict=True):
            length = sqrt(energy)
            if square <= 0.0:
                bound = max(bound, length)
                continue
            found = length * abs(product) / square
            bound = max(bound, min(found + PROVED_SIGMAS * length / sqrt(square), max(length, found)))
        return bound


def _stretches(reduced: Reduced, offset: Offset, seen: Residuals) -> float:
    """Mean square (mm²) of the offsets of stretches of time about the whole, where more than noise; else 0."""
    count = len(seen.claimed.kept)
    parts = next(parts for least, parts in _STRETCHES if count >= least)
    ee = en = nn = 0.0
    sights = []
    for anchor in reduced.anchors:
        x = reduced.east + offset.east - anchor.east
        y = reduced.north + offset.north - anchor.north
        away = max(distance(x, y, reduced.up - anchor.up), 1.0)
        sights.append((x / away, y / away))
        ee += x * x / (away * away)
        en += x * y / (away * away)
        nn += y * y / (away * away)
    determinant = ee * nn - en * en
    if determinant <= _SINGULAR * (ee + nn) * (ee + nn):
        return 0.0
    east, north = [0.0] * parts, [0.0] * parts
    noise = 0.0
    for (column, mean), (x, y), anchor in zip(seen.series, sights, reduced.anchors, strict=True):
        sums, counts = [0.0] * parts, [0] * parts
        for position, value in zip(column.rounds, column.values, strict=True):
            part = position * parts // count
            sums[part] += value
            counts[part] += 1
        for part in range(parts):
            if counts[part]:
                away = sums[part] / counts[part] - mean
                east[part] += x * away
                north[part] += y * away
        noise += anchor.white * anchor.count
    variance = noise / len(reduced.anchors) * parts / count
    chi2 = square = 0.0
    for part in range(parts):
        be, bn = east[part], north[part]
        at_east, at_north = (nn * be - en * bn) / determinant, (ee * bn - en * be) / determinant
        chi2 += (be * at_east + bn * at_north) / variance
        square += (at_east * at_east + at_north * at_north) / parts
    freedom = 2 * (parts - 1)
    if chi2 <= CHI2_LIMITS[min(freedom, len(CHI2_LIMITS)) - 1]:
        return 0.0
    expected = variance * (ee + nn) / determinant * (parts - 1) / parts
    return max(square - expected, 0.0)
