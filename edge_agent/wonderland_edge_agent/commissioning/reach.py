"""Go or no-go: how far out a pad verifies 90 % of honest drones, in how many rounds; from its commissioning alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from wonderland.proofs.differences import frames_needed
from wonderland.proofs.honest import SHARE_PPM, looks_of, narrowed, narrower, rounds_for, share_by
from wonderland.proofs.prospects import Prospect, height_rounds, prospect
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.run import Floats

BUFFERS_M: Final = (0.5, 1.0, 2.0, 3.0, 5.0, 10.0)
DISTANCES_M: Final = (2.0, 5.0, 8.0, 10.0, 13.0, 16.0, 20.0, 30.0, 40.0)
BEARINGS: Final = 12
STEP_M: Final = 0.5
MAX_REACH_M: Final = 200.0
MAP_CELLS: Final = 37
DEFAULT_HEIGHT_M: Final = 3.0
SHARE: Final = f"{SHARE_PPM // 10_000} % of honest drones"
"""Who is verified where it says go."""
HARDLY_ANY: Final = 0.005
MUCH_FARTHER: Final = 1.5


@dataclass(frozen=True)
class Reach:
    """How far a pad can verify a buffer. Distances are horizontal, from the anchors' middle; None: nowhere."""

    buffer_m: float
    from_m: float
    everywhere_m: float | None
    """In every direction, from ``from_m`` on."""
    rounds_there: int
    """Rounds by which ``SHARE`` is verified at that distance, in the worst direction."""
    best_m: float | None
    """In the best direction."""

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
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
            f"±{self.buffer_m:g} m: {self.span()} in every direction, there {SHARE} within "
            f"{self.rounds_there} {unit if self.rounds_there == 1 else unit + 's'}{self._best()}."
        )

    def _best(self) -> str:
        """Where some directions reach much farther than the worst one, an operator may let drones come from there."""
        if self.best_m is None or self.everywhere_m is None or self.best_m < MUCH_FARTHER * self.everywhere_m:
            return ""
        return f"; in the best direction out to {self.best_m:g} m"

    def span(self) -> str:
        """The distances, for people."""
        if self.from_m > STEP_M:
            return f"from {self.from_m:g} to {self.everywhere_m:g} m"
        return f"out to {self.everywhere_m:g} m"


