"""Messages → bytes: what `wonderland_remote_id.decoding` reads back, to the resolution of each field."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING

from wonderland_remote_id.decoding import (
    EPOCH_2019_MS,
    FIRST_PAGE,
    FIRST_PAGE_BYTES,
    LOCATION,
    MAX_LAT_E7,
    MAX_LON_E7,
    MAX_PACK_MESSAGES,
    MAX_PAGES,
    NO_TIME,
    PAGE_BYTES,
    SYSTEM,
    check_pack,
)
from wonderland_remote_id.enums import (
    PRIVATE_USE,
    AuthenticationType,
    CategoryEu,
    ClassEu,
    ClassificationType,
    DescriptionType,
    HeightReference,
    HorizontalAccuracy,
    IdType,
    MessageType,
    OperationalStatus,
    OperatorLocationType,
    ProtocolVersion,
    SpeedAccuracy,
    UaType,
    VerticalAccuracy,
)
from wonderland_remote_id.errors import FieldError, MessageTypeError, PackError
from wonderland_remote_id.messages import (
    HOUR_MS,
    MESSAGE_BYTES,
    Authentication,
    BasicId,
    Location,
    Message,
    OperatorId,
    Pack,
    SelfId,
    System,
)

if TYPE_CHECKING:
    from enum import IntEnum


def encode(message: Message | Pack) -> bytes:
    """The frame of a message (25 bytes) or of a pack (3 + 25·n bytes). Raises `RemoteIdError`.

    Lengths and times are rounded to the field's resolution, speeds limited to its ends; a latitude of 91° or a text
    of 21 characters is refused.
    """
    if not isinstance(message, Pack):
        return _message(message)
    if not 1 <= len(message.messages) <= MAX_PACK_MESSAGES:
        raise PackError(f"{len(message.messages)} messages; a pack holds 1 to {MAX_PACK_MESSAGES}")
    check_pack(list(message.messages))
    header = bytes((_first(MessageType.PACK, message.version), MESSAGE_BYTES, len(message.messages)))
    return header + b"".join([_message(inner) for inner in message.messages])


def _message(message: Message) -> bytes:
    if isinstance(message, Location):
        return _location(message)
    if isinstance(message, BasicId):
        return _basic_id(message)
    if isinstance(message, System):
        return _system(message)
    if isinstance(message, OperatorId):
        kind = message.operator_id_type
        if kind and kind not in PRIVATE_USE:
            raise FieldError("operator id type", f"{kind} is reserved; 0, or 201 to 255 for private use")
        return (
            bytes((_first(MessageType.OPERATOR_ID, message.version), kind))
            + _text(message.operator_id, 20, "operator id")
            + bytes(3)
        )
    if isinstance(message, SelfId):
        kind = message.description_type
        if kind not in PRIVATE_USE:
            kind = _member(DescriptionType, kind, "description type")
        return bytes((_first(MessageType.SELF_ID, message.version), kind)) + _text(message.text, 23, "text")
    if isinstance(message, Authentication):
        return _authentication(message)
    raise MessageTypeError(f"{type(message).__name__} is no Remote ID message")


def _location(message: Location) -> bytes:
    status = _member(OperationalStatus, message.status, "status")
    reference = _member(HeightReference, message.height_reference, "height reference")
    flags = status << 4 | reference << 2
    if message.track_cdeg is None:
        track = 361
    elif 0 <= message.track_cdeg < 36_000:
        track = (message.track_cdeg + 50) // 100 % 360
    else:
        raise FieldError("track", f"{message.track_cdeg} is outside 0..35999 hundredths of a degree")
    if track >= 180:
        track -= 180
        flags |= 2
    speed = message.speed_mm_s
    if speed is None:
        speed_code, multiplier = 255, 1
    elif speed < 0:
        raise FieldError("speed", f"{speed} mm/s is negative; turn the track instead")
    elif speed <= 63_750:
        speed_code, multiplier = (speed + 125) // 250, 0
    else:
        speed_code, multiplier = min((speed - 63_750 + 375) // 750, 254), 1
    flags |= multiplier
    vertical = 126 if message.vertical_mm_s is None else max(-124, min(124, (message.vertical_mm_s + 250) // 500))
    lat_e7, lon_e7 = _position(message.lat_e7, message.lon_e7, "")
    if message.after_hour_ms is None:
        tenths = NO_TIME
    elif 0 <= message.after_hour_ms <= HOUR_MS:
        tenths = (message.after_hour_ms + 50) // 100
    else:
        raise FieldError("time", f"{message.after_hour_ms} ms after the hour is outside 0..{HOUR_MS}")
    if message.time_accuracy_ms is None:
        quality = 0
    elif 0 < message.time_accuracy_ms <= 1500:
        quality = -(-message.time_accuracy_ms // 100)  # a bound is rounded up, or it would not hold
    else:
        raise FieldError("time accuracy", f"{message.time_accuracy_ms} ms is outside 1..1500")
    horizontal = _member(HorizontalAccuracy, message.horizontal_accuracy, "horizontal accuracy")
    vertical_accuracy = _member(VerticalAccuracy, message.vertical_accuracy, "vertical accuracy")
    pressure_accuracy = _member(VerticalAccuracy, message.pressure_altitude_accuracy, "pressure altitude accuracy")
    speed_accuracy = _member(SpeedAccuracy, message.speed_accuracy, "speed accuracy")
    return LOCATION.pack(
        _first(MessageType.LOCATION, message.version),
        flags,
        track,
        speed_code,
        vertical,
        lat_e7,
        lon_e7,
        _altitude(message.pressure_altitude_mm, "pressure altitude"),
        _altitude(message.altitude_mm, "altitude"),
        _altitude(message.height_mm, "height"),
        vertical_accuracy << 4 | horizontal,
        pressure_accuracy << 4 | speed_accuracy,
        tenths,
        quality,
    )


def _basic_id(message: BasicId) -> bytes:
    id_type = _member(IdType, message.id_type, "id type")
    if id_type == IdType.UTM_UUID:
        try:
            raw = uuid.UUID(message.uas_id).bytes + bytes(4)
        except ValueError:
            raise FieldError("UAS id", f"{message.uas_id[:60]!r} is no UUID") from None
    elif id_type == IdType.SPECIFIC_SESSION:
        try:
            raw = bytes.fromhex(message.uas_id)
        except ValueError:
            raise FieldError("UAS id", "a specific session id is written in hexadecimal digits") from None
        if len(raw) != 20 or raw[0] == 0:
            raise FieldError("UAS id", "a specific session id has 40 hexadecimal digits, the first two not 00")
    else:
        raw = _text(message.uas_id, 20, "UAS id")
    kinds = id_type << 4 | _member(UaType, message.ua_type, "aircraft type")
    return bytes((_first(MessageType.BASIC_ID, message.version), kinds)) + raw + bytes(3)


def _authentication(message: Authentication) -> bytes:
    kind = _member(AuthenticationType, message.authentication_type, "authentication type")
    if not 0 <= message.page < MAX_PAGES:
        raise FieldError("page", f"{message.page} is outside 0..15")
    first = _first(MessageType.AUTHENTICATION, message.version)
    size = PAGE_BYTES if message.page else FIRST_PAGE_BYTES
    if len(message.data) > size:
        raise FieldError("data", f"{len(message.data)} bytes; page {message.page} holds {size}")
    if message.page:
        if not message.last_page is message.length is message.t_ms is None:
            raise FieldError("page", "last_page, length and t_ms stand on page 0 only")
        return bytes((first, kind << 4 | message.page)) + message.data.ljust(PAGE_BYTES, b"\0")
    last_page, length = message.last_page or 0, message.length or 0
    if not 0 <= last_page < MAX_PAGES:
        raise FieldError("last page", f"{last_page} is outside 0..15")
    room = FIRST_PAGE_BYTES + last_page * PAGE_BYTES
    if not 0 <= length <= min(room, 255):
        raise FieldError("length", f"{length} is outside 0..{min(room, 255)}")
    seconds = _seconds(message.t_ms, "time")
    return FIRST_PAGE.pack(first, kind << 4, last_page, length, seconds, message.data)


def _system(message: System) -> bytes:
    flags = _member(OperatorLocationType, message.operator_location, "operator location")
    flags |= _member(ClassificationType, message.classification, "classification") << 2
    category = _member(CategoryEu, message.category, "EU category") << 4
    category |= _member(ClassEu, message.uas_class, "EU class")
    lat_e7, lon_e7 = _position(message.operator_lat_e7, message.operator_lon_e7, "operator ")
    if not 0 <= message.area_count <= 0xFFFF:
        raise FieldError("area count", f"{message.area_count} is outside 0..65535")
    if not 0 <= message.area_radius_mm <= 2_550_000:
        raise FieldError("area radius", f"{message.area_radius_mm} mm is outside 0..2550000")
    return SYSTEM.pack(
        _first(MessageType.SYSTEM, message.version),
        flags,
        lat_e7,
        lon_e7,
        message.area_count,
        (message.area_radius_mm + 5_000) // 10_000,
        _altitude(message.area_ceiling_mm, "area ceiling"),
        _altitude(message.area_floor_mm, "area floor"),
        category,
        _altitude(message.operator_altitude_mm, "operator altitude"),
        _seconds(message.t_ms, "time"),
    )


def _first(kind: MessageType, version: int) -> int:
    return kind << 4 | _member(ProtocolVersion, version, "protocol version")


def _member(members: type[IntEnum], value: int, field: str) -> int:
    """The value of an enumeration's member; also for callers without a type checker."""
    try:
        return int(members(value))
    except ValueError:
        raise FieldError(field, f"{value!r} is reserved") from None


