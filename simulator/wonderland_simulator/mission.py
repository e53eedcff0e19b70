"""What a drone is about: it comes, asks, and lands or is turned away; then again."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from enum import StrEnum

from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.pads import Frame
from wonderland_simulator.broadcaster import Fix
from wonderland_simulator.flight import Flight, Vector
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


@dataclass
class Mission:
    """One drone of the world; ``step`` moves it on, ``command`` is its autopilot's ear."""

    spec: DroneSpec
    frame: Frame
    rng: random.Random
    flight: Flight = field(init=False)
    gnss: Gnss = field(init=False)
    mode: Mode = Mode.WAITING
    claimed_m: Vector | None = None
    """Where it last said that it is, in the pad's frame; None before it said anything."""
    proofs: int = 0
    """Times that it came to hold before the pad: the agent proves once in each."""
    _ahead: tuple[Vector, ...] = ()
    """Points of its corridor that it has yet to fly over."""
    _fixes: int = 0
    _until_s: float = 0.0
    _since_s: float = 0.0

    def __post_init__(self) -> None:
        inwards = (self.spec.away_m, *self.spec.corridor_m, self.spec.hover_m)
        straight_m = math.dist(self.spec.away_m, self.spec.hover_m)
        self._ahead, start = _left_of(inwards, straight_m * FIRST_APPROACH_SHARE)
        self.flight = Flight(start)
        self.gnss = Gnss(self.rng, self.spec.gnss_sigma_m)
        self._until_s = self.spec.start_s

    def command(self, command: str, t_s: float) -> None:
        """``land`` or ``leave``; anything else, or at another time, is ignored as an autopilot would."""
        if self.mode is not Mode.HOLDING:
            return
        if command == "land":
            up = DOCK_UP_M if self.spec.action == "dock" else TOUCHDOWN_UP_M
            self._enter(Mode.LANDING, t_s)
            self._go((0.0, 0.0, up), t_s)
        elif command == "leave":
            self._depart(t_s)

    def step(self, t_s: float, dt_s: float) -> None:
        """Move on by ``dt_s`` to the time ``t_s`` (seconds since the world began)."""
        match self.mode:
            case Mode.WAITING if t_s >= self._until_s:
                self._enter(Mode.APPROACHING, t_s)
                if self.spec.behaviour is Behaviour.GNSS_DRAGGED:
                    self.gnss.spoofing = SlowDrag(t_s + 2.0, limit_m=DRAG_LIMIT_M)
                if self.spec.attack is not None and any(self.spec.attack.spoofed_m):
                    self.gnss.spoofing = Jump(t_s, *self.spec.attack.spoofed_m)
                if self.spec.attack is not None and self.spec.attack.drag_m_s:
                    speed_m_s = self.spec.attack.drag_m_s
                    self.gnss.spoofing = SlowDrag(t_s, speed_m_s=speed_m_s, limit_m=DRAG_LIMIT_M)
                self._go(self._next(self.spec.hover_m), t_s)
            case Mode.APPROACHING:
                self._go(self._next(self.spec.hover_m), t_s)
                if self.flight.arrived and not self._ahead:
                    self.proofs += 1
                    self._enter(Mode.HOLDING, t_s)
            case Mode.HOLDING:
                self._go(self.spec.hover_m, t_s)
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

    def fix(self, t_s: float, t_ms: int) -> Fix:
        """The drone's own word on where it is: what it signs."""
        x, y, z = self.gnss.fix(self.flight.position, t_s)
        attack = self.spec.attack
        self._fixes += 1
        lies = attack is not None and int(self._fixes * attack.lie_share) > int((self._fixes - 1) * attack.lie_share)
        lie = attack.lie_m if attack is not None and lies else (0.0, 0.0, 0.0)
        self.claimed_m = (x + lie[0], y + lie[1], z + lie[2])
        return self._fix(self.claimed_m, t_ms)

    def broadcast(self, fix: Fix) -> Fix:
        """What it tells the public: the same, unless it lies there."""
        if self.spec.behaviour is not Behaviour.FALSE_BROADCAST or self.mode in {Mode.WAITING, Mode.LANDED}:
            return fix
        x, y, z = self._local(fix)
        lie = (x + FALSE_BROADCAST_M[0], y + FALSE_BROADCAST_M[1], z)
        return self._fix(lie, fix.t_ms)

    def _local(self, fix: Fix) -> Vector:
        east, north, up = to_local(self.frame, fix.lat_e7, fix.lon_e7, fix.height_mm)
        return (east / 1000, north / 1000, up / 1000)

    def _fix(self, position: Vector, t_ms: int) -> Fix:
        lat_e7, lon_e7, height_mm = to_wgs84(self.frame, *(round(value * 1000) for value in position))
        return Fix(
            lat_e7=lat_e7,
            lon_e7=lon_e7,
            height_mm=height_mm,
            above_takeoff_mm=round(position[2] * 1000),
            accuracy_mm=self._told("accuracy_m", self.gnss.accuracy_mm),
            height_accuracy_mm=self._told("height_accuracy_m", self.gnss.height_accuracy_mm),
            speed_mm_s=round(self.flight.speed_m_s * 1000),
            track_cdeg=round(self.flight.track_deg * 100) % 36_000,
            vertical_mm_s=round(self.flight.velocity[2] * 1000),
            airborne=self.mode is not Mode.LANDED,
            t_ms=t_ms,
        )

    def _told(self, name: str, known_mm: int) -> int:
        """The accuracy that it claims: its receiver's, unless it lies about that, too."""
        lie = getattr(self.spec.attack, name, None)
        return known_mm if lie is None else round(lie * 1000)

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

    def _go(self, wanted: Vector, t_s: float) -> None:
        """Steer to where the receiver would read ``wanted``: an autopilot follows its GNSS, and a spoofer leads it."""
        offset = self.gnss.spoofing.offset(t_s)
        goal = (wanted[0] - offset[0], wanted[1] - offset[1], wanted[2] - offset[2])
        if self.flight.target != goal:
            self.flight.go_to(goal)


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
