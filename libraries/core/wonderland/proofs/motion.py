"""Claimed motion that the ranges do not follow: how much of it there is, and how much there may be.

Had a claimed motion not taken place, each residual would be minus its projection on the way from the anchor. So the
residuals are fitted by that, along the line of sight and across it, which a far pad knows to millimetres and to metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Final, NamedTuple

from wonderland.proofs.claims import LocalClaim, Track
from wonderland.proofs.estimate import Offset
from wonderland.proofs.reduction import AnchorMean, Reduced, Residuals, Series, distance

SEEN_SIGMAS: Final = 3.0
"""Standard deviations from which on straight motion that the ranges do not follow is one."""
PROVED_SIGMAS: Final = 4.0
"""Standard deviations with which motion that the ranges do not follow is bounded."""
TURNING_SHARE: Final = 0.25
"""From this share of the way on (in squares: half of it) a motion turns the direction to an anchor too far."""
LARGEST_MM: Final = 1e9
"""As good as not known."""
_SINGULAR: Final = 1e-6


def _line_of_sight(reduced: Reduced, offset: Offset) -> tuple[float, float]:
    """Unit vector from the anchors' middle to the estimate."""
    x, y = reduced.east + offset.east, reduced.north + offset.north
    count = len(reduced.anchors)
    for anchor in reduced.anchors:
        x -= anchor.east / count
        y -= anchor.north / count
    away = distance(x, y, 0.0)
    return (x / away, y / away) if away > 0.0 else (1.0, 0.0)


def unfollowed_motion(
    reduced: Reduced, offset: Offset, seen: Residuals, claims: Sequence[LocalClaim], quiet_mm: float
) -> tuple[float, float, bool]:
    """Bounds (root mean square, mm) on claimed motion that did not take place: of all, and of what is not straight.

    And whether it happens so near to half of the anchors or more that these bounds do not hold.

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
    for motion in (whole, rough):
        if motion.spread > quiet_mm:
            for (column, _), anchor in zip(seen.series, reduced.anchors, strict=True):
                motion.add(column, motion.changes(column, anchor, track, sight), anchor.white * anchor.count)
    return whole.seen_mm(), rough.bound_mm(), 2 * rough.turning >= len(reduced.anchors)


def extent_mm(track: Track, claims: Sequence[LocalClaim]) -> float:
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
        self.turning = 0
        """Anchors to which the motion turns the direction too far for what is said of them here."""

    def changes(
        self, column: Series, anchor: AnchorMean, track: Track, sight: tuple[float, float]
    ) -> list[tuple[float, float]]:
        """By round, what an anchor's residual would be had the motion along, or across, not taken place (mm).

        Half-way between the claim and where the drone would then be, minus the direction times the motion. Next to the
        anchor that turns too fast to say so much.
        """
        ux, uy = sight
        found = []
        turning = False
        for position in column.rounds:
            along, across = self._along[position], self._across[position]
            x = track.east[position] - 0.5 * (along * ux - across * uy) - anchor.east
            y = track.north[position] - 0.5 * (along * uy + across * ux) - anchor.north
            away = max(distance(x, y, track.up[position] - anchor.up), 1.0)
            turning = turning or along * along + across * across > TURNING_SHARE * away * away
            found.append((-along * (x * ux + y * uy) / away, -across * (y * ux - x * uy) / away))
        self.turning += turning
        return found

    def add(self, column: Series, changes: Sequence[tuple[float, float]], variance: float) -> None:
        """The residuals of one anchor about their mean; ``variance`` (mm²) of one of them."""
        count = len(column.rounds)
        aa = ab = bb = ar = br = sum_a = sum_b = sum_r = 0.0
        for residual, (a, b) in zip(column.values, changes, strict=True):
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

    def seen_mm(self) -> float:
        """Root mean square of the motion that clearly did not take place."""
        found, known = self._estimate()
        return found if found > SEEN_SIGMAS * known else 0.0

    def bound_mm(self) -> float:
        """Root mean square of the motion that may not have taken place; never more than all of it or what was found."""
        found, known = self._estimate()
        return min(found + PROVED_SIGMAS * known, max(self.spread, found))

    def _estimate(self) -> tuple[float, float]:
        """Motion that did not take place (root mean square, mm), and its standard deviation."""
        along, across = self._energy
        determinant = self._aa * self._bb - self._ab * self._ab
        total = self._aa + self._bb
        if total <= 0.0:
            return 0.0, LARGEST_MM
        if determinant > _SINGULAR * total * total:
            a = (self._bb * self._ar - self._ab * self._br) / determinant
            b = (self._aa * self._br - self._ab * self._ar) / determinant
            return sqrt(a * a * along + b * b * across), sqrt((self._bb * along + self._aa * across) / determinant)
        # One axis hardly matters, or both are one to these anchors: each by itself, and the worse one counts.
        worst = (0.0, 0.0)
        for energy, square, product in ((along, self._aa, self._ar), (across, self._bb, self._br)):
            length = sqrt(energy)
            each = (length * abs(product) / square, length / sqrt(square)) if square > 0.0 else (0.0, length)
            worst = max(worst, each, key=_bound)
        return worst


def _bound(estimate: tuple[float, float]) -> float:
    return estimate[0] + PROVED_SIGMAS * estimate[1]
