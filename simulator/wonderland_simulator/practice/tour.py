"""A vehicle on its way: waypoint by waypoint, as its receiver has it."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Final

from wonderland.proofs.records.pads import Frame
from wonderland_simulator.flight import Flight
from wonderland_simulator.flyer import Flyer
from wonderland_simulator.gnss import Gnss, Jump, NoSpoofing, SlowDrag, Spoofing
from wonderland_simulator.practice.description import Lies, Vehicle, place_of
from wonderland_simulator.scenario import AttackSpec

ARRIVED_M: Final = 0.5


class Tour(Flyer):
    """One vehicle of the scenario; ``step`` moves it on."""

    def __init__(self, told: Vehicle, frame: Frame, rng: random.Random) -> None:
        self._path = told.path
        self._repeat = told.repeat
        self._until_s = told.start_s + told.path[0].wait_s
        self.leg = 0
        """Index of the waypoint that it flies to, or waits at."""
        super().__init__(
            told.pad,
            frame,
            Flight(place_of(told.path[0])),
            Gnss(rng, told.gnss_sigma_m, spoofing=spoofing(told.lies)),
            attack=attack(told.lies),
            broadcast_off_m=told.remote_id.off_m,
        )

    @property
    def doing(self) -> str:
        """Which waypoint it flies to, or waits at."""
        return f"{self.leg + 1} of {len(self._path)}"

    def step(self, t_s: float, dt_s: float) -> str:
        """Move on by ``dt_s`` to the time ``t_s`` (s since the start). What is worth saying; mostly nothing is."""
        goes_on = self.leg + 1 < len(self._path) or (self._repeat and len(self._path) > 1)
        sets_out = goes_on and t_s >= self._until_s and self._there(t_s)
        if sets_out:
            self.leg = (self.leg + 1) % len(self._path)
            self._until_s = math.inf
            self.flight.cruise_m_s = self.flight.climb_m_s = self._path[self.leg].speed_m_s
        elif self._until_s == math.inf and self._there(t_s):
            self._until_s = t_s + self._path[self.leg].wait_s
        self.steer(place_of(self._path[self.leg]), t_s)
        self.flight.step(dt_s)
        return f"sets out to waypoint {self.doing}" if sets_out else ""

    def _there(self, t_s: float) -> bool:
        """By its receiver: who leads that away leads the vehicle away."""
        offset = self.gnss.spoofing.offset(t_s)
        read = [here + off for here, off in zip(self.flight.position, offset, strict=True)]
        return math.dist(read, place_of(self._path[self.leg])) < ARRIVED_M


def spoofing(lies: Lies) -> Spoofing:
    """What is done to its receiver."""
    if lies.gnss_drag is not None:
        drag = lies.gnss_drag
        return SlowDrag(drag.from_s, drag.speed_m_s, drag.bearing_deg, drag.limit_m)
    if lies.gnss_jump is not None:
        return Jump(lies.gnss_jump.from_s, lies.gnss_jump.east_m, lies.gnss_jump.north_m)
    return NoSpoofing()


def attack(lies: Lies) -> AttackSpec:
    """What it does itself."""
    off: Sequence[float] = lies.claim_off_m or (0.0, 0.0, 0.0)
    return AttackSpec(
        "scenario",
        lie_m=(off[0], off[1], off[2]),
        lie_share=lies.claim_share,
        ranges=lies.ranges or "",
        accuracy_m=lies.accuracy_m,
        height_accuracy_m=lies.height_accuracy_m,
        accomplice=lies.accomplice,
        mirrored=lies.claim_mirrored,
    )
