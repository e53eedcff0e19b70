"""Where the drone is above its pad, by the ranges of its own node: a Kalman filter down to touch-down. Pure.

State: place and velocity of the node in the pad's frame (east, north, up; metres, metres per second), driven by white
acceleration. Each range is one measurement, corrected by the pad's commissioning; the autopilot's height is another, a
weak one, for pads whose anchors stand in one plane see height badly. Anchors are not independent of their own biases:
those are added to each range's variance, so the stated covariance is cautious about what averaging can bring. Plain
Python: each measurement is a scalar, and a companion computer need not carry numpy for six numbers.

It begins with a whole round at once: a receiver of the usual kind is metres off, ranges of a few metres turn over such
a way, and a filter that takes one after the other in the directions of a wrong place is sure of it afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.fix import MIN_ANCHORS, Multilateration
from wonderland.proofs.records.pads import Anchor, Commissioning
from wonderland.proofs.reduction import bias_at

Vector = list[float]
Matrix = list[list[float]]

ACCELERATION_M_S2: Final = 1.5
"""Of a drone that lands in gusts."""
START_SIGMA_M: Final = 3.0
START_SIGMA_M_S: Final = 1.5
HEIGHT_SIGMA_M: Final = 3.0
"""Of one of many autopilot heights in a row, whose error is the same for all of them."""
GATE_SIGMAS: Final = 4.0
MAX_REFUSED: Final = 12
"""Ranges that do not fit more than ranges that do; then the filter has lost its way, and begins anew."""
ROUND_MS: Final = 120
"""Ranges from so long on belong together, for the beginning."""
ITERATIONS: Final = 5
MAX_GAP_MS: Final = 1_000
FRESH_MS: Final = 400
FOOT_M: Final = 1.5
"""Of the cone in which a landing goes on: so far aside at the ground, and as much more as it is above it."""
SURE_SIGMAS: Final = 2.0
MAX_SIGMA_M: Final = 0.5
"""A place that is known worse than this (horizontally, 1 σ) guides nobody."""


@dataclass(frozen=True, slots=True)
class Fix:
    """Where the node is in the pad's frame: east, north, up (m), and its covariance (m²)."""

    place_m: tuple[float, float, float]
    covariance_m2: tuple[tuple[float, float, float], ...]

    @property
    def sigma_m(self) -> float:
        """The longer half-axis of the horizontal ellipse, 1 σ."""
        (ee, en, _), (_, nn, _), _ = self.covariance_m2
        return math.sqrt((ee + nn) / 2 + math.hypot((ee - nn) / 2, en))

    @property
    def strays(self) -> bool:
        """Whether it would come down beside the pad: surely outside of the cone that stands on it."""
        east_m, north_m, up_m = self.place_m
        return math.hypot(east_m, north_m) - SURE_SIGMAS * self.sigma_m > FOOT_M + max(0.0, up_m)