def _position(lat_e7: int | None, lon_e7: int | None, whose: str) -> tuple[int, int]:
    if lat_e7 is None and lon_e7 is None:
        return 0, 0
    if lat_e7 is None or lon_e7 is None:
        raise FieldError(f"{whose}position", "latitude and longitude are known both or neither")
    if not -MAX_LAT_E7 <= lat_e7 <= MAX_LAT_E7:
        raise FieldError(f"{whose}latitude", f"{lat_e7} is outside ±{MAX_LAT_E7} (degrees × 10⁷)")
    if not -MAX_LON_E7 <= lon_e7 <= MAX_LON_E7:
        raise FieldError(f"{whose}longitude", f"{lon_e7} is outside ±{MAX_LON_E7} (degrees × 10⁷)")
    if lat_e7 == lon_e7 == 0:
        # 0, 0 is the word for "unknown": say the closest position that can be said, 11 mm away.
        return 0, 1
    return lat_e7, lon_e7


def _altitude(altitude_mm: int | None, field: str) -> int:
    """Code of an altitude; code 0 (−1000 m) means unknown, so that the lowest that can be said is −999.5 m."""
    if altitude_mm is None:
        return 0
    code = (altitude_mm + 1_000_250) // 500
    if not 1 <= code <= 0xFFFF:
        raise FieldError(field, f"{altitude_mm} mm is outside -999500..31767500")
    return code


def _seconds(t_ms: int | None, field: str) -> int:
    if t_ms is None:
        return 0
    seconds = (t_ms - EPOCH_2019_MS) // 1000
    if not 1 <= seconds <= 0xFFFFFFFF:
        raise FieldError(field, f"{t_ms} ms is outside what seconds since 2019-01-01 can say (until 2155)")
    return seconds


def _text(text: str, size: int, field: str) -> bytes:
    if len(text) > size:
        raise FieldError(field, f"{len(text)} characters; it holds {size}")
    if not (text.isascii() and text.isprintable()):
        raise FieldError(field, "only printable ASCII characters can be sent")
    return text.encode("ascii").ljust(size, b"\0")
