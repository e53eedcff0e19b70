"""Where the drone says that it was at each moment of the session: its signed claims, joined by straight lines."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from typing import Final, NamedTuple

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local
from wonderland.proofs.records.pads import Frame
from wonderland.proofs.records.sessions import Claim

MAX_GAP_MS: Final = 1_200
"""Between claims farther apart than this nothing is claimed: a drone that turns leaves the straight line by metres."""
HELD_MS: Final = 100
"""Before the first claim and after the last one a claim is held for so long: a drone in flight leaves it behind."""
MAX_SPEED_MM_MS: Final = 120.0
"""No drone that lands on a pad flies faster (mm/ms = m/s); a claim that does so has jumped."""
MAX_ACCELERATION_MM_MS2: Final = 0.01
"""What a drone that lands on a pad may turn or brake with: 10 m/s²."""
JUMP_TOLERANCE_MM: Final = 2_000.0
"""A filter that settles may move a claim by so much at once."""
LOWEST_MM: Final = 2_000.0
"""Nobody ranges from farther below the lowest anchor: the ground, or the roof that the pad stands on, is between."""
_NEVER_MS: Final = 2**63
_PER_95_HEIGHT: Final = 0.5102
"""Standard deviation for one unit of a 95 % bound in one dimension (1/1.96)."""


class LocalClaim(NamedTuple):
    """A claim in the pad's frame. A named tuple: a verdict makes hundreds."""

    t_ms: int
    east: float
    north: float
    up: float


class Track(NamedTuple):
    """The claimed places at several moments, by column. A verdict has hundreds: a place of its own each would cost."""

    kept: Sequence[int]
    """Which of the moments have a claimed place."""
    t_ms: list[int]
    """When that was claimed: the moment itself, or before the first claim and after the last the time of that one."""
    east: list[float]
    north: list[float]
    up: list[float]

    def velocity(self) -> tuple[float, float]:
        """Mean claimed velocity (east, north) from the first to the last of these moments, mm/ms."""
        span = self.t_ms[-1] - self.t_ms[0]
        if span <= 0:
            return 0.0, 0.0
        return (self.east[-1] - self.east[0]) / span, (self.north[-1] - self.north[0]) / span

    def mean_ms(self) -> int:
        """The middle of these moments: that of the mean place."""
        first = self.t_ms[0]
        return first + sum([t_ms - first for t_ms in self.t_ms]) // len(self.t_ms)

    def middle(self) -> LocalClaim:
        """The moment next to the middle of these."""
        wanted = self.mean_ms()
        after = min(bisect_left(self.t_ms, wanted), len(self.t_ms) - 1)
        before = max(after - 1, 0)
        at = after if self.t_ms[after] - wanted < wanted - self.t_ms[before] else before
        return LocalClaim(self.t_ms[at], self.east[at], self.north[at], self.up[at])

    def jumps(self, tolerance_mm: float) -> bool:
        """Whether the claim leaves its flight from one moment to the next as no drone can, give or take so much."""
        for after in range(2, len(self.t_ms)):
            before, gap = self.t_ms[after - 1] - self.t_ms[after - 2], self.t_ms[after] - self.t_ms[after - 1]
            if before <= 0:
                continue
            share = gap / before
            east = self.east[after] - self.east[after - 1] - (self.east[after - 1] - self.east[after - 2]) * share
            north = self.north[after] - self.north[after - 1] - (self.north[after - 1] - self.north[after - 2]) * share
            turned = MAX_ACCELERATION_MM_MS2 * gap * (gap + before) / 2.0
            if sqrt(east * east + north * north) > tolerance_mm + turned:
                return True
        return False

    def only(self, positions: Sequence[int]) -> Track:
        """Some of them, by their position in the columns."""
        return Track(
            [self.kept[position] for position in positions],
            [self.t_ms[position] for position in positions],
            [self.east[position] for position in positions],
            [self.north[position] for position in positions],
            [self.up[position] for position in positions],
        )


def track_of(claims: Sequence[LocalClaim]) -> Track:
    """Claims as they were made, as a track."""
    return Track(
        range(len(claims)),
        [claim.t_ms for claim in claims],
        [claim.east for claim in claims],
        [claim.north for claim in claims],
        [claim.up for claim in claims],
    )


_Segment = tuple[int, float, float, float, int, float, float, float]
"""A straight line between two claims: when and where it starts, how long it takes, how far it leads."""


def _moment(point: LocalClaim) -> int:
    return point.t_ms


