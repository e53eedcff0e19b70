"""Go or no-go: what a commissioned pad can settle, how far out, in how many rounds; from its commissioning alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from edge_agent.commissioning.run import Floats
from wonderland.proofs.prospects import prospect
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy

BUFFERS_M: Final = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)
BEARINGS: Final = 16
STEP_M: Final = 0.5
MAX_REACH_M: Final = 200.0
MAP_CELLS: Final = 41
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

    def sentence(self) -> str:
        """For people."""
        if self.everywhere_m is None:
            if self.best_m is None:
                return f"±{self.buffer_m:g} m: nowhere."
            return f"±{self.buffer_m:g} m: not in every direction; at best out to {self.best_m:g} m."
        return (
            f"±{self.buffer_m:g} m: {self.span()} in every direction, there with "
            f"{self.rounds_there} {'round' if self.rounds_there == 1 else 'rounds'}."
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


def rounds_at(commissioning: Commissioning, policy: Policy, east_m: float, north_m: float, up_m: float) -> int:
    """Rounds for an honest drone at a place of the pad's frame; -1 where none or more than the policy allows."""
    found = prospect(commissioning, policy, east_m * 1000, north_m * 1000, up_m * 1000)
    if found is None or not 0 <= found.rounds <= policy.max_rounds:
        return -1
    return max(found.rounds, 1)


def reach(
    commissioning: Commissioning,
    policy: Policy | None = None,
    *,
    buffers_m: Sequence[float] = BUFFERS_M,
    height_m: float = DEFAULT_HEIGHT_M,
) -> list[Reach]:
    """For each buffer, how far out the pad verifies it, at a height above the pad's origin."""
    policy = policy or Policy()
    east, north = middle(commissioning)
    furthest = min(commissioning.max_range_mm / 1000, MAX_REACH_M)
    return [
        _reach_of(commissioning, replace(policy, buffer_mm=round(buffer * 1000)), east, north, height_m, furthest)
        for buffer in buffers_m
    ]


def go(commissioning: Commissioning, policy: Policy, distance_m: float, *, height_m: float = DEFAULT_HEIGHT_M) -> int:
    """Rounds of the worst direction at a distance; -1: no-go."""
    east, north = middle(commissioning)
    return _worst(commissioning, policy, east, north, height_m, distance_m)[0]


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
    rounds = np.array(
        [[rounds_at(commissioning, policy, east + x, north + y, height_m) for x in offsets] for y in offsets],
        dtype=float,
    )
    return ReachMap(policy.buffer_mm / 1000, height_m, east + offsets, north + offsets, rounds)


def middle(commissioning: Commissioning) -> tuple[float, float]:
    """Of the anchors, seen from above (m)."""
    count = len(commissioning.anchors)
    return (
        sum(anchor.east_mm for anchor in commissioning.anchors) / count / 1000,
        sum(anchor.north_mm for anchor in commissioning.anchors) / count / 1000,
    )


def _reach_of(
    commissioning: Commissioning, policy: Policy, east: float, north: float, height_m: float, furthest: float
) -> Reach:
    spans: list[tuple[float, float, int]] = []
    """(from, to, rounds at the end) of stretches on which every direction goes."""
    best: float | None = None
    went = False
    distance = STEP_M
    while distance <= furthest:
        worst, some = _worst(commissioning, policy, east, north, height_m, distance)
        if worst > 0:
            spans.append((spans.pop()[0] if went else distance, distance, worst))
        went = worst > 0
        if some:
            best = distance
        elif best is not None and distance > 2 * best:
            break
        distance += STEP_M if distance < 20.0 else 2 * STEP_M
    start, end, rounds = max(spans, key=lambda span: span[1] - span[0], default=(0.0, None, 0))
    return Reach(policy.buffer_mm / 1000, start, end, rounds, best)


def _worst(
    commissioning: Commissioning, policy: Policy, east: float, north: float, height_m: float, distance_m: float
) -> tuple[int, bool]:
    """(rounds of the worst direction or -1, whether some direction goes)."""
    worst, some = 0, False
    for index in range(BEARINGS):
        angle = 2 * math.pi * index / BEARINGS
        x, y = east + distance_m * math.cos(angle), north + distance_m * math.sin(angle)
        rounds = rounds_at(commissioning, policy, x, y, height_m)
        some = some or rounds > 0
        worst = -1 if rounds < 0 or worst < 0 else max(worst, rounds)
    return worst, some
