"""Where the drone says that it was at each moment of the session: its signed claims, joined by straight lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local
from wonderland.proofs.records.pads import Frame
from wonderland.proofs.records.sessions import Claim

MAX_GAP_MS: Final = 2_000
"""A moment further than this from every claim has no claimed position of its own."""
MAX_SPEED_MM_MS: Final = 120.0
"""No drone that lands on a pad flies faster (mm/ms = m/s); a claim that does so has jumped."""
JUMP_TOLERANCE_MM: Final = 2_000.0
"""A filter that settles may move a claim by so much at once."""
_PER_95_HEIGHT: Final = 0.5102
"""Standard deviation for one unit of a 95 % bound in one dimension (1/1.96)."""


@dataclass(frozen=True, slots=True)
class LocalClaim:
    """A claim in the pad's frame."""

    t_ms: int
    east: float
    north: float
    up: float


class ClaimedPath:
    """The claimed positions in the pad's frame as a function of time."""

    def __init__(self, frame: Frame, claims: Sequence[Claim]) -> None:
        """``claims`` must not be empty; raises GeometryError where one is not near the pad."""
        if not claims:
            raise GeometryError("there is no claim")
        ordered = sorted(claims, key=lambda claim: claim.t_ms)
        points = []
        for claim in ordered:
            east, north, up = to_local(frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
            points.append(LocalClaim(claim.t_ms, float(east), float(north), float(up)))
        self.points: Final = tuple(points)
        self.accuracy_mm: Final = max(claim.accuracy_mm for claim in ordered)
        self.height_accuracy_mm: Final = max(claim.height_accuracy_mm for claim in ordered)
        self.height_sigma_mm: Final = self.height_accuracy_mm * _PER_95_HEIGHT

    def jump_mm(self) -> float:
        """The largest step between two claims beyond what a drone can fly and its accuracy explains; 0 without one."""
        largest = 0.0
        for before, after in pairwise(self.points):
            east, north = after.east - before.east, after.north - before.north
            step = sqrt(east * east + north * north)
            allowed = MAX_SPEED_MM_MS * (after.t_ms - before.t_ms) + JUMP_TOLERANCE_MM + 2.0 * self.accuracy_mm
            if step > allowed:
                largest = max(largest, step)
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
        """The claimed position at a moment, or None where no claim is within MAX_GAP_MS of it.

        Between two claims on a straight line; before the first and after the last, the nearest one.
        """
        points = self.points
        low, high = 0, len(points)
        while low < high:
            middle = (low + high) // 2
            if points[middle].t_ms <= t_ms:
                low = middle + 1
            else:
                high = middle
        return self._between(low, t_ms)

    def along(self, times_ms: Sequence[int]) -> list[LocalClaim | None]:
        """``at`` for times in order, in one pass."""
        points = self.points
        last = len(points)
        places: list[LocalClaim | None] = []
        low = 0
        for t_ms in times_ms:
            while low < last and points[low].t_ms <= t_ms:
                low += 1
            places.append(self._between(low, t_ms))
        return places

    def _between(self, low: int, t_ms: int) -> LocalClaim | None:
        """The claimed position at a moment, ``low`` being the first point after it."""
        points = self.points
        before = points[low - 1] if low > 0 else None
        after = points[low] if low < len(points) else None
        if before is not None and after is not None and after.t_ms - before.t_ms <= 2 * MAX_GAP_MS:
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
                and abs(candidate.t_ms - t_ms) <= MAX_GAP_MS
                and (nearest is None or abs(candidate.t_ms - t_ms) < abs(nearest.t_ms - t_ms))
            ):
                nearest = candidate
        return nearest
