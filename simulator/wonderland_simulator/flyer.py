"""What flies: where it is, where its receiver puts it, and what it says of that to a pad and to the public."""

from __future__ import annotations

from collections.abc import Sequence

from wonderland.proofs.frame import to_local, to_wgs84
from wonderland.proofs.records.pads import Frame
from wonderland_simulator.broadcaster import Fix
from wonderland_simulator.flight import Flight, Vector
from wonderland_simulator.gnss import Gnss
from wonderland_simulator.scenario import AttackSpec


class Flyer:
    """One drone in the frame of the pad ``pad_id``; who derives from it moves ``flight`` on."""

    def __init__(
        self,
        pad_id: str,
        frame: Frame,
        flight: Flight,
        gnss: Gnss,
        *,
        attack: AttackSpec | None = None,
        broadcast_off_m: Sequence[float] = (0.0, 0.0),
    ) -> None:
        """``broadcast_off_m``: how far off (east, north) is what it tells the public while it is in the air."""
        self.pad_id = pad_id
        self.frame = frame
        self.flight = flight
        self.gnss = gnss
        self.attack = attack
        self.claimed_m: Vector | None = None
        """Where it last said that it is, in the pad's frame; None before it said anything."""
        self._broadcast_off_m = broadcast_off_m
        self._fixes = 0

    @property
    def airborne(self) -> bool:
        """Whether it says that it flies."""
        return True

    @property
    def radio_m(self) -> Vector:
        """Where the radio with the drone's keys is, in the frame of its pad."""
        if self.attack is not None and self.attack.accomplice and self.claimed_m is not None:
            return self.claimed_m
        return self.flight.position

    def fix(self, t_s: float, t_ms: int) -> Fix:
        """The drone's own word on where it is: what it signs."""
        x, y, z = self.gnss.fix(self.flight.position, t_s)
        attack = self.attack
        self._fixes += 1
        lies = attack is not None and int(self._fixes * attack.lie_share) > int((self._fixes - 1) * attack.lie_share)
        lie = attack.lie_m if attack is not None and lies else (0.0, 0.0, 0.0)
        if attack is not None and attack.mirrored and lies:
            x, y = -x, -y
        self.claimed_m = (x + lie[0], y + lie[1], z + lie[2])
        return self._fix(self.claimed_m, t_ms)

    def broadcast(self, fix: Fix) -> Fix:
        """What it tells the public: the same, unless it lies there."""
        if not any(self._broadcast_off_m) or not self.airborne:
            return fix
        east, north, up = to_local(self.frame, fix.lat_e7, fix.lon_e7, fix.height_mm)
        off_east, off_north = self._broadcast_off_m
        return self._fix((east / 1000 + off_east, north / 1000 + off_north, up / 1000), fix.t_ms)

    def steer(self, wanted: Vector, t_s: float) -> None:
        """Steer to where the receiver would read ``wanted``: an autopilot follows its GNSS, and a spoofer leads it."""
        offset = self.gnss.spoofing.offset(t_s)
        goal = (wanted[0] - offset[0], wanted[1] - offset[1], wanted[2] - offset[2])
        if self.flight.target != goal:
            self.flight.go_to(goal)

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
            airborne=self.airborne,
            t_ms=t_ms,
        )

    def _told(self, name: str, known_mm: int) -> int:
        """The accuracy that it claims: its receiver's, unless it lies about that, too."""
        lie = getattr(self.attack, name, None)
        return known_mm if lie is None else round(lie * 1000)