class Guidance:
    """Of one approach to one pad. Times are milliseconds of the clock by which ranges are stamped."""

    def __init__(self, commissioning: Commissioning) -> None:
        self._anchors = {anchor.mac: (anchor, _place(anchor)) for anchor in commissioning.anchors}
        common_mm = commissioning.installation_sigma_mm
        self._variance_m2 = (commissioning.range_sigma_mm**2 + common_mm**2) / 1e6
        self._believed: Vector | None = None
        self._round: dict[int, tuple[int, int]] = {}
        """The latest range of each anchor, and when: for the beginning."""
        self._state: Vector | None = None
        self._covariance: Matrix = []
        self._t_ms = self._used_ms = 0
        self._refused = 0

    def seed(self, place_m: tuple[float, float, float], t_ms: int) -> None:
        """Where the autopilot believes to be: for the beginning, and a height from then on."""
        self._believed = [*place_m]
        if self._state is None:
            return
        if t_ms - self._t_ms > MAX_GAP_MS:
            self._lose()
            return
        self._predict(t_ms)
        self._update((0.0, 0.0, 1.0), place_m[2] - self._state[2], HEIGHT_SIGMA_M**2)

    def range(self, mac: int, t_ms: int, range_mm: int) -> bool:
        """A range to the anchor of that address; whether it was made use of."""
        if mac not in self._anchors or range_mm <= 0:
            return False
        if self._state is None:
            return self._gather(mac, t_ms, range_mm)
        self._predict(t_ms)
        slope, residual_m, variance = self._seen(mac, range_mm, self._state)
        if not self._update(slope, residual_m, variance, gated=True):
            self._refused += 1
            if self._refused >= MAX_REFUSED:
                self._lose()
            return False
        self._refused, self._used_ms = max(0, self._refused - 1), t_ms
        return True

    def _lose(self) -> None:
        self._state, self._refused = None, 0
        self._round.clear()

    def _gather(self, mac: int, t_ms: int, range_mm: int) -> bool:
        """Begin once the anchors of a round have answered."""
        self._round = {key: each for key, each in self._round.items() if t_ms - each[0] <= ROUND_MS}
        self._round[mac] = (t_ms, range_mm)
        waited = t_ms - min(each[0] for each in self._round.values()) >= ROUND_MS / 2
        enough = MIN_ANCHORS if waited else len(self._anchors)
        if self._believed is None or len(self._round) < enough:
            return False
        return self._begin(self._believed, t_ms)

    def _begin(self, believed: Vector, t_ms: int) -> bool:
        """Gauss–Newton: a whole round, each time in the directions of the place that it gave before."""
        at = self._first(believed)
        variances = [START_SIGMA_M**2] * 3 + [START_SIGMA_M_S**2] * 3
        for _ in range(ITERATIONS):
            self._state = [*believed, 0.0, 0.0, 0.0]
            self._covariance = [[variances[i] if i == j else 0.0 for j in range(6)] for i in range(6)]
            for mac, (_, range_mm) in self._round.items():
                slope, residual_m, variance = self._seen(mac, range_mm, at)
                ahead_m = sum(slope[k] * (self._state[k] - at[k]) for k in range(3))
                self._update(slope, residual_m - ahead_m, variance)
            at = self._state[:3]
        fits = [self._seen(mac, range_mm, at) for mac, (_, range_mm) in self._round.items()]
        if any(residual_m**2 > GATE_SIGMAS**2 * variance for _, residual_m, variance in fits):
            self._lose()
            return False
        self._t_ms = self._used_ms = t_ms
        self._round.clear()
        return True

    def _first(self, believed: Vector) -> Vector:
        """Where the ranges have it at the autopilot's height; the autopilot's place where they do not say."""
        places, ranges_m = [], []
        for mac, (_, range_mm) in self._round.items():
            anchor, place = self._anchors[mac]
            places.append((place[0], place[1], place[2]))
            ranges_m.append((range_mm - bias_at(anchor, range_mm)[0]) / 1e3)
        try:
            found = Multilateration(places).fix(ranges_m, believed[2])
        except GeometryError:
            found = None
        return believed if found is None else [*found, believed[2]]

    def _seen(self, mac: int, range_mm: int, at: Vector) -> tuple[tuple[float, float, float], float, float]:
        """Of a range, from a place: its derivative, what it is more than expected (m), and its variance."""
        anchor, place = self._anchors[mac]
        bias_mm, bias_sigma_mm = bias_at(anchor, range_mm)
        east, north, up = (at[i] - place[i] for i in range(3))
        distance_m = max(math.hypot(east, north, up), 1e-3)
        variance = self._variance_m2 + (bias_sigma_mm**2 + anchor.survey_sigma_mm**2) / 1e6
        slope = (east / distance_m, north / distance_m, up / distance_m)
        return slope, (range_mm - bias_mm) / 1e3 - distance_m, variance

    def fix(self, now_ms: int) -> Fix | None:
        """The place now; None where it is not known well enough, or no range has come for a while."""
        if self._state is None or not self._used_ms or now_ms - self._used_ms > FRESH_MS:
            return None
        self._predict(now_ms)
        east, north, up = self._state[:3]
        found = Fix((east, north, up), tuple((row[0], row[1], row[2]) for row in self._covariance[:3]))
        return found if found.sigma_m <= MAX_SIGMA_M else None

    def _predict(self, t_ms: int) -> None:
        """To a later time; reports that come out of order are taken as of now."""
        assert self._state is not None
        dt_s = (t_ms - self._t_ms) / 1e3
        if dt_s <= 0:
            return
        self._t_ms = t_ms
        state, covariance = self._state, self._covariance
        for i in range(3):
            state[i] += dt_s * state[i + 3]
        for j in range(6):  # F P, then (F P) Fᵀ, for F that adds velocity times dt to place
            for i in range(3):
                covariance[i][j] += dt_s * covariance[i + 3][j]
        for row in covariance:
            for j in range(3):
                row[j] += dt_s * row[j + 3]
        push = ACCELERATION_M_S2**2
        for i in range(3):
            covariance[i][i] += push * dt_s**4 / 4
            covariance[i][i + 3] += push * dt_s**3 / 2
            covariance[i + 3][i] += push * dt_s**3 / 2
            covariance[i + 3][i + 3] += push * dt_s**2

    def _update(
        self, slope: tuple[float, float, float], residual: float, variance: float, *, gated: bool = False
    ) -> bool:
        """One scalar measurement with this derivative by place; False where it is too far out to be one."""
        assert self._state is not None
        before = self._covariance
        towards = [sum(row[k] * slope[k] for k in range(3)) for row in before]
        spread = sum(slope[k] * towards[k] for k in range(3)) + variance
        if gated and residual**2 > GATE_SIGMAS**2 * spread:
            return False
        gain = [each / spread for each in towards]
        for i in range(6):
            self._state[i] += gain[i] * residual
        # The same number for both halves keeps it symmetric over the thousands of updates of a long descent.
        self._covariance = [
            [before[i][j] - (gain[i] * towards[j] + gain[j] * towards[i]) / 2 for j in range(6)] for i in range(6)
        ]
        return True


def _place(anchor: Anchor) -> Vector:
    return [anchor.east_mm / 1e3, anchor.north_mm / 1e3, anchor.up_mm / 1e3]
