"""The messages of ASTM F3411-22a as values: what each says, in integers with their unit in the name.

None means "unknown", which the standard has a value for in each field. A value that falls between two steps of a
field's resolution is rounded to the nearest when it is encoded, and one beyond a speed's end is set to that end, as
the standard asks; everything else that a field cannot hold is refused then.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

from wonderland_remote_id.enums import (
    AuthenticationType,
    CategoryEu,
    ClassEu,
    ClassificationType,
    DescriptionType,
    HeightReference,
    HorizontalAccuracy,
    IdType,
    OperationalStatus,
    OperatorLocationType,
    ProtocolVersion,
    SpeedAccuracy,
    UaType,
    VerticalAccuracy,
)

HOUR_MS = 3_600_000
MESSAGE_BYTES = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class BasicId:
    """Who it is.

    ``uas_id`` is text of at most 20 printable ASCII characters for a serial number (ANSI/CTA-2063-A) or a
    registration, the usual 36 characters for a UUID, and 40 hexadecimal digits for a specific session id, of which
    the first two are its type.
    """

    uas_id: str
    id_type: IdType = IdType.SERIAL_NUMBER
    ua_type: UaType = UaType.NONE
    version: ProtocolVersion = ProtocolVersion.F3411_22A


@dataclass(frozen=True, slots=True, kw_only=True)
class Location:
    """Where it is and how it moves.

    Altitudes in steps of 500 mm: ``altitude_mm`` above the WGS-84 ellipsoid, ``pressure_altitude_mm`` against
    1013.25 hPa, ``height_mm`` against ``height_reference``. ``track_cdeg`` is the course over ground from true
    north in steps of 100, ``speed_mm_s`` in steps of 250 (above 63,750: 750), ``vertical_mm_s`` in steps of 500, up
    is positive. ``after_hour_ms`` is the time since the full hour (UTC), in steps of 100, at most 3,600,000.
    """

    lat_e7: int | None = None
    lon_e7: int | None = None
    status: OperationalStatus = OperationalStatus.UNDECLARED
    track_cdeg: int | None = None
    speed_mm_s: int | None = None
    vertical_mm_s: int | None = None
    pressure_altitude_mm: int | None = None
    altitude_mm: int | None = None
    height_mm: int | None = None
    height_reference: HeightReference = HeightReference.TAKEOFF
    horizontal_accuracy: HorizontalAccuracy = HorizontalAccuracy.UNKNOWN
    vertical_accuracy: VerticalAccuracy = VerticalAccuracy.UNKNOWN
    pressure_altitude_accuracy: VerticalAccuracy = VerticalAccuracy.UNKNOWN
    speed_accuracy: SpeedAccuracy = SpeedAccuracy.UNKNOWN
    after_hour_ms: int | None = None
    time_accuracy_ms: int | None = None
    version: ProtocolVersion = ProtocolVersion.F3411_22A


@dataclass(frozen=True, slots=True, kw_only=True)
class Authentication:
    """One page of an authentication message; putting pages together is not the codec's business.

    Page 0 carries ``last_page`` (0–15), ``length`` (bytes of all pages together, at most 255), ``t_ms`` and 17
    bytes of data; pages 1–15 carry 23 bytes and nothing else, and those three fields are None.
    """

    authentication_type: AuthenticationType
    page: int
    data: bytes
    last_page: int | None = None
    length: int | None = None
    t_ms: int | None = None
    version: ProtocolVersion = ProtocolVersion.F3411_22A


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfId:
    """What the operator says that it does: at most 23 printable ASCII characters."""

    text: str
    description_type: DescriptionType | int = DescriptionType.TEXT
    version: ProtocolVersion = ProtocolVersion.F3411_22A


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """Where the operator is, and what is flown how.

    ``area_radius_mm`` in steps of 10,000; altitudes above the WGS-84 ellipsoid in steps of 500. ``t_ms`` is Unix time
    in whole seconds, None where the message has none (protocol versions 0 and 1). Category and class only mean
    anything where ``classification`` is EU.
    """

    operator_lat_e7: int | None = None
    operator_lon_e7: int | None = None
    operator_location: OperatorLocationType = OperatorLocationType.TAKEOFF
    area_count: int = 1
    area_radius_mm: int = 0
    area_ceiling_mm: int | None = None
    area_floor_mm: int | None = None
    classification: ClassificationType = ClassificationType.UNDECLARED
    category: CategoryEu = CategoryEu.UNDECLARED
    uas_class: ClassEu = ClassEu.UNDECLARED
    operator_altitude_mm: int | None = None
    t_ms: int | None = None
    version: ProtocolVersion = ProtocolVersion.F3411_22A


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorId:
    """The operator's registration as it was broadcast: at most 20 printable ASCII characters.

    It may hold the three secret characters of EN 4709-002; they must not be stored or shown, so that the text is
    kept out of ``repr``. `public_operator_id` gives what may go further.
    """

    operator_id: str = field(repr=False)
    operator_id_type: int = 0
    version: ProtocolVersion = ProtocolVersion.F3411_22A


Message: TypeAlias = BasicId | Location | Authentication | SelfId | System | OperatorId


@dataclass(frozen=True, slots=True, kw_only=True)
class Pack:
    """One to nine messages that were broadcast together."""

    messages: tuple[Message, ...]
    version: ProtocolVersion = ProtocolVersion.F3411_22A


def resolve_time(location: Location, received_ms: int) -> int | None:
    """When a position was taken (Unix ms): the moment closest to its reception that has its time after the hour.

    None where the message carries no time. A delay of half an hour or more cannot be told from another hour.
    """
    if location.after_hour_ms is None:
        return None
    t_ms = received_ms - received_ms % HOUR_MS + location.after_hour_ms
    if t_ms - received_ms >= HOUR_MS // 2:
        t_ms -= HOUR_MS
    elif received_ms - t_ms > HOUR_MS // 2:
        t_ms += HOUR_MS
    return t_ms