class ClaimedPath:
    """The claimed positions in the pad's frame as a function of time."""

    def __init__(self, frame: Frame, claims: Sequence[Claim], rest: ClaimedPath | None = None) -> None:
        """``claims`` must not be empty; raises GeometryError where one is not near the pad.

        ``rest``: a path of other claims that belong to it as well.
        """
        if not claims:
            raise GeometryError("there is no claim")
        points = [] if rest is None else list(rest.points)
        for claim in claims:
            east, north, up = to_local(frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
            points.append(LocalClaim(claim.t_ms, float(east), float(north), float(up)))
        points.sort(key=_moment)
        self.points: Final[tuple[LocalClaim, ...]] = tuple(points)
        self._times: Final[list[int]] = [point.t_ms for point in points]
        self._segments: Final[dict[int, _Segment | None]] = {}
        accuracies, heights = [claim.accuracy_mm for claim in claims], [claim.height_accuracy_mm for claim in claims]
        if rest is not None:
            accuracies.append(rest.accuracy_mm)
            heights.append(rest.height_accuracy_mm)
        self.accuracy_mm: Final[int] = max(accuracies)
        self.height_accuracy_mm: Final[int] = max(heights)
        self.height_sigma_mm: Final = self.height_accuracy_mm * _PER_95_HEIGHT

    def jump_mm(self) -> float:
        """The largest step between two claims beyond what a drone can fly and its accuracy explains; 0 without one."""
        largest = 0.0
        for before, after in pairwise(self.points):
            east, north = after.east - before.east, after.north - before.north
            step = sqrt(east * east + north * north)
            allowed = MAX_SPEED_MM_MS * (after.t_ms - before.t_ms) + JUMP_TOLERANCE_MM
            if step > allowed + 2.0 * self.accuracy_mm:
                largest = max(largest, step)
            climb = abs(after.up - before.up)
            if climb > allowed + 2.0 * self.height_accuracy_mm:
                largest = max(largest, climb)
        return largest

    def mean_speed(self) -> float:
        """Mean claimed speed over the ground, mm/ms; 0 where the claims span no time."""
        span = self.points[-1].t_ms - self.points[0].t_ms
        if span <= 0:
            return 0.0
        total = 0.0
        for before, after in pairwise(self.points):
            east, north = after.east - before.east, after.north - before.north
            total += sqrt(east * east + north * north)
        return total / span

    def at(self, t_ms: int) -> LocalClaim | None:
        """The claimed position at a moment, or None where there is none.

        Between two claims on a straight line, unless they are too far apart; next to one alone, that one.
        """
        return self._between(bisect_right(self._times, t_ms), t_ms)

    def along(self, times_ms: Sequence[int]) -> Track:
        """``at`` for times in order, in one pass."""
        points = self.points
        last = len(points)
        claimed_ms = list(times_ms)
        easts: list[float] = []
        norths: list[float] = []
        ups: list[float] = []
        unclaimed: set[int] = set()
        low = bisect_right(self._times, times_ms[0]) if times_ms else 0
        until = points[low].t_ms if low < last else _NEVER_MS
        segment = self._segment(low)
        begun = span = 1
        east = north = up = d_east = d_north = d_up = 0.0
        if segment is not None:
            begun, east, north, up, span, d_east, d_north, d_up = segment
        for position, t_ms in enumerate(times_ms):
            if t_ms >= until:
                while low < last and points[low].t_ms <= t_ms:
                    low += 1
                until = points[low].t_ms if low < last else _NEVER_MS
                segment = self._segment(low)
                if segment is not None:
                    begun, east, north, up, span, d_east, d_north, d_up = segment
            if segment is not None:
                share = (t_ms - begun) / span
                easts.append(east + d_east * share)
                norths.append(north + d_north * share)
                ups.append(up + d_up * share)
                continue
            place = self._between(low, t_ms)
            if place is None:
                unclaimed.add(position)
                continue
            claimed_ms[position] = place.t_ms
            easts.append(place.east)
            norths.append(place.north)
            ups.append(place.up)
        kept: Sequence[int] = range(len(claimed_ms))
        if unclaimed:
            kept = [position for position in kept if position not in unclaimed]
            claimed_ms = [claimed_ms[position] for position in kept]
        return Track(kept, claimed_ms, easts, norths, ups)

    def _segment(self, low: int) -> _Segment | None:
        """The straight line before the point ``low``; None where no claims span it. Asked for by ranges and frames."""
        if low not in self._segments:
            self._segments[low] = self._line(low)
        return self._segments[low]

    def _line(self, low: int) -> _Segment | None:
        if not 0 < low < len(self.points):
            return None
        before, after = self.points[low - 1], self.points[low]
        span = after.t_ms - before.t_ms
        if not 0 < span <= MAX_GAP_MS:
            return None
        return (
            before.t_ms,
            before.east,
            before.north,
            before.up,
            span,
            after.east - before.east,
            after.north - before.north,
            after.up - before.up,
        )

    def _between(self, low: int, t_ms: int) -> LocalClaim | None:
        """The claimed position at a moment, ``low`` being the first point after it."""
        points = self.points
        before = points[low - 1] if low > 0 else None
        after = points[low] if low < len(points) else None
        if before is not None and after is not None and after.t_ms - before.t_ms <= MAX_GAP_MS:
            span = after.t_ms - before.t_ms
            share = (t_ms - before.t_ms) / span if span > 0 else 0.0
            return LocalClaim(
                t_ms,
                before.east + (after.east - before.east) * share,
                before.north + (after.north - before.north) * share,
                before.up + (after.up - before.up) * share,
            )
        nearest: LocalClaim | None = None
        for candidate in (before, after):
            if (
                candidate is not None
                and abs(candidate.t_ms - t_ms) <= HELD_MS
                and (nearest is None or abs(candidate.t_ms - t_ms) < abs(nearest.t_ms - t_ms))
            ):
                nearest = candidate
        return nearest
