"""Flights as other systems tell them, and as tests inject them, checked where they come in.

Both forms are read here: F3411 wraps times and operators' altitudes in objects, the injection interface does not.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError
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

from wonderland_backend.http.times import unix_ms
from wonderland_backend.uspace.claims import UNKNOWN_ALTITUDE_M, Details, Operator, State
from wonderland_backend.uspace.dss.models import Foreign, Latitude, Longitude, Point
from wonderland_backend.uspace.geo import E7
from wonderland_remote_id.operators import public_operator_id

MAX_FLIGHTS: Final = 5_000
MAX_POSITIONS: Final = 1_000
_FORBIDDEN: Final = frozenset("\0\t\r\n#%/:?@[\\]")


def _flight_id(text: str) -> str:
    if _FORBIDDEN & set(text):
        raise ValueError("holds a character that a flight's id may not have")
    return text


def _time_ms(value: object) -> object:
    """From a time in RFC 3339, bare or in its object."""
    text = value.get("value") if isinstance(value, dict) else value
    if not isinstance(text, str) or len(text) > 64:
        raise ValueError("is no time")
    return unix_ms(text)


def _metres(value: object) -> object:
    """From an altitude in metres, bare or in its object."""
    return value.get("value") if isinstance(value, dict) else value


def _unless(special: float) -> BeforeValidator:
    """A number, or None where it is the standard's value for "unknown"."""
    return BeforeValidator(lambda value: None if value == special else value)


FlightId = Annotated[str, Field(min_length=1, max_length=255), AfterValidator(_flight_id)]
TimeMs = Annotated[int, BeforeValidator(_time_ms)]
Metres = Annotated[float | None, Field(ge=-8_000, le=100_000), _unless(UNKNOWN_ALTITUDE_M)]
Text = Annotated[str, Field(max_length=500)]


class Height(Foreign):
    """`RIDHeight`."""

    distance: Metres = None
    reference: RIDHeightReference


class Position(Foreign):
    """`RIDAircraftPosition`."""

    lat: Latitude | None = None
    lng: Longitude | None = None
    alt: Metres = None
    accuracy_h: HorizontalAccuracy | None = None
    accuracy_v: VerticalAccuracy | None = None
    extrapolated: bool | None = None
    pressure_altitude: Metres = None
    height: Height | None = None


class AircraftState(Foreign):
    """`RIDAircraftState`."""

    timestamp: TimeMs
    timestamp_accuracy: Annotated[float, Field(ge=0, le=3_600)] | None = None
    operational_status: RIDOperationalStatus | None = None
    position: Position
    track: Annotated[float | None, Field(ge=0, le=360), _unless(constants.SpecialTrackDirection)] = None
    speed: Annotated[float | None, Field(ge=0, le=1_000), _unless(constants.SpecialSpeed)] = None
    speed_accuracy: SpeedAccuracy | None = None
    vertical_speed: Annotated[float | None, Field(ge=-1_000, le=1_000), _unless(constants.SpecialVerticalSpeed)] = None
    height: Height | None = None


class RecentPosition(Foreign):
    """`RIDRecentAircraftPosition`."""

    time: TimeMs
    position: Position


class ForeignFlight(Foreign):
    """`RIDFlight`, as far as it has positions."""

    id: FlightId
    aircraft_type: UAType = UAType.NotDeclared
    current_state: AircraftState | None = None
    recent_positions: Annotated[list[RecentPosition], Field(max_length=MAX_POSITIONS)] | None = None

    def states(self) -> list[State]:
        """Its states in order of time; positions that are unknown are left out."""
        found = [state_of(each.time, each.position) for each in self.recent_positions or ()]
        current = self.current_state
        if current is not None:
            found = [each for each in found if each is None or each.t_ms < current.timestamp]
            found.append(current_state_of(current))
        return sorted((each for each in found if each is not None), key=lambda each: each.t_ms)


class FlightsAnswer(Foreign):
    """`GetFlightsResponse`; each flight is looked at by itself, so that a bad one is left out alone."""

    timestamp: TimeMs
    flights: Annotated[list[Any], Field(max_length=MAX_FLIGHTS)] | None = None
    no_isas_present: bool | None = None

    def good(self) -> tuple[list[ForeignFlight], int]:
        """The flights that can be used, and how many cannot."""
        found = []
        for each in self.flights or ():
            try:
                found.append(ForeignFlight.model_validate(each))
            except ValidationError:
                continue
        return found, len(self.flights or ()) - len(found)


