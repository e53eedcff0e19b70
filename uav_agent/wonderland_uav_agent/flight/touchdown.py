"""Whether one that lands stands on the ground, where its autopilot does not notice. Pure.

A receiver that wanders moves the place that an autopilot wants to hold, and on the ground it leans towards it in vain.
ArduPilot takes nobody for landed who wants to lean by more than 15°: in wind that lasted for minutes in simulation. A
permission that ended meanwhile would lift the drone off its pad again.
"""

from __future__ import annotations

from typing import Final

from wonderland_uav_agent.flight.vehicle import Vehicle

STANDS_MS: Final = 5_000
"""Nobody who comes down rests for so long."""
STILL_MM_S: Final = 300
SINKS_MM_S: Final = 80
"""ArduPilot's slowest way down is 100."""
SHARE: Final = 0.75
"""Of the gate's height, come down since: the heights that autopilots tell are metres off, changes are not."""


class TouchDown:
    """Of one landing."""

    def __init__(self) -> None:
        self._from_mm = self._way_mm = 0.0
        self._since_ms: int | None = None

    def begin(self, above_mm: float, gate_mm: float) -> None:
        """It was told to land, at this height above the pad."""
        self._from_mm, self._way_mm, self._since_ms = above_mm, SHARE * gate_mm, None

    def look(self, vehicle: Vehicle, above_mm: float, now_ms: int) -> bool:
        """Whether it stands by now."""
        still = vehicle.speed_mm_s <= STILL_MM_S and abs(vehicle.down_mm_s) <= SINKS_MM_S
        if not still or self._from_mm - above_mm < self._way_mm:
            self._since_ms = None
            return False
        if self._since_ms is None:
            self._since_ms = now_ms
        return now_ms - self._since_ms >= STANDS_MS
