"""Attackers who change what a pad measures: each says how far off one range of one round is.

The same classes as in ``attack_lab``, for one drone behind real serial ports. Where the drone is and what it
claims are in the pad's frame, in metres.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from wonderland_simulator.flight import Vector

REDUCTION_SUCCESS: Final = 0.04
DEEPEST_M: Final = 12.0
RELAY_M: Final = 45.0
ROUND_S: Final = 0.05
KEPT: Final = 3
"""Of so many rounds one is let through."""
MOVED_M: Final = (0.0, 0.8, 0.0)


@dataclass(frozen=True)
class Situation:
    """One round: where the drone is, what it claims, the pad's anchors, and which of them measures."""

    here: Vector
    claimed: Vector
    anchors: Sequence[Vector]
    index: int
    t_s: float

    @property
    def fitting_m(self) -> tuple[float, ...]:
        """Error of each anchor's range that makes it the one of the claim."""
        return tuple(math.dist(self.claimed, anchor) - math.dist(self.here, anchor) for anchor in self.anchors)


RangeError = Callable[[Situation, random.Random], float | None]
"""Metres to add to a range; None: the drone broke the round off before it came about."""


def per_anchor(now: Situation, _: random.Random) -> float:
    """A false time for each anchor: the ranges are those of the claim."""
    return now.fitting_m[now.index]


def uniform(now: Situation, _: random.Random) -> float:
    """One false time for all anchors."""
    return math.fsum(now.fitting_m) / len(now.anchors)


def delay(now: Situation, rng: random.Random) -> float:
    """The same, but time can only be lost: a cable, or answers that come late."""
    return max(0.0, uniform(now, rng))


def mixed(now: Situation, _: random.Random) -> float:
    """Twice the lie in every other stretch of 50 ms, none between."""
    return 2.0 * now.fitting_m[now.index] if int(now.t_s / ROUND_S) % 2 else 0.0


def dropped(now: Situation, _: random.Random) -> float | None:
    """Two of three rounds are broken off; which ones suit the claim cannot be foreseen behind real ports."""
    return None if int(now.t_s / ROUND_S) % KEPT else 0.0


def silent_anchors(now: Situation, _: random.Random) -> float | None:
    """In two of three rounds two of the pad's anchors are left out of the drone's frames, now these, now those."""
    number = int(now.t_s / ROUND_S)
    return None if number % KEPT and (now.index + number) % 4 < 2 else 0.0


def random_reduction(_: Situation, rng: random.Random) -> float:
    """4 % of the ranges are shortened, by anything up to 12 m."""
    return -rng.uniform(0.0, DEEPEST_M) if rng.random() < REDUCTION_SUCCESS else 0.0


def relay(now: Situation, _: random.Random) -> float:
    """The way round: over a box at the claimed place."""
    return now.fitting_m[now.index] + RELAY_M


def one_anchor(now: Situation, _: random.Random) -> float:
    """The pad's second anchor says what the liar wants, the others the truth."""
    return now.fitting_m[now.index] if now.index == 1 else 0.0


def anchor_moved(now: Situation, _: random.Random) -> float:
    """The pad's second anchor stands elsewhere than it was surveyed."""
    if now.index != 1:
        return 0.0
    x, y, z = (a + b for a, b in zip(now.anchors[1], MOVED_M, strict=True))
    return math.dist(now.here, (x, y, z)) - math.dist(now.here, now.anchors[1])


RANGE_ATTACKS: Final[dict[str, RangeError]] = {
    "per-anchor": per_anchor,
    "uniform": uniform,
    "delay": delay,
    "mixed": mixed,
    "dropped": dropped,
    "silent-anchors": silent_anchors,
    "random-reduction": random_reduction,
    "relay": relay,
    "one-anchor": one_anchor,
    "anchor-moved": anchor_moved,
}