class UasId(Foreign):
    """`UASID`."""

    serial_number: Text | None = None
    registration_id: Text | None = None
    utm_id: Text | None = None
    specific_session_id: Text | None = None


class OperatorAltitude(Foreign):
    """Where an operator's altitude stands in the injection interface."""

    altitude: Annotated[Metres, BeforeValidator(_metres)] = None
    altitude_type: OperatorLocationAltitudeType | None = None


class OperatorLocation(Foreign):
    """`OperatorLocation`; in the injection interface, a point."""

    position: Point | None = None
    lat: Latitude | None = None
    lng: Longitude | None = None
    altitude: Annotated[Metres, BeforeValidator(_metres)] = None
    altitude_type: OperatorLocationAltitudeType | None = None


class Classification(Foreign):
    """`UAClassificationEU`."""

    category: UAClassificationEUCategory | None = None
    # The standard's name is a word of Python.
    uas_class: Annotated[UAClassificationEUClass | None, Field(alias="class")] = None


class AuthData(Foreign):
    """`RIDAuthData`."""

    format: Annotated[int, Field(ge=0, le=15)] = 0
    data: Annotated[str, Field(max_length=4_096)] = ""


class ForeignDetails(Foreign):
    """`RIDFlightDetails`."""

    id: FlightId
    uas_id: UasId | None = None
    serial_number: Text | None = None
    registration_number: Text | None = None
    operator_id: Text | None = None
    operator_location: OperatorLocation | None = None
    operator_altitude: OperatorAltitude | None = None
    operation_description: Annotated[str, Field(max_length=2_000)] | None = None
    eu_classification: Classification | None = None
    auth_data: AuthData | None = None

    def details(self, aircraft_type: UAType = UAType.NotDeclared) -> Details:
        """As flights have them; an operator's secret characters go no further."""
        ids = self.uas_id.model_dump(exclude_none=True) if self.uas_id is not None else {}
        ids.setdefault("serial_number", self.serial_number)
        ids.setdefault("registration_id", self.registration_number)
        category, eu_class = None, None
        if self.eu_classification is not None:
            category, eu_class = self.eu_classification.category, self.eu_classification.uas_class
        return Details(
            uas_id={name: text for name, text in ids.items() if text},
            aircraft_type=aircraft_type,
            operator=self._operator(),
            eu_category=category,
            eu_class=eu_class,
            description=self.operation_description or None,
            authentication=self.auth_data.model_dump() if self.auth_data is not None else None,
        )

    def _operator(self) -> Operator:
        place = self.operator_location or OperatorLocation()
        point = place.position or place
        height = self.operator_altitude or place
        return Operator(
            registration=public_operator_id(self.operator_id) if self.operator_id else None,
            lat=_e7(point.lat),
            lng=_e7(point.lng),
            altitude_m=height.altitude,
            place=height.altitude_type,
        )


class DetailsAnswer(Foreign):
    """`GetFlightDetailsResponse`."""

    details: ForeignDetails


def current_state_of(state: AircraftState) -> State | None:
    """A state with its movement; None where its position is unknown."""
    found = state_of(state.timestamp, state.position, state.height)
    if found is not None:
        if state.timestamp_accuracy is not None:
            found.time_accuracy_s = state.timestamp_accuracy
        found.track_deg, found.speed_m_s, found.vertical_m_s = state.track, state.speed, state.vertical_speed
        found.speed_accuracy = state.speed_accuracy or SpeedAccuracy.SAUnknown
        found.status = state.operational_status or RIDOperationalStatus.Undeclared
    return found


def state_of(t_ms: int, position: Position, height: Height | None = None) -> State | None:
    """A position; None where it is unknown: left out, or 0°, 0°."""
    if position.lat is None or position.lng is None or (position.lat == 0 and position.lng == 0):
        return None
    above = position.height or height
    return State(
        t_ms=t_ms,
        lat=round(position.lat * E7),
        lng=round(position.lng * E7),
        altitude_m=position.alt,
        pressure_altitude_m=position.pressure_altitude,
        height_m=above.distance if above is not None else None,
        height_reference=above.reference if above is not None else RIDHeightReference.TakeoffLocation,
        accuracy_h=position.accuracy_h or HorizontalAccuracy.HAUnknown,
        accuracy_v=position.accuracy_v or VerticalAccuracy.VAUnknown,
        extrapolated=bool(position.extrapolated),
    )


def _e7(degrees: float | None) -> int | None:
    return None if degrees is None else round(degrees * E7)
