"""What receivers publish as JSON, over MQTT, ZeroMQ or a line each: four shapes, each turned into a frame.

- our own: ``{"messages": [{"type": "location", …}, …], "address"?, "rssi_dbm"?, "t_ms"?, "counter"?}``, as
  ``wonderland remote-id decode`` writes it, or one such message by itself; loss-free;
- Dronetag Scout (JSON+ODID): ``{"sn", "rssi", "tech", "odid": {"BasicID": […], "Location": {…}, …}}``;
- DragonSync and its sensors: ``[{"Basic ID": {…}}, {"Location/Vector Message": {…}}, …]`` or one object of these;
- BlueMark DroneScout: ``{"protocol", "data": {"MAC address", "RSSI", "UASdata": base64}}`` with the C structure of the
  reference implementation inside.

The last three are lossy (floats, texts with units, no counters): what they cannot say is unknown.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from enum import IntEnum
from typing import Any, Final, TypeGuard, TypeVar

from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import (
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
from wonderland_remote_id.framings.core_structure import parse_core_structure
from wonderland_remote_id.framings.framed import Framed
from wonderland_remote_id.json_form import from_json
from wonderland_remote_id.messages import HOUR_MS, BasicId, Location, Message, OperatorId, Pack, SelfId, System

MAX_DOCUMENT_BYTES: Final = 64 * 1024
MAX_DOCUMENTS: Final = 256
"""Batched into one text."""

Member = TypeVar("Member", bound=IntEnum)
_NUMBER: Final = re.compile(r"[<>=\s]*(-?[0-9]{1,12}(?:\.[0-9]{1,12})?)\s*(?:[A-Za-z°/%]{0,12})\s*\Z")
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f]{2}(?::[0-9A-Fa-f]{2}){5}\Z")
_ID_TYPES: Final = {
    "serial": IdType.SERIAL_NUMBER,
    "caa": IdType.CAA_REGISTRATION,
    "utm": IdType.UTM_UUID,
    "specific": IdType.SPECIFIC_SESSION,
    "session": IdType.SPECIFIC_SESSION,
}


def parse_documents(text: bytes | str) -> list[Framed]:
    """The frames in a text with one JSON document or several, one after the other. Raises `RemoteIdError`.

    Documents that are no Remote ID (a receiver's heartbeat, for example) give nothing.
    """
    return [framed for document in split_documents(text) for framed in parse_document(document)]


def split_documents(text: bytes | str) -> list[Any]:
    """The JSON documents in a text, whatever white space is between them. Raises `FramingError`."""
    if len(text) > MAX_DOCUMENT_BYTES:
        raise FramingError(f"a text of {len(text)} bytes; at most {MAX_DOCUMENT_BYTES} are read")
    try:
        rest = text if isinstance(text, str) else text.decode("utf-8")
    except UnicodeDecodeError:
        raise FramingError("a text that is no UTF-8") from None
    documents: list[Any] = []
    decoder, at = json.JSONDecoder(), 0
    while True:
        while at < len(rest) and rest[at] in " \t\r\n":
            at += 1
        if at == len(rest):
            return documents
        if len(documents) == MAX_DOCUMENTS:
            raise FramingError(f"more than {MAX_DOCUMENTS} JSON documents in one text")
        try:
            document, at = decoder.raw_decode(rest, at)
        except (ValueError, RecursionError) as cause:
            raise FramingError(f"no JSON: {cause}"[:200]) from None
        documents.append(document)


def parse_document(document: object) -> list[Framed]:
    """The frames in a decoded JSON document of any of the shapes. Raises `RemoteIdError`."""
    if isinstance(document, list):
        return _list(document)
    if not isinstance(document, Mapping):
        raise FramingError(f"a JSON object or list is needed, not {type(document).__name__}")
    if "messages" in document or "type" in document:
        return _own(document)
    if isinstance(document.get("odid"), Mapping):
        return _framed(list(_core(document["odid"])), document.get("mac"), document.get("rssi"))
    data = document.get("data")
    if isinstance(data, Mapping) and "UASdata" in data:
        return _dronescout(data)
    return _framed(*_dragonsync(document))


def _list(documents: list[Any]) -> list[Framed]:
    if len(documents) > MAX_DOCUMENTS:
        raise FramingError(f"a list of {len(documents)} entries; at most {MAX_DOCUMENTS} are read")
    if any(isinstance(entry, Mapping) and ("odid" in entry or "messages" in entry) for entry in documents):
        return [framed for entry in documents for framed in parse_document(entry)]
    merged: dict[str, Any] = {}
    for entry in documents:
        if not isinstance(entry, Mapping):
            raise FramingError(f"a list of JSON objects is needed, not of {type(entry).__name__}")
        merged.update(entry)
    return _framed(*_dragonsync(merged))


def _framed(messages: list[Message], address: object = None, rssi: object = None) -> list[Framed]:
    if not messages:
        return []
    mac = address.lower() if isinstance(address, str) and _ADDRESS.match(address) else None
    strength = _number(rssi)
    rssi_dbm = round(strength) if strength is not None and -128 <= strength <= 20 else None
    return [Framed(encode(Pack(messages=tuple(messages[:9]))), "json", address=mac, rssi_dbm=rssi_dbm)]


def _own(document: Mapping[str, Any]) -> list[Framed]:
    entries = document.get("messages", [document])
    if not isinstance(entries, list) or len(entries) > 16:
        raise FramingError("messages is not a list of at most 16")
    messages: list[Message] = []
    for entry in entries:
        message = from_json(entry)
        messages.extend(message.messages if isinstance(message, Pack) else (message,))
    if not messages:
        return []
    single = len(messages) == 1 and document.get("pack") is not True and document.get("type") != "pack"
    frame = encode(messages[0] if single else Pack(messages=tuple(messages), version=messages[0].version))
    counter, t_ms = document.get("counter"), document.get("t_ms") if "messages" in document else None
    [framed] = _framed(messages[:1], document.get("address"), document.get("rssi_dbm"))
    return [
        Framed(
            frame,
            "json",
            counter=counter if _whole(counter) and 0 <= counter < 256 else None,
            address=framed.address,
            rssi_dbm=framed.rssi_dbm,
            t_ms=t_ms if _whole(t_ms) and 0 <= t_ms < 1 << 53 else None,
        )
    ]


def _whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


# --- Dronetag: the reference implementation's names -------------------------------------------------------------------


def _core(odid: Mapping[str, Any]) -> Iterator[Message]:
    ids = odid.get("BasicID")
    for entry in ids[:2] if isinstance(ids, list) else [ids]:
        if isinstance(entry, Mapping) and isinstance(entry.get("UASID"), str) and entry["UASID"]:
            id_type = _choice(IdType, entry.get("IDType"), IdType.SERIAL_NUMBER)
            yield _basic_id(entry["UASID"], id_type, _choice(UaType, entry.get("UAType"), UaType.NONE))
    place = odid.get("Location")
    if isinstance(place, Mapping):
        lat_e7, lon_e7 = _position(place.get("Latitude"), place.get("Longitude"))
        yield Location(
            lat_e7=lat_e7,
            lon_e7=lon_e7,
            status=_choice(OperationalStatus, place.get("Status"), OperationalStatus.UNDECLARED),
            track_cdeg=_track(place.get("Direction")),
            speed_mm_s=_milli(place.get("SpeedHorizontal"), 0, 254.25),
            vertical_mm_s=_milli(place.get("SpeedVertical"), -62, 62),
            pressure_altitude_mm=_altitude(place.get("AltitudeBaro")),
            altitude_mm=_altitude(place.get("AltitudeGeo")),
            height_mm=_altitude(place.get("Height")),
            height_reference=_choice(HeightReference, place.get("HeightType"), HeightReference.TAKEOFF),
            horizontal_accuracy=_choice(HorizontalAccuracy, place.get("HorizAccuracy"), HorizontalAccuracy.UNKNOWN),
            vertical_accuracy=_choice(VerticalAccuracy, place.get("VertAccuracy"), VerticalAccuracy.UNKNOWN),
            speed_accuracy=_choice(SpeedAccuracy, place.get("SpeedAccuracy"), SpeedAccuracy.UNKNOWN),
            after_hour_ms=_after_hour_ms(place.get("Timestamp", place.get("TimeStamp"))),
        )
    system = odid.get("System")
    if isinstance(system, Mapping):
        lat_e7, lon_e7 = _position(system.get("OperatorLatitude"), system.get("OperatorLongitude"))
        yield System(
            operator_lat_e7=lat_e7,
            operator_lon_e7=lon_e7,
            operator_location=_choice(
                OperatorLocationType, system.get("OperatorLocationType"), OperatorLocationType.TAKEOFF
            ),
            operator_altitude_mm=_altitude(system.get("OperatorAltitudeGeo")),
        )
    yield from _texts(odid.get("SelfID"), "Desc", odid.get("OperatorID"), "OperatorId")


def _texts(self_id: object, text_key: str, operator: object, operator_key: str) -> Iterator[Message]:
    if isinstance(self_id, Mapping) and isinstance(self_id.get(text_key), str):
        yield SelfId(text=self_id[text_key][:23])
    if isinstance(operator, Mapping) and isinstance(operator.get(operator_key), str):
        yield OperatorId(operator_id=operator[operator_key][:20])


def _dronescout(data: Mapping[str, Any]) -> list[Framed]:
    encoded = data["UASdata"]
    if not isinstance(encoded, str):
        raise FramingError("UASdata is not base64 text")
    try:
        structure = base64.b64decode(encoded, validate=True)
    except (binascii.Error, ValueError):
        raise FramingError("UASdata is not base64 text") from None
    return _framed(parse_core_structure(structure), data.get("MAC address"), data.get("RSSI"))


# --- DragonSync: names and texts for people --------------------------------------------------------------------------


def _dragonsync(document: Mapping[str, Any]) -> tuple[list[Message], object, object]:
    messages: list[Message] = []
    head = document.get("Basic ID")
    address = rssi = None
    if isinstance(head, Mapping):
        address, rssi = head.get("MAC"), head.get("RSSI", head.get("rssi"))
        name = head.get("id")
        if isinstance(name, str) and name:
            kind = next(
                (found for word, found in _ID_TYPES.items() if word in str(head.get("id_type", "")).lower()),
                IdType.NONE,
            )
            messages.append(_basic_id(name, kind, _choice(UaType, head.get("ua_type"), UaType.NONE)))
    place = document.get("Location/Vector Message")
    if isinstance(place, Mapping):
        lat_e7, lon_e7 = _position(place.get("latitude"), place.get("longitude"))
        messages.append(
            Location(
                lat_e7=lat_e7,
                lon_e7=lon_e7,
                status=_choice(OperationalStatus, place.get("op_status"), OperationalStatus.UNDECLARED),
                track_cdeg=_track(place.get("direction")),
                speed_mm_s=_milli(place.get("speed"), 0, 254.25),
                vertical_mm_s=_milli(place.get("vert_speed"), -62, 62),
                pressure_altitude_mm=_altitude(place.get("pressure_altitude")),
                altitude_mm=_altitude(place.get("geodetic_altitude")),
                height_mm=_altitude(place.get("height_agl")),
                horizontal_accuracy=HorizontalAccuracy.of_mm(_milli(place.get("horizontal_accuracy"), 0, 1e5)),
                vertical_accuracy=VerticalAccuracy.of_mm(_milli(place.get("vertical_accuracy"), 0, 1e3)),
                after_hour_ms=_after_hour_ms(place.get("timestamp")),
            )
        )
    system = document.get("System Message")
    if isinstance(system, Mapping):
        lat_e7, lon_e7 = _position(
            system.get("operator_lat", system.get("latitude")), system.get("operator_lon", system.get("longitude"))
        )
        messages.append(
            System(
                operator_lat_e7=lat_e7,
                operator_lon_e7=lon_e7,
                operator_altitude_mm=_altitude(system.get("operator_altitude_geo")),
            )
        )
    messages += _texts(document.get("Self-ID Message"), "text", document.get("Operator ID Message"), "operator_id")
    return messages, address, rssi


# --- values ----------------------------------------------------------------------------------------------------------


def _basic_id(name: str, id_type: IdType, ua_type: UaType) -> BasicId:
    limit = 40 if id_type in {IdType.UTM_UUID, IdType.SPECIFIC_SESSION} else 20
    if len(name) > limit:
        raise FieldError("UAS id", f"{len(name)} characters; it holds {limit}")
    return BasicId(uas_id=name, id_type=id_type, ua_type=ua_type)


def _number(value: object) -> float | None:
    """A number, or the number in a text with its unit; None where it is neither or not finite."""
    if isinstance(value, str):
        match = _NUMBER.match(value) if len(value) <= 64 else None
        return float(match[1]) if match else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e18:
        return None
    return float(value)


def _milli(value: object, minimum: float, maximum: float) -> int | None:
    number = _number(value)
    return round(number * 1000) if number is not None and minimum <= number <= maximum else None


def _altitude(value_m: object) -> int | None:
    return _milli(value_m, -999.5, 31_767.5)


def _track(value: object) -> int | None:
    number = _number(value)
    return round(number) % 360 * 100 if number is not None and 0 <= number <= 360 else None


def _position(lat: object, lon: object) -> tuple[int | None, int | None]:
    """Degrees × 10⁷; unknown where one is missing or both are zero. Raises `FieldError` for what is on no globe."""
    north, east = _number(lat), _number(lon)
    if north is None or east is None or (north == 0 and east == 0):
        return None, None
    if abs(north) > 90:
        raise FieldError("latitude", f"{north}° is beyond ±90°")
    if abs(east) > 180:
        raise FieldError("longitude", f"{east}° is beyond ±180°")
    return round(north * 1e7), round(east * 1e7)


def _choice(members: type[Member], value: object, default: Member) -> Member:
    """A member by its number or name; the default where there is none such."""
    if _whole(value):
        return next((member for member in members if member == value), default)
    if isinstance(value, str) and len(value) <= 64:
        wanted = re.sub(r"[^a-z]+", "_", value.lower()).strip("_")
        for member in members:
            if wanted and member.name.lower() in {wanted, wanted.removeprefix("on_")}:
                return member
    return default


def _after_hour_ms(value: object) -> int | None:
    """Time since the full hour from seconds after it, Unix seconds or milliseconds, or an ISO 8601 text."""
    number = _number(value)
    if number is None and isinstance(value, str) and len(value) <= 40:
        try:
            moment = datetime.fromisoformat(value)
        except ValueError:
            return None
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        moment = moment.astimezone(UTC)
        return (moment.minute * 60 + moment.second) * 1000 + moment.microsecond // 1000
    if number is None or number < 0 or math.isnan(number):
        return None
    if number <= HOUR_MS / 1000:
        return round(number * 1000)
    return int(number * 1000 if number < 1e11 else number) % HOUR_MS
