"""What a drone is about: it comes, asks, and lands or is turned away; then again."""

from __future__ import annotations

import math
import random
from enum import StrEnum

from wonderland.proofs.records.pads import Frame
from wonderland_simulator.flight import Flight, Vector
from wonderland_simulator.flyer import Flyer
from wonderland_simulator.gnss import Gnss, Jump, NoSpoofing, SlowDrag
from wonderland_simulator.scenario import FALSE_BROADCAST_M, Behaviour, DroneSpec

FIRST_APPROACH_SHARE = 0.22
"""The first time, a drone starts this far along from its hover to where it comes from, so that a demo begins soon."""
TOUCHDOWN_UP_M = 0.35
DOCK_UP_M = 1.2
GROUND_TIME_S = 6.0
REST_S = 9.0
HOLD_LIMIT_S = 90.0
"""A drone that nobody answers goes home after this."""
DRAG_LIMIT_M = 4.2
CURVE_M = 18.0
"""So near to a point of its corridor a drone turns to the next."""


class Mode(StrEnum):
    """Where a mission stands."""

    WAITING = "waiting"
    APPROACHING = "approaching"
    HOLDING = "holding"
    LANDING = "landing"
    LANDED = "landed"
    DEPARTING = "departing"


class Mission(Flyer):
    """One drone of the world; ``step`` moves it on, ``command`` is its autopilot's ear."""

    def __init__(self, spec: DroneSpec, frame: Frame, rng: random.Random) -> None:
        inwards = (spec.away_m, *spec.corridor_m, spec.hover_m)
        straight_m = math.dist(spec.away_m, spec.hover_m)
        self._ahead, start = _left_of(inwards, straight_m * FIRST_APPROACH_SHARE)
        """Points of its corridor that it has yet to fly over."""
        lies = spec.behaviour is Behaviour.FALSE_BROADCAST
        super().__init__(
            spec.pad_id,
            frame,
            Flight(start),
            Gnss(rng, spec.gnss_sigma_m),
            attack=spec.attack,
            broadcast_off_m=FALSE_BROADCAST_M if lies else (0.0, 0.0),
        )
        self.spec = spec
        self.rng = rng
        self.mode = Mode.WAITING
        self.proofs = 0
        """Times that it came to hold before the pad: the agent proves once in each."""
        self._until_s = spec.start_s
        self._since_s = 0.0

    @property
    def airborne(self) -> bool:
        """Not while it stands on the pad."""
        return self.mode is not Mode.LANDED

    def command(self, command: str, t_s: float) -> None:
        """``land`` or ``leave``; anything else, or at another time, is ignored as an autopilot would."""
        if self.mode is not Mode.HOLDING:
            return
        if command == "land":
            up = DOCK_UP_M if self.spec.action == "dock" else TOUCHDOWN_UP_M
            self._enter(Mode.LANDING, t_s)
            self.steer((0.0, 0.0, up), t_s)
        elif command == "leave":
            self._depart(t_s)

    def step(self, t_s: float, dt_s: float) -> None:
        """Move on by ``dt_s`` to the time ``t_s`` (seconds since the world began)."""
        match self.mode:
            case Mode.WAITING if t_s >= self._until_s:
                self._enter(Mode.APPROACHING, t_s)
                if self.spec.behaviour is Behaviour.GNSS_DRAGGED:
                    self.gnss.spoofing = SlowDrag(t_s + 2.0, limit_m=DRAG_LIMIT_M)
                if self.attack is not None and any(self.attack.spoofed_m):
                    self.gnss.spoofing = Jump(t_s, *self.attack.spoofed_m)
                if self.attack is not None and self.attack.drag_m_s:
                    speed_m_s = self.attack.drag_m_s
                    self.gnss.spoofing = SlowDrag(t_s, speed_m_s=speed_m_s, limit_m=DRAG_LIMIT_M)
                self.steer(self._next(self.spec.hover_m), t_s)
            case Mode.APPROACHING:
                self.steer(self._next(self.spec.hover_m), t_s)
                if self.flight.arrived and not self._ahead:
                    self.proofs += 1
                    self._enter(Mode.HOLDING, t_s)
            case Mode.HOLDING:
                self.steer(self.spec.hover_m, t_s)
                if t_s - self._since_s > HOLD_LIMIT_S:
                    self._depart(t_s)
            case Mode.LANDING if self.flight.arrived:
                self._enter(Mode.LANDED, t_s)
                self._until_s = t_s + GROUND_TIME_S
            case Mode.LANDED if t_s >= self._until_s:
                self._depart(t_s)
            case Mode.DEPARTING if self._ahead or not self.flight.arrived:
                self.flight.go_to(self._next(self.spec.away_m))
            case Mode.DEPARTING:
                self._enter(Mode.WAITING, t_s)
                self._ahead = self.spec.corridor_m
                self._until_s = t_s + REST_S + self.rng.uniform(0.0, 6.0)
                self.gnss.spoofing = NoSpoofing()
            case _:
                pass
        self.flight.step(dt_s)

    def _enter(self, mode: Mode, t_s: float) -> None:
        self.mode = mode
        self._since_s = t_s

    def _depart(self, t_s: float) -> None:
        self._enter(Mode.DEPARTING, t_s)
        self.gnss.spoofing = NoSpoofing()
        self._ahead = self.spec.corridor_m[::-1]
        self.flight.go_to(self._next(self.spec.away_m))

    def _next(self, last: Vector) -> Vector:
        """The point of the corridor that comes next, passed in a curve; ``last`` after all of them."""
        while self._ahead and math.dist(self.flight.position, self._ahead[0]) < CURVE_M:
            self._ahead = self._ahead[1:]
        return self._ahead[0] if self._ahead else last


def _left_of(way: tuple[Vector, ...], length_m: float) -> tuple[tuple[Vector, ...], Vector]:
    """(the points between, the place) where ``length_m`` of the way are left."""
    for index in range(len(way) - 1, 0, -1):
        before, after = way[index - 1], way[index]
        leg_m = math.dist(before, after)
        if leg_m >= length_m or index == 1:
            share = min(1.0, length_m / leg_m) if leg_m > 0 else 0.0
            (x0, y0, z0), (x1, y1, z1) = after, before
            return way[index:-1], (x0 + (x1 - x0) * share, y0 + (y1 - y0) * share, z0 + (z1 - z0) * share)
        length_m -= leg_m
    return (), way[-1]
