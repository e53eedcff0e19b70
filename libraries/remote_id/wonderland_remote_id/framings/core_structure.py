"""The structure ``ODID_UAS_Data`` of opendroneid-core-c, the reference implementation, as DroneScout receivers send it.

Little-endian with the alignment of x86-64 and AArch64. After the messages come flags that say which of them are there.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, TypeVar

from wonderland_remote_id.decoding import EPOCH_2019_MS
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
    SpeedAccuracy,
    UaType,
    VerticalAccuracy,
)
from wonderland_remote_id.errors import FieldError, FramingError
from wonderland_remote_id.messages import Authentication, BasicId, Location, Message, OperatorId, SelfId, System

BYTES: Final = 914
"""Up to and including the flags; the compiler fills it up to 920."""

Member = TypeVar("Member", bound=IntEnum)
_BASIC_ID: Final = struct.Struct("<II20s")
_LOCATION: Final = struct.Struct("<IfffddffIfIIIIIf")
_PAGE: Final = struct.Struct("<B3xIBB2xI23s")
_SELF_ID: Final = struct.Struct("<I23s")
_SYSTEM: Final = struct.Struct("<IIddHHffIIfI")
_OPERATOR_ID: Final = struct.Struct("<I20s")
_AT_BASIC, _AT_LOCATION, _AT_PAGES, _AT_SELF, _AT_SYSTEM, _AT_OPERATOR, _AT_FLAGS = 0, 64, 136, 776, 808, 864, 892
_PAGE_STEP: Final = 40
_BASIC_STEP: Final = 32
_PAGES: Final = 16


def parse_core_structure(data: bytes) -> list[Message]:
    """The messages that the structure's flags call valid. Raises `RemoteIdError`."""
    if not BYTES <= len(data) <= 1024:
        raise FramingError(f"a structure of {len(data)} bytes; ODID_UAS_Data with 16 pages has {BYTES} to 920")
    flags = data[_AT_FLAGS:BYTES]
    messages: list[Message] = [
        _basic_id(_BASIC_ID.unpack_from(data, _AT_BASIC + number * _BASIC_STEP)) for number in range(2) if flags[number]
    ]
    if flags[2]:
        messages.append(_location(_LOCATION.unpack_from(data, _AT_LOCATION)))
    if flags[20]:
        system = _system(_SYSTEM.unpack_from(data, _AT_SYSTEM))
        messages.append(system)
    if flags[21]:
        kind, text = _OPERATOR_ID.unpack_from(data, _AT_OPERATOR)
        messages.append(OperatorId(operator_id=_text(text, "operator id"), operator_id_type=kind & 0xFF))
    if flags[19]:
        kind, text = _SELF_ID.unpack_from(data, _AT_SELF)
        description = kind if kind > 200 else _member(DescriptionType, kind, "description type")
        messages.append(SelfId(text=_text(text, "text"), description_type=description))
    for page in range(_PAGES):
        if flags[3 + page] and len(messages) < 9:
            messages.append(_page(_PAGE.unpack_from(data, _AT_PAGES + page * _PAGE_STEP), page))
    return messages


def _member(members: type[Member], value: int, field: str) -> Member:
    try:
        return members(value)
    except ValueError:
        raise FieldError(field, f"{value} is reserved") from None


def _text(raw: bytes, field: str) -> str:
    text = raw.split(b"\0", 1)[0]
    if not (text.isascii() and (decoded := text.decode("ascii")).isprintable()):
        raise FieldError(field, "holds characters that are no printable ASCII")
    return decoded


def _basic_id(values: tuple[int, int, bytes]) -> BasicId:
    ua_type, id_type, raw = values
    kind = _member(IdType, id_type, "id type")
    if kind is IdType.UTM_UUID:
        text = raw[:16].hex()
    elif kind is IdType.SPECIFIC_SESSION:
        text = raw.hex()
    else:
        text = _text(raw, "UAS id")
    return BasicId(uas_id=text, id_type=kind, ua_type=_member(UaType, ua_type, "aircraft type"))


