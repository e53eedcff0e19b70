"""Go or no-go: what a commissioned pad can settle, how far out, in how many rounds; from its commissioning alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from edge_agent.commissioning.run import Floats
from wonderland.proofs.differences import frames_needed
from wonderland.proofs.prospects import prospect
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.stopping import rounds_needed

BUFFERS_M: Final = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)
DISTANCES_M: Final = (2.0, 5.0, 8.0, 10.0, 13.0, 16.0, 20.0, 30.0, 40.0)
BEARINGS: Final = 12
STEP_M: Final = 0.5
MAX_REACH_M: Final = 200.0
MAP_CELLS: Final = 37
DEFAULT_HEIGHT_M: Final = 3.0


@dataclass(frozen=True)
class Reach:
    """How far a pad can verify a buffer. Distances are horizontal, from the anchors' middle; None: nowhere."""

    buffer_m: float
    from_m: float
    everywhere_m: float | None
    """In every direction, from ``from_m`` on."""
    rounds_there: int
    """Rounds that the worst direction takes at that distance."""
    best_m: float | None
    """In the best direction."""

    def document(self) -> dict[str, Any]:
        """For machines."""
        return {
            "buffer_m": self.buffer_m,
            "from_m": self.from_m,
            "everywhere_m": self.everywhere_m,
            "rounds_there": self.rounds_there,
            "best_direction_m": self.best_m,
        }

    def sentence(self, unit: str = "round") -> str:
        """For people. ``unit``: round, or frame where time stamps alone decide."""
        if self.everywhere_m is None:
            if self.best_m is None:
                return f"±{self.buffer_m:g} m: nowhere."
            return f"±{self.buffer_m:g} m: not in every direction; at best out to {self.best_m:g} m."
        return (
            f"±{self.buffer_m:g} m: {self.span()} in every direction, there with "
            f"{self.rounds_there} {unit if self.rounds_there == 1 else unit + 's'}."
        )

    def span(self) -> str:
        """The distances, for people."""
        if self.from_m > STEP_M:
            return f"from {self.from_m:g} to {self.everywhere_m:g} m"
        return f"out to {self.everywhere_m:g} m"


@dataclass(frozen=True)
class ReachMap:
    """Rounds that an honest claim takes, by place; -1: no number suffices or the policy's most do not."""

    buffer_m: float
    height_m: float
    east_m: Floats
    north_m: Floats
    rounds: Floats
    """(north, east)"""


class Prospects:
    """What an honest claim takes, by place: each place is worked out once and asked for any buffer.

    ``policies``: rising by their buffer. Places are in the pad's frame, metres.
    """

    def __init__(self, commissioning: Commissioning, policies: Sequence[Policy], height_m: float) -> None:
        self.policies: Final = tuple(policies)
        self._commissioning = commissioning
        self._up_mm = height_m * 1000

    def rounds(self, east_m: float, north_m: float) -> tuple[int, ...]:
        """Rounds for each policy; -1 where none, or more than the policy allows, settle it."""
        widest = self.policies[-1]
        found = prospect(self._commissioning, widest, east_m * 1000, north_m * 1000, self._up_mm)
        if found is None or found.rounds < 0:  # what the widest buffer cannot settle no other can
            return (-1,) * len(self.policies)
        axes = found.one_round.ellipse()
        floor = found.floor.along(axes.east, axes.north)
        white = max(found.one_round.along(axes.east, axes.north) - floor, 0.0)
        return tuple(_allowed(rounds_needed(0.0, white, floor, policy), policy) for policy in self.policies)


class TimedProspects(Prospects):
    """The same at assurance 3, where the time stamps alone have to prove the claim: frames instead of rounds."""

    def rounds(self, east_m: float, north_m: float) -> tuple[int, ...]:
        """Frames for each policy; -1 where none, or more than the policy allows, settle it."""
        place = (east_m * 1000, north_m * 1000, self._up_mm)
        found = [frames_needed(self._commissioning, policy, *place) for policy in self.policies]
        return tuple(
            _allowed(frames if frames > 0 else -1, policy) for frames, policy in zip(found, self.policies, strict=True)
        )