@dataclass(frozen=True)
class AtDistance:
    """What the worst direction brings at a horizontal distance from the anchors' middle."""

    distance_m: float
    buffer_m: float
    rounds: int
    """By which ``SHARE`` is verified; -1 where the policy's most are too few."""
    share: float
    """Of honest drones that are verified within the policy's rounds."""
    most_rounds: int

    def document(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        return {
            "buffer_m": self.buffer_m,
            "distance_m": self.distance_m,
            "rounds": self.rounds,
            "honest_verified": round(self.share, 3),
            "within_rounds": self.most_rounds,
        }

    def sentence(self) -> str:
        """One line for the operator."""
        if self.rounds > 0:
            return f"At {self.distance_m:g} m: {SHARE} within {self.rounds} rounds (±{self.buffer_m:g} m)."
        share = "hardly any honest drone" if self.share < HARDLY_ANY else f"{100 * self.share:.0f} % of honest drones"
        return f"At {self.distance_m:g} m: {share} within {self.most_rounds} rounds (±{self.buffer_m:g} m), no-go."


@dataclass(frozen=True)
class ReachMap:
    """Rounds by which ``SHARE`` is verified, by place; -1: no number suffices or the policy's most do not."""

    buffer_m: float
    height_m: float
    east_m: Floats
    north_m: Floats
    rounds: Floats
    """(north, east)"""


class Prospects:
    """What honest drones take, by place: each place is worked out once and asked for any buffer.

    ``policies``: rising by their buffer. Places are in the pad's frame, metres.
    """

    def __init__(self, commissioning: Commissioning, policies: Sequence[Policy], height_m: float) -> None:
        self.policies: Final = tuple(policies)
        self._commissioning = commissioning
        self._up_mm = height_m * 1000

    def rounds(self, east_m: float, north_m: float) -> tuple[int, ...]:
        """Rounds by which ``SHARE`` is verified, for each policy; -1 where the policy allows too few."""
        found = self._found(east_m, north_m)
        if found is None or found.rounds < 0:  # what the widest buffer cannot settle no other can
            return (-1,) * len(self.policies)
        return tuple(rounds_for(found, policy) for policy in self.policies)

    def share(self, east_m: float, north_m: float) -> float:
        """Of honest drones, verified within the rounds of the widest policy."""
        found = self._found(east_m, north_m)
        widest = self.policies[-1]
        return 0.0 if found is None or found.rounds < 0 else share_by(found, widest, looks_of(widest)[-1])

    def _found(self, east_m: float, north_m: float) -> Prospect | None:
        return prospect(self._commissioning, self.policies[-1], east_m * 1000, north_m * 1000, self._up_mm)


class TimedProspects(Prospects):
    """The same at assurance 3, where the time stamps alone have to prove the claim: frames instead of rounds."""

    def rounds(self, east_m: float, north_m: float) -> tuple[int, ...]:
        """Frames for each policy; -1 where none, or more than the policy allows, settle it."""
        place = (east_m * 1000, north_m * 1000, self._up_mm)
        found: list[int] = []
        for policy in reversed(self.policies):
            # What a wider buffer cannot settle no narrower one can.
            lost = bool(found) and found[-1] <= 0
            found.append(-1 if lost else frames_needed(self._commissioning, narrowed(policy), *place))
        return tuple(
            _allowed(frames if frames > 0 else -1, policy)
            for frames, policy in zip(reversed(found), self.policies, strict=True)
        )


class HeightProspects(Prospects):
    """The same for a policy that demands a proven height: buffers are above and below the claimed one."""

    def rounds(self, east_m: float, north_m: float) -> tuple[int, ...]:
        """Rounds for each policy; -1 where none, or more than the policy allows, prove it."""
        place = (east_m * 1000, north_m * 1000, self._up_mm)
        asked = [
            replace(policy, height_buffer_mm=round(policy.buffer_mm * narrower(policy))) for policy in self.policies
        ]
        found = [height_rounds(self._commissioning, policy, *place) for policy in asked]
        return tuple(
            _allowed(rounds if rounds > 0 else -1, policy) for rounds, policy in zip(found, self.policies, strict=True)
        )


def reach(
    commissioning: Commissioning,
    policy: Policy | None = None,
    *,
    buffers_m: Sequence[float] = BUFFERS_M,
    height_m: float = DEFAULT_HEIGHT_M,
    kind: type[Prospects] = Prospects,
) -> list[Reach]:
    """For each buffer (rising), how far out the pad verifies it, at a height above the pad's origin.

    ``kind``: the place, ``TimedProspects`` for assurance 3, by time stamps alone, ``HeightProspects`` for the height.
    """
    policy = policy or Policy()
    policies = [replace(policy, buffer_mm=round(buffer * 1000)) for buffer in buffers_m]
    prospects = kind(commissioning, policies, height_m)
    furthest = min(commissioning.max_range_mm / 1000, MAX_REACH_M)
    rings = [(distance, _ring(prospects, middle(commissioning), distance)) for distance in _steps(furthest)]
    return [_reach_of(buffer, [(d, ring[index]) for d, ring in rings]) for index, buffer in enumerate(buffers_m)]


def by_distance(
    commissioning: Commissioning, policy: Policy, *, height_m: float = DEFAULT_HEIGHT_M
) -> list[AtDistance]:
    """The worst direction at usual distances, out to the first at which hardly any honest drone is verified."""
    prospects = Prospects(commissioning, [policy], height_m)
    centre = middle(commissioning)
    found = []
    for distance in DISTANCES_M:
        if distance * 1000 > commissioning.max_range_mm:
            break
        rounds = _ring(prospects, centre, distance)[0].worst
        share = min(prospects.share(*place) for place in _places(centre, distance))
        found.append(AtDistance(distance, policy.buffer_mm / 1000, rounds, share, looks_of(policy)[-1]))
        if share < HARDLY_ANY:
            break
    return found


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
    found = [prospects.rounds(*place) for place in _places(centre, distance_m)]
    return tuple(_Ring(-1 if min(each) < 0 else max(each), max(each) > 0) for each in zip(*found, strict=True))


def _places(centre: tuple[float, float], distance_m: float) -> list[tuple[float, float]]:
    angles = [2 * math.pi * index / BEARINGS for index in range(BEARINGS)]
    return [(centre[0] + distance_m * math.cos(angle), centre[1] + distance_m * math.sin(angle)) for angle in angles]


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
