"""Tells the autopilot what it broadcasts and cannot know: BASIC_ID, OPERATOR_ID, SELF_ID and SYSTEM. Pure.

ArduPilot keeps what it is told last, repeats it to its transmitter, and where `DID_OPTIONS` has 1 does not arm without
a SYSTEM of the last three seconds. Ground stations tell it the same: one of the two should.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final

from wonderland.proofs.records.sessions import Claim
from wonderland_remote_id import (
    BasicId,
    CategoryEu,
    ClassEu,
    ClassificationType,
    OperatorId,
    OperatorLocationType,
    RemoteIdError,
    SelfId,
    System,
    UaType,
    encode,
)
from wonderland_uav_agent.broadcasts.settings import OpenDroneIdSettings
from wonderland_uav_agent.broadcasts.source import BroadcastError
from wonderland_uav_agent.position.mavlink.messages import Heartbeat, Message, Outgoing, RemoteIdTold, Sender

_log = logging.getLogger(__name__)

SYSTEM_MS: Final = 1_000
STATIC_MS: Final = 3_000
"""As often as ArduPilot repeats them."""
ARMED: Final = 128


class Telling:
    """Part of the crew of a link. Raises BroadcastError where the certificate's id cannot be broadcast."""

    def __init__(
        self,
        settings: OpenDroneIdSettings,
        uav_id: str,
        *,
        followed: Callable[[], Sender | None],
        claim: Callable[[int], Claim | None],
    ) -> None:
        """``followed``: the autopilot; ``claim``: where it is at a time."""
        self._settings = settings
        self._followed, self._claim = followed, claim
        told: list[BasicId | OperatorId | SelfId] = [BasicId(uas_id=uav_id, ua_type=UaType[settings.aircraft.upper()])]
        if settings.public_operator_id is not None:
            told.append(OperatorId(operator_id=settings.public_operator_id))
        if settings.description is not None:
            told.append(SelfId(text=settings.description))
        try:
            for message in told:
                encode(message)
        except RemoteIdError as error:
            raise BroadcastError(f"[open_drone_id]: {uav_id} cannot be broadcast as a serial number: {error}") from None
        self._static = tuple(told)
        self._static_ms = self._system_ms = 0
        self._take_off: tuple[int, int, int] | None = None
        self._said = False
        place = settings.operator
        if place is not None:
            self._take_off = (round(place.lat * 1e7), round(place.lon * 1e7), round(place.height_m * 1e3))

    def take(self, message: Message, now_ms: int) -> None:
        """A message of the autopilot's: where it is before it is armed, it takes off."""
        if self._settings.operator is not None or not isinstance(message, Heartbeat):
            return
        armed = bool(message.base_mode & ARMED)
        if armed and self._take_off is None and not self._said:
            self._said = True
            _log.warning(
                "it was armed before this agent knew where it stands: OPEN_DRONE_ID_SYSTEM is not told until it lands "
                "([open_drone_id] operator = … names a fixed place)"
            )
        claim = None if armed else self._claim(now_ms)
        if claim is not None:
            self._take_off = (claim.lat_e7, claim.lon_e7, claim.height_mm)

    def outgoing(self, now_ms: int) -> list[Outgoing]:
        """What is due to be told."""
        followed, out = self._followed(), list[Outgoing]()
        if followed is None:
            return out
        if not 0 <= now_ms - self._static_ms < STATIC_MS:
            self._static_ms = now_ms
            out += [RemoteIdTold(followed.system, message) for message in self._static]
        if self._take_off is not None and not 0 <= now_ms - self._system_ms < SYSTEM_MS:
            self._system_ms = now_ms
            out.append(RemoteIdTold(followed.system, self._system(self._take_off, now_ms)))
        return out

    def _system(self, place: tuple[int, int, int], now_ms: int) -> System:
        settings = self._settings
        lat_e7, lon_e7, height_mm = place
        eu, class_eu = settings.category != "undeclared", settings.class_eu
        fixed = settings.operator is not None
        return System(
            operator_lat_e7=lat_e7,
            operator_lon_e7=lon_e7,
            operator_altitude_mm=height_mm,
            operator_location=OperatorLocationType.FIXED if fixed else OperatorLocationType.TAKEOFF,
            classification=ClassificationType.EU if eu else ClassificationType.UNDECLARED,
            category=CategoryEu[settings.category.upper()],
            uas_class=ClassEu.UNDECLARED if class_eu is None else ClassEu(class_eu + 1),
            t_ms=now_ms,
        )