def reach(
    commissioning: Commissioning,
    policy: Policy | None = None,
    *,
    buffers_m: Sequence[float] = BUFFERS_M,
    height_m: float = DEFAULT_HEIGHT_M,
    timed: bool = False,
) -> list[Reach]:
    """For each buffer (rising), how far out the pad verifies it, at a height above the pad's origin.

    ``timed``: at assurance 3, by time stamps alone.
    """
    policy = policy or Policy()
    policies = [replace(policy, buffer_mm=round(buffer * 1000)) for buffer in buffers_m]
    prospects = (TimedProspects if timed else Prospects)(commissioning, policies, height_m)
    furthest = min(commissioning.max_range_mm / 1000, MAX_REACH_M)
    rings = [(distance, _ring(prospects, middle(commissioning), distance)) for distance in _steps(furthest)]
    return [_reach_of(buffer, [(d, ring[index]) for d, ring in rings]) for index, buffer in enumerate(buffers_m)]


def rounds_by_distance(
    commissioning: Commissioning, policy: Policy, *, height_m: float = DEFAULT_HEIGHT_M
) -> list[tuple[float, int]]:
    """(horizontal distance in m, rounds of the worst direction there or -1) at usual distances."""
    prospects = Prospects(commissioning, [policy], height_m)
    return [
        (distance, _ring(prospects, middle(commissioning), distance)[0].worst)
        for distance in DISTANCES_M
        if distance * 1000 <= commissioning.max_range_mm
    ]


def reach_map(
    commissioning: Commissioning,
    policy: Policy | None = None,
    *,
    height_m: float = DEFAULT_HEIGHT_M,
    half_m: float | None = None,
) -> ReachMap:
    """Rounds by place about the anchors, as far as the calibration goes (at most 40 m)."""
    policy = policy or Policy()
    east, north = middle(commissioning)
    half = half_m if half_m is not None else min(commissioning.max_range_mm / 1000, 40.0)
    offsets = np.linspace(-half, half, MAP_CELLS)
    prospects = Prospects(commissioning, [policy], height_m)
    rounds = np.array([[prospects.rounds(east + x, north + y)[0] for x in offsets] for y in offsets], dtype=float)
    return ReachMap(policy.buffer_mm / 1000, height_m, east + offsets, north + offsets, rounds)


def middle(commissioning: Commissioning) -> tuple[float, float]:
    """Of the anchors, seen from above (m)."""
    count = len(commissioning.anchors)
    return (
        sum(anchor.east_mm for anchor in commissioning.anchors) / count / 1000,
        sum(anchor.north_mm for anchor in commissioning.anchors) / count / 1000,
    )


@dataclass(frozen=True)
class _Ring:
    """All directions at one distance."""

    worst: int
    """Rounds of the worst direction; -1 where one does not go."""
    some: bool
    """Whether at least one goes."""


def _ring(prospects: Prospects, centre: tuple[float, float], distance_m: float) -> tuple[_Ring, ...]:
    """One for each policy."""
    angles = [2 * math.pi * index / BEARINGS for index in range(BEARINGS)]
    found = [
        prospects.rounds(centre[0] + distance_m * math.cos(angle), centre[1] + distance_m * math.sin(angle))
        for angle in angles
    ]
    return tuple(_Ring(-1 if min(each) < 0 else max(each), max(each) > 0) for each in zip(*found, strict=True))


def _reach_of(buffer_m: float, rings: Sequence[tuple[float, _Ring]]) -> Reach:
    spans: list[tuple[float, float, int]] = []
    """(from, to, rounds at the end) of stretches on which every direction goes."""
    went = False
    for distance, ring in rings:
        if ring.worst > 0:
            spans.append((spans.pop()[0] if went else distance, distance, ring.worst))
        went = ring.worst > 0
    best = max((distance for distance, ring in rings if ring.some), default=None)
    start, end, rounds = max(spans, key=lambda span: span[1] - span[0], default=(0.0, None, 0))
    return Reach(buffer_m, start, end, rounds, best)


def _steps(furthest_m: float) -> list[float]:
    out, distance = [], STEP_M
    while distance <= furthest_m:
        out.append(distance)
        distance += STEP_M if distance < 15.0 else 1.0 if distance < 40.0 else 2.0
    return out


def _allowed(rounds: int, policy: Policy) -> int:
    return max(rounds, policy.min_rounds) if 0 <= rounds <= policy.max_rounds else -1
