"""What an autopilot is doing, from its messages; modes of ArduCopter and PX4 by their meaning here."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.mavlink.messages import ExtendedState, GlobalPosition, Heartbeat, Message

MAX_AGE_MS: Final = 3_000
ARDUPILOT, PX4 = 3, 12
"""MAV_AUTOPILOT."""
_ARMED: Final = 128
_CRITICAL, _FLIGHT_TERMINATION = 5, 8
"""MAV_STATE: from critical on a fail-safe flies."""
_ON_GROUND, _LANDING = 1, 4
"""MAV_LANDED_STATE."""


class Mode(Enum):
    """What a flight mode means to whoever holds a vehicle."""

    HELD = "held"
    """It goes where it was told to, and stays there: GUIDED of ArduCopter, Hold of PX4."""
    LANDING = "landing"
    RETURNING = "returning"
    MISSION = "mission"
    OTHER = "other"
    """Above all the pilot's own."""


ARDUCOPTER_MODES: Final = {3: Mode.MISSION, 4: Mode.HELD, 6: Mode.RETURNING, 9: Mode.LANDING, 21: Mode.RETURNING}
"""By custom_mode: AUTO, GUIDED, RTL, LAND, SMART_RTL."""
PX4_MODES: Final = {3: Mode.HELD, 4: Mode.MISSION, 5: Mode.RETURNING, 6: Mode.LANDING, 9: Mode.LANDING}
"""By the sub-mode of AUTO (4): loiter, mission, return, land, precision landing."""
_PX4_AUTO: Final = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """A vehicle at one moment. ``claim`` is its place as it would be claimed."""

    stack: int
    mode: Mode
    custom_mode: int
    armed: bool
    on_ground: bool
    landing: bool
    failsafe: bool
    claim: Claim
    alt_mm: int
    """Of the same place, above mean sea level."""
    speed_mm_s: int
    down_mm_s: int


class VehicleState:
    """Gathers the messages of one autopilot."""

    def __init__(self) -> None:
        self._heartbeat: Heartbeat | None = None
        self._beat_ms = 0
        self._extended: ExtendedState | None = None
        self._extended_ms = 0
        self._position: GlobalPosition | None = None
        self._position_ms = 0

    def take(self, message: Message, now_ms: int) -> None:
        """A message that arrived now."""
        if isinstance(message, Heartbeat):
            self._heartbeat, self._beat_ms = message, now_ms
        elif isinstance(message, ExtendedState):
            self._extended, self._extended_ms = message, now_ms
        elif isinstance(message, GlobalPosition):
            self._position, self._position_ms = message, now_ms

    @property
    def supported(self) -> bool:
        """Whether it is an autopilot whose modes are known here; True as long as none was heard."""
        return self._heartbeat is None or self._heartbeat.autopilot in {ARDUPILOT, PX4}

    def seen(self, claim: Claim | None, now_ms: int) -> Vehicle | None:
        """The vehicle now; None while its mode, its place or whether it flies is not known."""
        beat, position, extended = self._heartbeat, self._position, self._extended
        if claim is None or beat is None or position is None or extended is None or not self.supported:
            return None
        if now_ms - min(self._beat_ms, self._position_ms, self._extended_ms) > MAX_AGE_MS:
            return None
        return Vehicle(
            stack=beat.autopilot,
            mode=mode_of(beat),
            custom_mode=beat.custom_mode,
            armed=bool(beat.base_mode & _ARMED),
            on_ground=extended.landed_state == _ON_GROUND,
            landing=extended.landed_state == _LANDING,
            failsafe=_CRITICAL <= beat.system_status <= _FLIGHT_TERMINATION and beat.system_status != 7,
            claim=claim,
            alt_mm=position.alt_mm,
            speed_mm_s=round(10 * (position.vx_cm_s**2 + position.vy_cm_s**2 + position.vz_cm_s**2) ** 0.5),
            down_mm_s=10 * position.vz_cm_s,
        )


def mode_of(beat: Heartbeat) -> Mode:
    """The meaning of its flight mode."""
    if beat.autopilot == ARDUPILOT:
        return ARDUCOPTER_MODES.get(beat.custom_mode, Mode.OTHER)
    main, sub = beat.custom_mode >> 16 & 0xFF, beat.custom_mode >> 24 & 0xFF
    return PX4_MODES.get(sub, Mode.OTHER) if main == _PX4_AUTO else Mode.OTHER
