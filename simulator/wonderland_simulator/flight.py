"""How a drone moves: a point that flies towards waypoints, within limits of speed and acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

Vector = tuple[float, float, float]
"""East, north, up in metres, in the frame of the pad that the drone visits."""


@dataclass
class Flight:
    """True position and velocity of one drone; ``step`` moves it on."""

    position: Vector
    cruise_m_s: float = 9.0
    climb_m_s: float = 2.5
    acceleration_m_s2: float = 4.0
    velocity: Vector = (0.0, 0.0, 0.0)
    target: Vector | None = None
    _arrived: bool = field(default=True, repr=False)

    def go_to(self, target: Vector) -> None:
        """Fly there, and hover."""
        self.target = target
        self._arrived = False

    @property
    def arrived(self) -> bool:
        """Whether the last waypoint is reached, within 0.2 m and at rest."""
        return self._arrived

    def step(self, dt_s: float) -> None:
        """Move on by ``dt_s`` seconds."""
        if self.target is None:
            return
        away = tuple(goal - here for goal, here in zip(self.target, self.position, strict=True))
        horizontal = math.hypot(away[0], away[1])
        # The fastest speed from which the drone can still brake in time.
        speed = min(self.cruise_m_s, math.sqrt(2 * self.acceleration_m_s2 * 0.6 * horizontal))
        wanted_up = max(-self.climb_m_s, min(self.climb_m_s, 1.2 * away[2]))
        wanted = (
            (away[0] / horizontal * speed, away[1] / horizontal * speed, wanted_up)
            if horizontal > 0.02
            else (0.0, 0.0, wanted_up)
        )
        change = tuple(w - v for w, v in zip(wanted, self.velocity, strict=True))
        size = math.sqrt(sum(c * c for c in change))
        limit = self.acceleration_m_s2 * dt_s
        scale = min(1.0, limit / size) if size > 0 else 0.0
        vx, vy, vz = (v + c * scale for v, c in zip(self.velocity, change, strict=True))
        self.velocity = (vx, vy, vz)
        x, y, z = self.position
        self.position = (x + vx * dt_s, y + vy * dt_s, z + vz * dt_s)
        near = math.dist(self.position, self.target) < 0.2
        slow = math.sqrt(vx * vx + vy * vy + vz * vz) < 0.3
        self._arrived = near and slow

    @property
    def speed_m_s(self) -> float:
        """Horizontal speed."""
        return math.hypot(self.velocity[0], self.velocity[1])

    @property
    def track_deg(self) -> float:
        """Direction over the ground, clockwise from north, 0 to 360."""
        return math.degrees(math.atan2(self.velocity[0], self.velocity[1])) % 360.0
