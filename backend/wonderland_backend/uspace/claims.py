"""What a drone claims, in the terms of F3411-22a, from wherever it comes: a pad's receiver, a test, another system.

None is "unknown" everywhere here; the standard's special values are put in when it is sent. The values are the
drone's own. Nothing that we measured ever takes their place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final

import orjson
from uas_standards.astm.f3411.v22a import constants
from uas_standards.astm.f3411.v22a.api import (
    HorizontalAccuracy,
    OperatorLocationAltitudeType,
    RIDHeightReference,
    RIDOperationalStatus,
    SpeedAccuracy,
    UAClassificationEUCategory,
    UAClassificationEUClass,
    UAType,
    VerticalAccuracy,
)

from wonderland.telemetry import Track
from wonderland_backend.http.times import rfc3339
from wonderland_backend.uspace.geo import E7
from wonderland_remote_id.enums import HorizontalAccuracy as HorizontalClass
from wonderland_remote_id.enums import SpeedAccuracy as SpeedClass
from wonderland_remote_id.enums import VerticalAccuracy as VerticalClass

UNKNOWN_ALTITUDE_M: Final = -1000
COARSEST_TIME_ACCURACY_S: Final = 1.5
"""Where the accuracy of a time is unknown, or a position is dated when it was heard: the coarsest class of broadcasts.

Broadcasts tell unknown as 0; F3411's network interface demands a number and has none for unknown: 0 would be perfect.
"""
MAX_LATE_MS: Final = 60_000
MAX_EARLY_MS: Final = 2_000
"""A drone whose clock is further off says nothing about when it was where; the time of hearing does."""
_TYPES: Final = tuple(UAType)
_CATEGORIES: Final = tuple(UAClassificationEUCategory)
_CLASSES: Final = tuple(UAClassificationEUClass)
_PLACES: Final = {
    "takeoff": OperatorLocationAltitudeType.Takeoff,
    "live_gnss": OperatorLocationAltitudeType.Dynamic,
    "fixed": OperatorLocationAltitudeType.Fixed,
}
_REFERENCES: Final = {"takeoff": RIDHeightReference.TakeoffLocation, "ground": RIDHeightReference.GroundLevel}
_STATUSES: Final = {
    "undeclared": RIDOperationalStatus.Undeclared,
    "ground": RIDOperationalStatus.Ground,
    "airborne": RIDOperationalStatus.Airborne,
    "emergency": RIDOperationalStatus.Emergency,
    "remote_id_system_failure": RIDOperationalStatus.RemoteIDSystemFailure,
}
# By class of the broadcast; the names are in the same order in both.
_HORIZONTAL: Final = tuple(each for each in HorizontalAccuracy if each is not HorizontalAccuracy.HA10NMPlus)
_VERTICAL: Final = tuple(each for each in VerticalAccuracy if each is not VerticalAccuracy.VA150mPlus)
_SPEED: Final = tuple(each for each in SpeedAccuracy if each is not SpeedAccuracy.SA10mpsPlus)
_UUID: Final = re.compile(r"[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}\Z")
_SESSION: Final = re.compile(r"[0-9a-fA-F]{40}\Z")
_REGISTRATION: Final = re.compile(r"[A-Z0-9]{1,2}\.[A-Z0-9.]+\Z")


@dataclass(slots=True)
class State:
    """A claimed position and movement: times Unix ms, positions degrees × 10⁷, lengths m, speeds m/s, degrees."""

    t_ms: int
    lat: int
    lng: int
    time_accuracy_s: float = COARSEST_TIME_ACCURACY_S
    altitude_m: float | None = None
    pressure_altitude_m: float | None = None
    height_m: float | None = None
    height_reference: RIDHeightReference = RIDHeightReference.TakeoffLocation
    accuracy_h: HorizontalAccuracy = HorizontalAccuracy.HAUnknown
    accuracy_v: VerticalAccuracy = VerticalAccuracy.VAUnknown
    track_deg: float | None = None
    speed_m_s: float | None = None
    vertical_m_s: float | None = None
    speed_accuracy: SpeedAccuracy = SpeedAccuracy.SAUnknown
    status: RIDOperationalStatus = RIDOperationalStatus.Undeclared
    extrapolated: bool = False
    _position: orjson.Fragment | None = field(default=None, repr=False, compare=False)
    _recent: orjson.Fragment | None = field(default=None, repr=False, compare=False)

    def position(self) -> orjson.Fragment:
        """`RIDAircraftPosition`, written once."""
        if self._position is None:
            content: dict[str, Any] = {
                "lat": self.lat / E7,
                "lng": self.lng / E7,
                "alt": _or(self.altitude_m, UNKNOWN_ALTITUDE_M),
                "accuracy_h": self.accuracy_h,
                "accuracy_v": self.accuracy_v,
                "extrapolated": self.extrapolated,
                "pressure_altitude": _or(self.pressure_altitude_m, UNKNOWN_ALTITUDE_M),
            }
            if self.height_m is not None:
                content["height"] = {"distance": self.height_m, "reference": self.height_reference}
            self._position = orjson.Fragment(orjson.dumps(content))
        return self._position

    def state(self) -> dict[str, Any]:
        """`RIDAircraftState`, with the standard's values for what is unknown or beyond its bounds."""
        climb = constants.MaxAbsVerticalSpeed
        return {
            "timestamp": time_of(self.t_ms),
            "timestamp_accuracy": self.time_accuracy_s,
            "operational_status": self.status,
            "position": self.position(),
            "track": constants.SpecialTrackDirection if self.track_deg is None else self.track_deg % 360,
            "speed": constants.SpecialSpeed if self.speed_m_s is None else min(constants.MaxSpeed, self.speed_m_s),
            "speed_accuracy": self.speed_accuracy,
            "vertical_speed": constants.SpecialVerticalSpeed
            if self.vertical_m_s is None
            else max(-climb, min(climb, self.vertical_m_s)),
        }

    def recent(self) -> orjson.Fragment:
        """`RIDRecentAircraftPosition`, written once: it is told sixty times."""
        if self._recent is None:
            self._recent = orjson.Fragment(orjson.dumps({"time": time_of(self.t_ms), "position": self.position()}))
        return self._recent