def _milli(value: float, field: str, minimum: float, maximum: float) -> int | None:
    """Thousandths of a value within bounds; None beyond them, which is how the structure says "unknown"."""
    if value != value:  # noqa: PLR0124 - not a number
        raise FieldError(field, "is not a number")
    return round(value * 1000) if minimum <= value <= maximum else None


def _altitude(value_m: float, field: str) -> int | None:
    return _milli(value_m, field, -999.5, 31_767.5)


def _position(lat: float, lon: float, whose: str) -> tuple[int | None, int | None]:
    if lat == 0 and lon == 0:
        return None, None
    if not abs(lat) <= 90:
        raise FieldError(f"{whose}latitude", f"{lat}° is beyond ±90°")
    if not abs(lon) <= 180:
        raise FieldError(f"{whose}longitude", f"{lon}° is beyond ±180°")
    return round(lat * 1e7), round(lon * 1e7)


def _location(values: tuple[float, ...]) -> Location:
    status, track, speed, vertical, lat, lon, pressure, geodetic, reference, height = values[:10]
    horizontal, altitude_accuracy, barometer, speed_accuracy, quality, seconds = values[10:]
    lat_e7, lon_e7 = _position(lat, lon, "")
    track_mdeg = _milli(track, "track", 0, 360)
    return Location(
        lat_e7=lat_e7,
        lon_e7=lon_e7,
        status=_member(OperationalStatus, int(status), "status"),
        track_cdeg=None if track_mdeg is None else (track_mdeg + 500) // 1000 % 360 * 100,
        speed_mm_s=_milli(speed, "speed", 0, 254.25),
        vertical_mm_s=_milli(vertical, "vertical speed", -62, 62),
        pressure_altitude_mm=_altitude(pressure, "pressure altitude"),
        altitude_mm=_altitude(geodetic, "altitude"),
        height_mm=_altitude(height, "height"),
        height_reference=_member(HeightReference, int(reference), "height reference"),
        horizontal_accuracy=_member(HorizontalAccuracy, int(horizontal), "horizontal accuracy"),
        vertical_accuracy=_member(VerticalAccuracy, int(altitude_accuracy), "vertical accuracy"),
        pressure_altitude_accuracy=_member(VerticalAccuracy, int(barometer), "pressure altitude accuracy"),
        speed_accuracy=_member(SpeedAccuracy, int(speed_accuracy), "speed accuracy"),
        after_hour_ms=_milli(seconds, "time", 0, 3600),
        time_accuracy_ms=min(int(quality), 15) * 100 or None,
    )


def _page(values: tuple[int, int, int, int, int, bytes], page: int) -> Authentication:
    number, kind, last_page, length, seconds, data = values
    if number != page:
        raise FieldError("page", f"page {number} stands in the place of page {page}")
    authentication_type = _member(AuthenticationType, kind, "authentication type")
    if page:
        return Authentication(authentication_type=authentication_type, page=page, data=data)
    return Authentication(
        authentication_type=authentication_type,
        page=0,
        data=data[:17],
        last_page=last_page,
        length=length,
        t_ms=EPOCH_2019_MS + seconds * 1000 if seconds else None,
    )


def _system(values: tuple[float, ...]) -> System:
    location, classification, lat, lon, count, radius_m, ceiling, floor, category, uas_class, altitude, seconds = values
    lat_e7, lon_e7 = _position(lat, lon, "operator ")
    return System(
        operator_lat_e7=lat_e7,
        operator_lon_e7=lon_e7,
        operator_location=_member(OperatorLocationType, int(location), "operator location"),
        area_count=int(count),
        area_radius_mm=int(radius_m) * 1000,
        area_ceiling_mm=_altitude(ceiling, "area ceiling"),
        area_floor_mm=_altitude(floor, "area floor"),
        classification=_member(ClassificationType, int(classification), "classification"),
        category=_member(CategoryEu, int(category), "EU category"),
        uas_class=_member(ClassEu, int(uas_class), "EU class"),
        operator_altitude_mm=_altitude(altitude, "operator altitude"),
        t_ms=EPOCH_2019_MS + int(seconds) * 1000 if seconds else None,
    )
