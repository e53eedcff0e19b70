"""MAVLink 2: the ``OPEN_DRONE_ID_*`` messages (12900–12905, 12915, 12918–9), from receivers such as DroneScout Bridge.

Flight controllers speak them to Remote ID modules, and receivers to ground stations. `MavlinkStream` finds them in a
stream of bytes (serial line, UDP) by length and checksum and gives the frame that the drone would broadcast; `build`
is the inverse. Signatures are passed over: a pad has no key of the receiver. Positions come in 1e-7 degrees, times in
seconds, lengths in metres as floats, which hold every step of the broadcast's fields exactly.

A SYSTEM_UPDATE (12919) only has where the operator is now: it gives its sender's last System message with that place.
An ARM_STATUS (12918), by which a Remote ID module tells its autopilot whether it may arm, gives nothing.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any, Final, TypeVar

from wonderland_remote_id.decoding import EPOCH_2019_MS, FIRST_PAGE_BYTES, MAX_PACK_MESSAGES, PACK_HEADER_BYTES, decode
from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import (
    CategoryEu,
    ClassEu,
    ClassificationType,
    HeightReference,
    HorizontalAccuracy,
    MessageType,
    OperationalStatus,
    OperatorLocationType,
    ProtocolVersion,
    SpeedAccuracy,
    VerticalAccuracy,
)
from wonderland_remote_id.errors import FieldError, FramingError, RemoteIdError
from wonderland_remote_id.framings.framed import Framed, format_address, parse_address
from wonderland_remote_id.framings.mavlink_senders import Senders
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

BASIC_ID, LOCATION, AUTHENTICATION, SELF_ID, SYSTEM, OPERATOR_ID, MESSAGE_PACK = *range(12900, 12906), 12915
ARM_STATUS, SYSTEM_UPDATE = 12918, 12919
MAX_BYTES: Final = 280

Member = TypeVar("Member", bound=IntEnum)

_MAGIC: Final = 0xFD
_HEADER_BYTES: Final = 10
_SIGNED: Final = 0x01
_SIGNATURE_BYTES: Final = 13
_ID_OR_MAC: Final = 20

# Fields in the order of the wire (by size, then by declaration); the last byte of a message's checksum input tells its
# definition (CRC_EXTRA), so that a definition that changed is refused rather than misread.
LAYOUTS: Final[dict[int, tuple[struct.Struct, int]]] = {
    BASIC_ID: (struct.Struct("<BB20sBB20s"), 114),
    LOCATION: (struct.Struct("<iiffffHHhBB20sBBBBBBB"), 254),
    AUTHENTICATION: (struct.Struct("<IBB20sBBBB23s"), 140),
    SELF_ID: (struct.Struct("<BB20sB23s"), 249),
    SYSTEM: (struct.Struct("<iifffIHHBB20sBBBB"), 77),
    OPERATOR_ID: (struct.Struct("<BB20sB20s"), 49),
    MESSAGE_PACK: (struct.Struct("<BB20sBB225s"), 94),
    ARM_STATUS: (struct.Struct("<B50s"), 139),
    SYSTEM_UPDATE: (struct.Struct("<iifIBB"), 7),
}
_NO_ALTITUDE_M: Final = -1000.0
_NO_TRACK, _NO_SPEED, _NO_VERTICAL, _NO_TIME_S = 36_100, 25_500, 6_300, 65_535.0


def build(
    message: Message | Pack, *, address: str | None = None, system: int = 1, component: int = 236, sequence: int = 0
) -> bytes:
    """A MAVLink 2 packet. ``address`` is the transmitter's; component 236 is a Remote ID module.

    Raises `RemoteIdError`.
    """
    try:
        mac = (parse_address(address) if address else b"").ljust(_ID_OR_MAC, b"\0")
    except ValueError:
        raise FramingError(f"{address!r:.40} is no address, for example c0:ff:ee:00:00:01") from None
    number, values = _values(message, mac)
    layout, extra = LAYOUTS[number]
    payload = layout.pack(*values).rstrip(b"\0") or b"\0"
    head = struct.pack("<BBBBBB", len(payload), 0, 0, sequence & 0xFF, system, component) + number.to_bytes(3, "little")
    return bytes((_MAGIC,)) + head + payload + checksum(head + payload + bytes((extra,))).to_bytes(2, "little")


def build_frame(frame: bytes, *, address: str | None = None, sequence: int = 0) -> bytes:
    """The MAVLink 2 packet of a frame as it would be broadcast. Raises `RemoteIdError`."""
    return build(decode(frame), address=address, sequence=sequence)


class MavlinkStream:
    """Finds the packets in a stream; what is none is passed over and counted in ``skipped_bytes``.

    ``senders`` are shared where one stream is many (datagrams), each with a ``name``.
    """

    def __init__(self, senders: Senders | None = None, name: str = "") -> None:
        self._senders = senders or Senders()
        self._name = name
        self._buffer = bytearray()
        self.skipped_bytes = 0

    def feed(self, data: bytes) -> Iterator[Framed | RemoteIdError]:
        """The frames that these bytes complete; an error stands for a packet of ours with contents that are wrong."""
        self._buffer += data
        while True:
            start = self._buffer.find(_MAGIC)
            if start < 0:
                start = len(self._buffer)
            self.skipped_bytes += start
            del self._buffer[:start]
            if len(self._buffer) < _HEADER_BYTES:
                return
            number = int.from_bytes(self._buffer[7:10], "little")
            signature = _SIGNATURE_BYTES if self._buffer[2] & _SIGNED else 0
            end = _HEADER_BYTES + self._buffer[1] + 2
            layout = LAYOUTS.get(number)
            if layout is None or self._buffer[2] & ~_SIGNED:
                # Another message's checksum cannot be verified: only this byte is surely not the start of one of ours.
                self._drop(1)
                continue
            if len(self._buffer) < end + signature:
                return
            content = bytes(self._buffer[1 : end - 2])
            if checksum(content + bytes((layout[1],))) != int.from_bytes(self._buffer[end - 2 : end], "little"):
                self._drop(1)
                continue
            del self._buffer[: end + signature]
            try:
                framed = self._framed(number, content)
            except RemoteIdError as error:
                yield error
            else:
                if framed is not None:
                    yield framed

    def _framed(self, number: int, content: bytes) -> Framed | None:
        payload, sender = content[_HEADER_BYTES - 1 :], (self._name, content[4:6])
        if number == ARM_STATUS:
            return None
        if number == SYSTEM_UPDATE:
            lat_e7, lon_e7, altitude_m, seconds = _unpacked(number, payload)[:4]
            there = lat_e7 != 0 or lon_e7 != 0
            return self._senders.moved(
                sender,
                operator_lat_e7=lat_e7 if there else None,
                operator_lon_e7=lon_e7 if there else None,
                operator_altitude_mm=_altitude_mm(altitude_m, "operator altitude"),
                t_ms=EPOCH_2019_MS + seconds * 1000 if seconds else None,
            )
        framed = _framed(number, payload)
        if number in {SYSTEM, MESSAGE_PACK}:
            self._senders.take_frame(sender, framed)
        return framed

    def _drop(self, size: int) -> None:
        self.skipped_bytes += size
        del self._buffer[:size]


def parse_datagram(data: bytes, senders: Senders | None = None, name: str = "") -> list[Framed | RemoteIdError]:
    """The frames in one datagram of ``name``; ``senders`` remembers between datagrams."""
    return list(MavlinkStream(senders, name).feed(data))


def checksum(data: bytes) -> int:
    """CRC-16/MCRF4XX, as MAVLink has it."""
    crc = 0xFFFF
    for octet in data:
        crc = crc >> 8 ^ _CRC_TABLE[(crc ^ octet) & 0xFF]
    return crc


def _crc_of(octet: int) -> int:
    for _ in range(8):
        octet = octet >> 1 ^ 0x8408 if octet & 1 else octet >> 1
    return octet


_CRC_TABLE: Final = tuple(_crc_of(octet) for octet in range(256))


def _unpacked(number: int, payload: bytes) -> tuple[Any, ...]:
    layout, _ = LAYOUTS[number]
    # Zeros at the end are not transmitted; a longer payload has fields of a later revision.
    return layout.unpack(payload.ljust(layout.size, b"\0")[: layout.size])


def _framed(number: int, payload: bytes) -> Framed:
    values = _unpacked(number, payload)
    mac = next(value for value in values if isinstance(value, bytes))
    address = format_address(mac[:6]) if any(mac[:6]) and not any(mac[6:]) else None
    frame = _FRAMES[number](values)
    decode(frame)  # a receiver's word is no better than a drone's
    return Framed(frame, "mavlink", address=address)


def _first(kind: MessageType) -> int:
    return kind << 4 | ProtocolVersion.F3411_22A


def _nibbles(high: int, low: int, field: str) -> int:
    if high > 15 or low > 15:
        raise FieldError(field, f"{high} or {low} does not fit into four bits")
    return high << 4 | low


def _basic_id(values: tuple[Any, ...]) -> bytes:
    id_type, ua_type, uas_id = values[3:]
    kinds = _nibbles(id_type, ua_type, "id type or aircraft type")
    return bytes((_first(MessageType.BASIC_ID), kinds)) + bytes(uas_id) + bytes(3)


def _location(values: tuple[Any, ...]) -> bytes:
    lat_e7, lon_e7, pressure_m, altitude_m, height_m, seconds, track_cdeg, speed_cm_s, vertical_cm_s = values[:9]
    status, reference, horizontal, vertical, barometer, speed, quality = values[12:]
    if speed_cm_s > 25_425 and speed_cm_s != _NO_SPEED:
        raise FieldError("speed", f"{speed_cm_s} cm/s is beyond 25425 (25500 would mean unknown)")
    if abs(vertical_cm_s) > 6_200 and vertical_cm_s != _NO_VERTICAL:
        raise FieldError("vertical speed", f"{vertical_cm_s} cm/s is beyond ±6200 (6300 would mean unknown)")
    if quality > 15:
        raise FieldError("time accuracy", f"{quality} is reserved")
    there = lat_e7 != 0 or lon_e7 != 0
    return encode(
        Location(
            lat_e7=lat_e7 if there else None,
            lon_e7=lon_e7 if there else None,
            status=_member(OperationalStatus, status, "status"),
            track_cdeg=None if track_cdeg == _NO_TRACK else track_cdeg,
            speed_mm_s=None if speed_cm_s == _NO_SPEED else speed_cm_s * 10,
            vertical_mm_s=None if vertical_cm_s == _NO_VERTICAL else vertical_cm_s * 10,
            pressure_altitude_mm=_altitude_mm(pressure_m, "pressure altitude"),
            altitude_mm=_altitude_mm(altitude_m, "altitude"),
            height_mm=_altitude_mm(height_m, "height"),
            height_reference=_member(HeightReference, reference, "height reference"),
            horizontal_accuracy=_member(HorizontalAccuracy, horizontal, "horizontal accuracy"),
            vertical_accuracy=_member(VerticalAccuracy, vertical, "vertical accuracy"),
            pressure_altitude_accuracy=_member(VerticalAccuracy, barometer, "pressure altitude accuracy"),
            speed_accuracy=_member(SpeedAccuracy, speed, "speed accuracy"),
            after_hour_ms=None if seconds == _NO_TIME_S else _milli(seconds, "time"),
            time_accuracy_ms=quality * 100 or None,
        )
    )


def _authentication(values: tuple[Any, ...]) -> bytes:
    seconds, _, _, _, kind, page, last_page, length, data = values
    head = bytes((_first(MessageType.AUTHENTICATION), _nibbles(kind, page, "authentication type or page")))
    if page:
        return bytes(head + data)
    return head + struct.pack("<BBI", last_page, length, seconds) + bytes(data[:FIRST_PAGE_BYTES])


def _self_id(values: tuple[Any, ...]) -> bytes:
    return bytes((_first(MessageType.SELF_ID), values[3])) + bytes(values[4])


def _system(values: tuple[Any, ...]) -> bytes:
    lat_e7, lon_e7, ceiling_m, floor_m, altitude_m, seconds, count, radius_m = values[:8]
    location, classification, category, uas_class = values[11:]
    there = lat_e7 != 0 or lon_e7 != 0
    return encode(
        System(
            operator_lat_e7=lat_e7 if there else None,
            operator_lon_e7=lon_e7 if there else None,
            operator_location=_member(OperatorLocationType, location, "operator location"),
            area_count=count,
            area_radius_mm=radius_m * 1000,
            area_ceiling_mm=_altitude_mm(ceiling_m, "area ceiling"),
            area_floor_mm=_altitude_mm(floor_m, "area floor"),
            classification=_member(ClassificationType, classification, "classification"),
            category=_member(CategoryEu, category, "EU category"),
            uas_class=_member(ClassEu, uas_class, "EU class"),
            operator_altitude_mm=_altitude_mm(altitude_m, "operator altitude"),
            t_ms=EPOCH_2019_MS + seconds * 1000 if seconds else None,
        )
    )


def _operator_id(values: tuple[Any, ...]) -> bytes:
    return bytes((_first(MessageType.OPERATOR_ID), values[3])) + bytes(values[4]) + bytes(3)


def _message_pack(values: tuple[Any, ...]) -> bytes:
    size, count, messages = values[3:]
    if size != MESSAGE_BYTES or not 1 <= count <= MAX_PACK_MESSAGES:
        raise FramingError(f"a MAVLink pack of {count} messages of {size} bytes; packs hold 1 to 9 of {MESSAGE_BYTES}")
    return bytes((MessageType.PACK << 4 | messages[0] & 15, size, count)) + bytes(messages[: size * count])


_FRAMES: Final[dict[int, Callable[[tuple[Any, ...]], bytes]]] = {
    BASIC_ID: _basic_id,
    LOCATION: _location,
    AUTHENTICATION: _authentication,
    SELF_ID: _self_id,
    SYSTEM: _system,
    OPERATOR_ID: _operator_id,
    MESSAGE_PACK: _message_pack,
}


def _member(members: type[Member], value: int, field: str) -> Member:
    try:
        return members(value)
    except ValueError:
        raise FieldError(field, f"{value} is reserved") from None


def _milli(value: float, field: str) -> int:
    """A float of whole units in thousandths. Raises `FieldError` for what is no number or far beyond any field."""
    if not abs(value) < 1e7:  # also false for NaN
        raise FieldError(field, f"{value} is no value that this field can have")
    return round(value * 1000)


def _altitude_mm(value_m: float, field: str) -> int | None:
    return None if value_m == _NO_ALTITUDE_M else _milli(value_m, field)


# --- and back -------------------------------------------------------------------------------------------------------


def _values(message: Message | Pack, mac: bytes) -> tuple[int, tuple[Any, ...]]:
    """Number and fields of the MAVLink message; system and component 0 are everybody."""
    frame = encode(message)
    if isinstance(message, Pack):
        return MESSAGE_PACK, (0, 0, mac, frame[1], frame[2], frame[PACK_HEADER_BYTES:])
    if isinstance(message, BasicId):
        return BASIC_ID, (0, 0, mac, frame[1] >> 4, frame[1] & 15, frame[2:22])
    if isinstance(message, SelfId):
        return SELF_ID, (0, 0, mac, frame[1], frame[2:])
    if isinstance(message, OperatorId):
        return OPERATOR_ID, (0, 0, mac, frame[1], frame[2:22])
    if isinstance(message, Authentication):
        kind, page = frame[1] >> 4, frame[1] & 15
        if page:
            return AUTHENTICATION, (0, 0, 0, mac, kind, page, 0, 0, frame[2:])
        last_page, length, seconds = struct.unpack_from("<BBI", frame, 2)
        return AUTHENTICATION, (seconds, 0, 0, mac, kind, page, last_page, length, frame[8:])
    # What a frame says exactly is what goes out, not what the caller said before rounding.
    exact = decode(frame)
    if isinstance(exact, Location):
        return LOCATION, _location_values(exact, mac)
    assert isinstance(exact, System)
    return SYSTEM, (
        exact.operator_lat_e7 or 0,
        exact.operator_lon_e7 or 0,
        _metres(exact.area_ceiling_mm),
        _metres(exact.area_floor_mm),
        _metres(exact.operator_altitude_mm),
        (exact.t_ms - EPOCH_2019_MS) // 1000 if exact.t_ms is not None else 0,
        exact.area_count,
        exact.area_radius_mm // 1000,
        0,
        0,
        mac,
        exact.operator_location,
        exact.classification,
        exact.category,
        exact.uas_class,
    )


def _location_values(exact: Location, mac: bytes) -> tuple[Any, ...]:
    return (
        exact.lat_e7 or 0,
        exact.lon_e7 or 0,
        _metres(exact.pressure_altitude_mm),
        _metres(exact.altitude_mm),
        _metres(exact.height_mm),
        _NO_TIME_S if exact.after_hour_ms is None else exact.after_hour_ms / 1000,
        _NO_TRACK if exact.track_cdeg is None else exact.track_cdeg,
        _NO_SPEED if exact.speed_mm_s is None else exact.speed_mm_s // 10,
        _NO_VERTICAL if exact.vertical_mm_s is None else exact.vertical_mm_s // 10,
        0,
        0,
        mac,
        exact.status,
        exact.height_reference,
        exact.horizontal_accuracy,
        exact.vertical_accuracy,
        exact.pressure_altitude_accuracy,
        exact.speed_accuracy,
        (exact.time_accuracy_ms or 0) // 100,
    )


def _metres(value_mm: int | None) -> float:
    return _NO_ALTITUDE_M if value_mm is None else value_mm / 1000