@dataclass(frozen=True, slots=True)
class Operator:
    """Who flies, from where. Personal data: kept in memory as long as the flight, shown by role."""

    registration: str | None = None
    lat: int | None = None
    lng: int | None = None
    altitude_m: float | None = None
    place: OperatorLocationAltitudeType | None = None


@dataclass(frozen=True, slots=True)
class Details:
    """What stays the same over a flight."""

    uas_id: dict[str, str]
    """One or more of serial_number, registration_id, utm_id, specific_session_id."""
    aircraft_type: UAType = UAType.NotDeclared
    operator: Operator = Operator()
    eu_category: UAClassificationEUCategory | None = None
    eu_class: UAClassificationEUClass | None = None
    description: str | None = None
    authentication: dict[str, Any] | None = None

    def content(self, flight_id: str) -> dict[str, Any]:
        """`RIDFlightDetails`; what is unknown is left out."""
        found: dict[str, Any] = {"id": flight_id, "uas_id": self.uas_id}
        operator = self.operator
        if operator.registration:
            found["operator_id"] = operator.registration
        if operator.lat is not None and operator.lng is not None:
            location: dict[str, Any] = {"position": {"lat": operator.lat / E7, "lng": operator.lng / E7}}
            if operator.altitude_m is not None:
                location["altitude"] = {"value": operator.altitude_m, "reference": "W84", "units": "M"}
            if operator.place is not None:
                location["altitude_type"] = operator.place
            found["operator_location"] = location
        if self.eu_category is not None or self.eu_class is not None:
            found["eu_classification"] = {
                "category": self.eu_category or UAClassificationEUCategory.EUCategoryUndefined,
                "class": self.eu_class or UAClassificationEUClass.EUClassUndefined,
            }
        if self.description:
            found["operation_description"] = self.description
        if self.authentication is not None:
            found["auth_data"] = self.authentication
        return found


def time_of(t_ms: int) -> dict[str, str]:
    """`Time`."""
    return {"value": rfc3339(t_ms), "format": "RFC3339"}


def state_of(body: Track, heard_ms: int) -> State:
    """A position that a pad heard, at `heard_ms` (Unix ms)."""
    claimed_ms: Any = body.claim_t_ms
    t_ms, time_accuracy_s = heard_ms, COARSEST_TIME_ACCURACY_S
    if claimed_ms is not None and -MAX_EARLY_MS <= heard_ms - claimed_ms <= MAX_LATE_MS:
        t_ms = claimed_ms
        if body.time_accuracy_ms:
            time_accuracy_s = body.time_accuracy_ms / 1000
    return State(
        t_ms=t_ms,
        lat=body.lat_e7,
        lng=body.lon_e7,
        time_accuracy_s=time_accuracy_s,
        altitude_m=_m(body.height_mm),
        pressure_altitude_m=_m(body.pressure_mm),
        height_m=_m(body.above_mm),
        height_reference=_REFERENCES[body.above or "takeoff"],
        accuracy_h=_HORIZONTAL[HorizontalClass.of_mm(body.accuracy_mm)],
        accuracy_v=_VERTICAL[VerticalClass.of_mm(body.height_accuracy_mm)],
        track_deg=body.track_cdeg / 100 if body.track_cdeg is not None else None,
        speed_m_s=_m(body.speed_mm_s),
        vertical_m_s=_m(body.vertical_mm_s),
        speed_accuracy=_SPEED[SpeedClass.of_mm_s(body.speed_accuracy_mm_s)],
        status=_STATUSES.get(body.status or "", RIDOperationalStatus.Undeclared),
    )


def details_of(body: Track) -> Details:
    """What else a drone said."""
    place = body.operator_place
    return Details(
        uas_id=uas_id(body.uav_id),
        aircraft_type=_TYPES[body.ua_type or 0],
        operator=Operator(
            registration=body.operator_id,
            lat=body.operator_lat_e7,
            lng=body.operator_lon_e7,
            altitude_m=_m(body.operator_height_mm),
            place=_PLACES[place] if place is not None else None,
        ),
        eu_category=_CATEGORIES[body.eu_category] if body.eu_category is not None else None,
        eu_class=_CLASSES[body.eu_class] if body.eu_class is not None else None,
        description=body.description,
    )


def uas_id(text: str) -> dict[str, str]:
    """An identifier as `UASID` has it, told apart by its form."""
    if _UUID.match(text):
        return {"utm_id": text}
    if _SESSION.match(text):
        return {"specific_session_id": f"{text[:2]}-{text[2:]}"}
    if _REGISTRATION.match(text):
        return {"registration_id": text}
    return {"serial_number": text}


def _m(mm: int | None) -> float | None:
    return None if mm is None else mm / 1000


def _or(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value
