"""The radio channel between two UWB antennas: what a range is worth.

White noise, a bias that grows with distance (measured on DW1000 anchors: 1 cm to 6 m, 16 cm at 14 m, 30 cm beyond
44 m), a share of lost rounds that grows with distance, and obstruction: later arrival, flagged or not.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from itertools import pairwise

BIAS_M = ((0.0, 0.0), (6.0, 0.01), (14.0, 0.16), (30.0, 0.25), (50.0, 0.30), (100.0, 0.35))
"""Distance and mean error of a range, in metres."""


@dataclass(frozen=True)
class Range:
    """One measurement."""

    range_m: float | None
    obstructed: bool
    power_dbm: float


@dataclass
class Channel:
    """Draws ranges; ``anchor_bias_m`` is each anchor's own constant error (cable, antenna, clock offset)."""

    rng: random.Random
    sigma_m: float = 0.025
    anchor_bias_m: dict[int, float] = field(default_factory=dict)
    loss: float = 0.01
    reach_m: float = 90.0
    obstruction: float = 0.0
    obstruction_delay_m: float = 0.4

    def measure(self, distance_m: float, anchor_mac: int) -> Range:
        """A range over ``distance_m`` to the anchor with this address, or None where the frame was lost."""
        lost = self.loss + max(0.0, (distance_m - 0.7 * self.reach_m) / (0.3 * self.reach_m))
        power = -62.0 - 20.0 * math.log10(max(distance_m, 0.3)) + self.rng.gauss(0.0, 0.5)
        if distance_m > self.reach_m or self.rng.random() < lost:
            return Range(None, False, power)
        obstructed = self.rng.random() < self.obstruction
        error = bias_m(distance_m) + self.anchor_bias_m.get(anchor_mac, 0.0) + self.rng.gauss(0.0, self.sigma_m)
        if obstructed:
            error += self.rng.expovariate(1.0 / self.obstruction_delay_m)
            power -= 8.0
        return Range(max(0.0, distance_m + error), obstructed, power)


def bias_m(distance_m: float) -> float:
    """Mean error of a range at a distance, linear between the measured points."""
    for (near, low), (far, high) in pairwise(BIAS_M):
        if distance_m <= far:
            return low + (high - low) * (distance_m - near) / (far - near)
    return BIAS_M[-1][1]
