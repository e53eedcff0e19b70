"""Orders as MAVLink commands that are acknowledged, given again while they are not, and reported where they fail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland_uav_agent.flight.approach import GoTo, Land, Return
from wonderland_uav_agent.flight.vehicle import ARDUPILOT, PX4, Mode, Vehicle
from wonderland_uav_agent.position.mavlink.messages import Acknowledged, Command, Reposition

NAV_RETURN_TO_LAUNCH, NAV_LAND, NAV_PRECLAND, DO_SET_MODE, DO_REPOSITION = 20, 21, 23, 176, 192
_CUSTOM_MODE: Final = 1.0
HELD_MODES: Final = {ARDUPILOT: (4.0, 0.0), PX4: (4.0, 3.0)}
"""GUIDED; AUTO, and loiter within it."""
ACCEPTED, IN_PROGRESS = 0, 5
RESULTS: Final = ("accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress", "cancelled")
RETRY_MS: Final = 400
TRIES: Final = 6


@dataclass
class _Given:
    command: int
    sent: Command | Reposition
    due_ms: int
    instead: Command | None = None
    """Asked for where the autopilot refuses that: at least to stop."""
    tries: int = 0


class Orders:
    """One order at a time: a newer one takes the older one's place."""

    def __init__(self) -> None:
        self._given: _Given | None = None

    def give(
        self, order: GoTo | Land | Return, vehicle: Vehicle, system: int, now_ms: int, *, precise: bool = False
    ) -> None:
        """To the autopilot of ``system``. ``precise``: it is being told where the pad is, and shall land by that."""
        number, instead = DO_REPOSITION, None
        if isinstance(order, GoTo):
            # Heights are above the ellipsoid here, above mean sea level there; the vehicle has both.
            alt_mm = order.height_mm + vehicle.alt_mm - vehicle.claim.height_mm
            sent: Command | Reposition = Reposition(system, order.lat_e7, order.lon_e7, alt_mm)
            if vehicle.mode is not Mode.HELD:
                mode, sub_mode = HELD_MODES[vehicle.stack]
                instead = Command(system, DO_SET_MODE, (_CUSTOM_MODE, mode, sub_mode, 0.0, 0.0, 0.0, 0.0))
        else:
            number = NAV_LAND if isinstance(order, Land) else NAV_RETURN_TO_LAUNCH
            if number == NAV_LAND and precise and vehicle.stack == PX4:  # ArduPilot's LAND is both
                number = NAV_PRECLAND
            sent = Command(system, number, (0.0,) * 7)
        self._given = _Given(number, sent, now_ms, instead)

    def forget(self) -> None:
        """Nothing more is wanted of the autopilot."""
        self._given = None

    def due(self, now_ms: int) -> tuple[list[Command | Reposition], str]:
        """What to send now, and what to say where an order was never answered."""
        given = self._given
        if given is None or now_ms < given.due_ms:
            return [], ""
        if given.tries == TRIES:
            self._given = None
            return [], f"the autopilot does not answer command {given.command}"
        given.tries += 1
        given.due_ms = now_ms + RETRY_MS
        return [given.sent], ""

    def answered(self, message: Acknowledged, now_ms: int) -> str:
        """The autopilot's word; the text says why it does not obey."""
        given = self._given
        if given is None or message.command != given.command or message.result == IN_PROGRESS:
            return ""
        self._given = None
        if message.result == ACCEPTED:
            return ""
        if given.instead is not None:
            self._given = _Given(DO_SET_MODE, given.instead, now_ms)
        word = RESULTS[message.result] if message.result < len(RESULTS) else str(message.result)
        return f"the autopilot answers command {given.command} with {word}"
