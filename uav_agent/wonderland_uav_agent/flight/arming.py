"""Whether the autopilot may be armed: PX4 asks (3001), ArduPilot is told through a parameter of our Lua script.

PX4 asks the companion computer for each attempt and waits a second for its answer; an answer in the same instant gets
lost there, so it goes 200 ms later. A proof takes longer than that: the first attempt is answered with *not yet*, and
the one after the verdict is accepted.
"""

from __future__ import annotations

from typing import Final

from wonderland_uav_agent.flight.settings import FlightSettings
from wonderland_uav_agent.flight.vehicle import ARDUPILOT
from wonderland_uav_agent.position.mavlink.messages import (
    ArmingAnswered,
    Heartbeat,
    Message,
    Parameter,
    SetParameter,
)

ANSWER_AFTER_MS: Final = 200
ACCEPTED, NOT_YET, DENIED = 0, 1, 2
"""MAV_RESULT."""
NO_REASON, GENERIC = 0, 1
PERMIT: Final = "WNDL_PERMIT"
"""Seconds for which the Lua script lets the vehicle be armed; it counts down on the autopilot."""
WITHDRAWN: Final = -1
RETRY_MS: Final = 500


class Arming:
    """Of one drone. Pure: messages in, messages out."""

    def __init__(self, settings: FlightSettings) -> None:
        self._settings = settings
        self._until_ms = 0
        self._answers: list[tuple[int, int]] = []
        self._has_script = False
        self._tells = False
        """Whether the script has yet to hear how it stands."""
        self._tell_at_ms = 0

    def permit(self, until_ms: int) -> None:
        """A committed verdict lets it take off."""
        self._until_ms, self._tells, self._tell_at_ms = until_ms, True, 0

    def withdraw(self) -> None:
        """It has taken off, or the permission is over."""
        self._until_ms, self._tells, self._tell_at_ms = 0, True, 0

    def take(self, message: Message) -> None:
        """What the autopilot says of itself, and of the script's parameter."""
        if isinstance(message, Heartbeat):
            self._has_script = message.autopilot == ARDUPILOT
        elif isinstance(message, Parameter) and message.name == PERMIT and message.value != 0:
            self._tells = self._tells and (message.value > 0) != (self._until_ms > 0)

    def asked(self, now_ms: int, *, at_a_pad: bool, known: bool) -> bool:
        """The autopilot asks whether it may be armed; returns whether a proof has to be begun."""
        if now_ms < self._until_ms:
            result = ACCEPTED
        elif known and not at_a_pad:
            result = ACCEPTED if self._settings.take_off_elsewhere == "allow" else DENIED
        else:
            result = NOT_YET
        self._answers.append((now_ms + ANSWER_AFTER_MS, result))
        return result == NOT_YET and at_a_pad

    def due(self, system: int, now_ms: int) -> list[ArmingAnswered | SetParameter]:
        """What to send now."""
        out: list[ArmingAnswered | SetParameter] = []
        while self._answers and self._answers[0][0] <= now_ms:
            _, result = self._answers.pop(0)
            left_s = max(1, (self._until_ms - now_ms) // 1_000)
            if result == ACCEPTED:
                out.append(ArmingAnswered(system, ACCEPTED, NO_REASON, left_s))
            else:
                out.append(ArmingAnswered(system, result, GENERIC, 0))
        if self._has_script and self._tells and now_ms >= self._tell_at_ms:
            self._tell_at_ms = now_ms + RETRY_MS
            left_s = (self._until_ms - now_ms) // 1_000
            out.append(SetParameter(system, PERMIT, float(left_s if left_s > 0 else WITHDRAWN)))
        return out
