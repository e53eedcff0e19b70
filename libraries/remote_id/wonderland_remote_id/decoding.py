"""Bytes → messages (ASTM F3411-22a, section 5.4.5; EN 4709-002). Little-endian, 25 bytes a message.

Stricter than the reference implementation (opendroneid-core-c), which takes a latitude of 91°, a track of 435°,
reserved enumeration values, any protocol version, and a pack whose inner messages it cannot read. Reserved *bits* are
ignored, as a later revision may give them a meaning.
"""

from __future__ import annotations

import struct
import uuid
from typing import TYPE_CHECKING, Final

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
from wonderland_remote_id.errors import (
    FieldError,
    FrameLengthError,
    MessageTypeError,
    PackError,
    ProtocolVersionError,
    RemoteIdError,
)
from wonderland_remote_id.messages import (
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
    from collections.abc import Callable
    from enum import IntEnum

PACK_HEADER_BYTES: Final = 3
MAX_PACK_MESSAGES: Final = 9
MAX_FRAME_BYTES: Final = PACK_HEADER_BYTES + MAX_PACK_MESSAGES * MESSAGE_BYTES
EPOCH_2019_MS: Final = 1_546_300_800_000
"""2019-01-01T00:00:00Z: the zero of the times in System and Authentication messages."""

MAX_LAT_E7: Final = 900_000_000
MAX_LON_E7: Final = 1_800_000_000
NO_TIME: Final = 0xFFFF
FIRST_PAGE_BYTES: Final = 17
PAGE_BYTES: Final = 23
MAX_PAGES: Final = 16

LOCATION: Final = struct.Struct("<BBBBbiiHHHBBHBx")
SYSTEM: Final = struct.Struct("<BBiiHBHHBHIx")
FIRST_PAGE: Final = struct.Struct("<BBBBI17s")


def _table(members: type[IntEnum], size: int) -> tuple[IntEnum | None, ...]:
    """Members by value, None where a value is reserved: an index is faster than a call of the enumeration."""
    known = {int(member): member for member in members}
    return tuple(known.get(value) for value in range(size))


# mypy cannot follow the members' types through a table, hence Any-free lookups with the type restored by name.
_VERSIONS: Final[tuple[ProtocolVersion | None, ...]] = _table(ProtocolVersion, 16)  # type: ignore[assignment]
_STATUS: Final[tuple[OperationalStatus | None, ...]] = _table(OperationalStatus, 16)  # type: ignore[assignment]
_HEIGHT: Final[tuple[HeightReference, ...]] = (HeightReference.TAKEOFF, HeightReference.GROUND)
_HORIZONTAL: Final[tuple[HorizontalAccuracy | None, ...]] = _table(HorizontalAccuracy, 16)  # type: ignore[assignment]
_VERTICAL: Final[tuple[VerticalAccuracy | None, ...]] = _table(VerticalAccuracy, 16)  # type: ignore[assignment]
_SPEED: Final[tuple[SpeedAccuracy | None, ...]] = _table(SpeedAccuracy, 16)  # type: ignore[assignment]
_OPERATOR_LOCATION: Final[tuple[OperatorLocationType | None, ...]] = _table(OperatorLocationType, 4)  # type: ignore[assignment]
_CLASSIFICATION: Final[tuple[ClassificationType | None, ...]] = _table(ClassificationType, 8)  # type: ignore[assignment]
_CATEGORY: Final[tuple[CategoryEu | None, ...]] = _table(CategoryEu, 16)  # type: ignore[assignment]
_CLASS: Final[tuple[ClassEu | None, ...]] = _table(ClassEu, 16)  # type: ignore[assignment]


def decode(frame: bytes) -> Message | Pack:
    """The message or pack in a frame: 25 bytes, or 3 + 25·n. Raises `RemoteIdError`, never anything else."""
    if len(frame) == MESSAGE_BYTES:
        return _message(frame, 0)
    if not frame:
        raise FrameLengthError("an empty frame; a message has 25 bytes", 0)
    if frame[0] >> 4 != MessageType.PACK:
        raise FrameLengthError(f"{len(frame)} bytes; a message has 25, and a pack begins with 0xF", len(frame))
    return _pack(frame)


def _message(frame: bytes, start: int) -> Message:
    """The message whose 25 bytes begin at ``start``; there are as many."""
    first = frame[start]
    version = _VERSIONS[first & 15]
    if version is None:
        raise ProtocolVersionError(f"protocol version {first & 15} is unknown; known are 0, 1 and 2", start)
    reader = _READERS.get(first >> 4)
    if reader is None:
        if first >> 4 == MessageType.PACK:
            raise MessageTypeError("a pack cannot be here: it would have to fit into 25 bytes, or into a pack", start)
        raise MessageTypeError(f"message type {first >> 4} is reserved", start)
    return reader(frame, start, version)


def _pack(frame: bytes) -> Pack:
    version = _VERSIONS[frame[0] & 15]
    if version is None:
        raise ProtocolVersionError(f"protocol version {frame[0] & 15} is unknown; known are 0, 1 and 2", 0)
    if len(frame) < PACK_HEADER_BYTES:
        raise FrameLengthError(f"a pack of {len(frame)} bytes has no header (3 bytes)", len(frame))
    if frame[1] != MESSAGE_BYTES:
        raise PackError(f"announces messages of {frame[1]} bytes; they have 25", 1)
    count = frame[2]
    if not 1 <= count <= MAX_PACK_MESSAGES:
        raise PackError(f"announces {count} messages; a pack holds 1 to {MAX_PACK_MESSAGES}", 2)
    expected = PACK_HEADER_BYTES + count * MESSAGE_BYTES
    if len(frame) != expected:
        raise FrameLengthError(f"a pack of {count} messages has {expected} bytes, not {len(frame)}", len(frame))
    messages = []
    for index in range(count):
        start = PACK_HEADER_BYTES + index * MESSAGE_BYTES
        try:
            messages.append(_message(frame, start))
        except RemoteIdError as cause:
            raise PackError(
                f"message {index} of the pack: {cause.message}", cause.offset, index=index, cause=cause
            ) from cause
    check_pack(messages)
    return Pack(messages=tuple(messages), version=version)


def check_pack(messages: list[Message]) -> None:
    """Refuse what may not stand together: two of a kind, but for Basic IDs of different types and other pages."""
    seen: set[tuple[type, int]] = set()
    for index, message in enumerate(messages):
        part = 0
        if isinstance(message, BasicId):
            part = message.id_type
        elif isinstance(message, Authentication):
            part = message.page
        key = (type(message), part)
        if key in seen:
            raise PackError(
                f"a second {type(message).__name__} in one pack: which would hold?",
                PACK_HEADER_BYTES + index * MESSAGE_BYTES,
                index=index,
            )
        seen.add(key)


def _location(frame: bytes, start: int, version: ProtocolVersion) -> Location:
    (
        _, flags, track, speed, vertical, lat_e7, lon_e7, pressure, geodetic, height, accuracy, more, tenths, quality,
    ) = LOCATION.unpack_from(frame, start)  # fmt: skip
    status = _STATUS[flags >> 4]
    if status is None:
        raise FieldError("status", f"{flags >> 4} is reserved", start + 1)
    if flags & 2:
        track += 180
    if track >= 360 and track != 361:
        raise FieldError("track", f"{track}° is not below 360° (361 would mean unknown)", start + 2)
    speed_mm_s = (None if speed == 255 else speed * 750 + 63750) if flags & 1 else speed * 250
    if not -124 <= vertical <= 124 and vertical != 126:
        raise FieldError("vertical speed", f"{vertical / 2} m/s is beyond ±62 (63 would mean unknown)", start + 4)
    position = lat_e7 != 0 or lon_e7 != 0
    if position:
        if not -MAX_LAT_E7 <= lat_e7 <= MAX_LAT_E7:
            raise FieldError("latitude", f"{lat_e7 / 1e7}° is beyond ±90°", start + 5)
        if not -MAX_LON_E7 <= lon_e7 <= MAX_LON_E7:
            raise FieldError("longitude", f"{lon_e7 / 1e7}° is beyond ±180°", start + 9)
    horizontal_accuracy = _HORIZONTAL[accuracy & 15]
    if horizontal_accuracy is None:
        raise FieldError("horizontal accuracy", f"{accuracy & 15} is reserved", start + 19)
    vertical_accuracy = _VERTICAL[accuracy >> 4]
    if vertical_accuracy is None:
        raise FieldError("vertical accuracy", f"{accuracy >> 4} is reserved", start + 19)
    speed_accuracy = _SPEED[more & 15]
    if speed_accuracy is None:
        raise FieldError("speed accuracy", f"{more & 15} is reserved", start + 20)
    pressure_accuracy = _VERTICAL[more >> 4]
    if pressure_accuracy is None:
        raise FieldError("pressure altitude accuracy", f"{more >> 4} is reserved", start + 20)
    if tenths > 36_000 and tenths != NO_TIME:
        raise FieldError("time", f"{tenths / 10} s after the hour is beyond the hour (3600 s)", start + 21)
    return Location(
        lat_e7=lat_e7 if position else None,
        lon_e7=lon_e7 if position else None,
        status=status,
        track_cdeg=None if track == 361 else track * 100,
        speed_mm_s=speed_mm_s,
        vertical_mm_s=None if vertical == 126 else vertical * 500,
        pressure_altitude_mm=pressure * 500 - 1_000_000 if pressure else None,
        altitude_mm=geodetic * 500 - 1_000_000 if geodetic else None,
        height_mm=height * 500 - 1_000_000 if height else None,
        height_reference=_HEIGHT[flags >> 2 & 1],
        horizontal_accuracy=horizontal_accuracy,
        vertical_accuracy=vertical_accuracy,
        pressure_altitude_accuracy=pressure_accuracy,
        speed_accuracy=speed_accuracy,
        after_hour_ms=None if tenths == NO_TIME else tenths * 100,
        time_accuracy_ms=(quality & 15) * 100 or None,
        version=version,
    )


def _basic_id(frame: bytes, start: int, version: ProtocolVersion) -> BasicId:
    kind = frame[start + 1] >> 4
    raw = frame[start + 2 : start + 22]
    try:
        id_type = IdType(kind)
    except ValueError:
        raise FieldError("id type", f"{kind} is reserved", start + 1) from None
    if id_type is IdType.UTM_UUID:
        if any(raw[16:]):
            raise FieldError("UAS id", "a UUID has 16 bytes; the four after it must be zero", start + 18)
        uas_id = str(uuid.UUID(bytes=raw[:16]))
    elif id_type is IdType.SPECIFIC_SESSION:
        if raw[0] == 0:
            raise FieldError("UAS id", "a specific session id of type 0 is reserved", start + 2)
        uas_id = raw.hex()
    else:
        uas_id = _text(raw, "UAS id", start + 2)
    return BasicId(uas_id=uas_id, id_type=id_type, ua_type=UaType(frame[start + 1] & 15), version=version)


def _authentication(frame: bytes, start: int, version: ProtocolVersion) -> Authentication:
    kind, page = frame[start + 1] >> 4, frame[start + 1] & 15
    try:
        authentication_type = AuthenticationType(kind)
    except ValueError:
        raise FieldError("authentication type", f"{kind} is reserved", start + 1) from None
    if page:
        data = bytes(frame[start + 2 : start + MESSAGE_BYTES])
        return Authentication(authentication_type=authentication_type, page=page, data=data, version=version)
    _, _, last_page, length, seconds, data = FIRST_PAGE.unpack_from(frame, start)
    if last_page >= MAX_PAGES:
        raise FieldError("last page", f"{last_page} is beyond 15", start + 2)
    room = FIRST_PAGE_BYTES + last_page * PAGE_BYTES
    if length > room:
        raise FieldError("length", f"{length} bytes do not fit into the {room} of pages 0 to {last_page}", start + 3)
    return Authentication(
        authentication_type=authentication_type,
        page=0,
        data=data,
        last_page=last_page,
        length=length,
        t_ms=EPOCH_2019_MS + seconds * 1000 if seconds else None,
        version=version,
    )


def _self_id(frame: bytes, start: int, version: ProtocolVersion) -> SelfId:
    kind = frame[start + 1]
    if kind in PRIVATE_USE:
        description_type: DescriptionType | int = kind
    else:
        try:
            description_type = DescriptionType(kind)
        except ValueError:
            raise FieldError("description type", f"{kind} is reserved", start + 1) from None
    text = _text(frame[start + 2 : start + MESSAGE_BYTES], "text", start + 2)
    return SelfId(text=text, description_type=description_type, version=version)


def _system(frame: bytes, start: int, version: ProtocolVersion) -> System:
    _, flags, lat_e7, lon_e7, count, radius, ceiling, floor, eu, altitude, seconds = SYSTEM.unpack_from(frame, start)
    operator_location, classification = _OPERATOR_LOCATION[flags & 3], _CLASSIFICATION[flags >> 2 & 7]
    if operator_location is None:
        raise FieldError("operator location", f"{flags & 3} is reserved", start + 1)
    if classification is None:
        raise FieldError("classification", f"{flags >> 2 & 7} is reserved", start + 1)
    category, uas_class = _CATEGORY[eu >> 4], _CLASS[eu & 15]
    if category is None:
        raise FieldError("EU category", f"{eu >> 4} is reserved", start + 17)
    if uas_class is None:
        raise FieldError("EU class", f"{eu & 15} is reserved", start + 17)
    position = lat_e7 != 0 or lon_e7 != 0
    if not -MAX_LAT_E7 <= lat_e7 <= MAX_LAT_E7:
        raise FieldError("operator latitude", f"{lat_e7 / 1e7}° is beyond ±90°", start + 2)
    if not -MAX_LON_E7 <= lon_e7 <= MAX_LON_E7:
        raise FieldError("operator longitude", f"{lon_e7 / 1e7}° is beyond ±180°", start + 6)
    return System(
        operator_lat_e7=lat_e7 if position else None,
        operator_lon_e7=lon_e7 if position else None,
        operator_location=operator_location,
        area_count=count,
        area_radius_mm=radius * 10_000,
        area_ceiling_mm=ceiling * 500 - 1_000_000 if ceiling else None,
        area_floor_mm=floor * 500 - 1_000_000 if floor else None,
        classification=classification,
        category=category,
        uas_class=uas_class,
        operator_altitude_mm=altitude * 500 - 1_000_000 if altitude else None,
        t_ms=EPOCH_2019_MS + seconds * 1000 if seconds else None,
        version=version,
    )


def _operator_id(frame: bytes, start: int, version: ProtocolVersion) -> OperatorId:
    kind = frame[start + 1]
    if kind and kind not in PRIVATE_USE:
        raise FieldError("operator id type", f"{kind} is reserved", start + 1)
    text = _text(frame[start + 2 : start + 22], "operator id", start + 2)
    return OperatorId(operator_id=text, operator_id_type=kind, version=version)


def _text(raw: bytes, field: str, offset: int) -> str:
    """Printable ASCII, filled up with zero bytes."""
    text = raw.rstrip(b"\0")
    if text.isascii():
        decoded = text.decode("ascii")
        if decoded.isprintable():
            return decoded
    for index, value in enumerate(text):
        if not 0x20 <= value <= 0x7E:
            raise FieldError(field, f"byte {value:#04x} is no printable ASCII character", offset + index)
    raise AssertionError(field)  # pragma: no cover - every byte was printable, which was answered above


_READERS: Final[dict[int, Callable[[bytes, int, ProtocolVersion], Message]]] = {
    MessageType.BASIC_ID: _basic_id,
    MessageType.LOCATION: _location,
    MessageType.AUTHENTICATION: _authentication,
    MessageType.SELF_ID: _self_id,
    MessageType.SYSTEM: _system,
    MessageType.OPERATOR_ID: _operator_id,
}
