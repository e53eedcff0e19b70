"""Messages as JSON objects and back: one key for each field, with its unit in the name, null for "unknown".

Enumerations are their names in lower case (``"status": "airborne"``), private-use types their number, bytes
hexadecimal digits. An Operator ID leaves without its three secret characters (EN 4709-002): they must not be stored or
shown, and whoever writes JSON stores or shows it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final

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
from wonderland_remote_id.errors import FieldError, MessageTypeError, PackError
from wonderland_remote_id.messages import (
    Authentication,
    BasicId,
    Location,
    Message,
    OperatorId,
    Pack,
    SelfId,
    System,
)
from wonderland_remote_id.operators import public_operator_id

TYPES: Final[dict[str, type[Any]]] = {
    "basic_id": BasicId,
    "location": Location,
    "authentication": Authentication,
    "self_id": SelfId,
    "system": System,
    "operator_id": OperatorId,
    "pack": Pack,
}
_NAMES: Final = {kind: name for name, kind in TYPES.items()}
_ENUMS: Final[dict[str, type[IntEnum]]] = {
    "id_type": IdType,
    "ua_type": UaType,
    "status": OperationalStatus,
    "height_reference": HeightReference,
    "horizontal_accuracy": HorizontalAccuracy,
    "vertical_accuracy": VerticalAccuracy,
    "pressure_altitude_accuracy": VerticalAccuracy,
    "speed_accuracy": SpeedAccuracy,
    "authentication_type": AuthenticationType,
    "description_type": DescriptionType,
    "operator_location": OperatorLocationType,
    "classification": ClassificationType,
    "category": CategoryEu,
    "uas_class": ClassEu,
    "version": ProtocolVersion,
}
_TEXTS: Final = frozenset({"uas_id", "text", "operator_id"})
_FIELDS: Final = {kind: {field.name: field for field in dataclasses.fields(kind)} for kind in _NAMES}


def to_json(message: Message | Pack) -> dict[str, Any]:
    """A JSON object with ``type`` and the message's fields; a pack has ``messages``."""
    document: dict[str, Any] = {"type": _NAMES[type(message)]}
    if isinstance(message, Pack):
        document["version"] = message.version.name.lower()
        document["messages"] = [to_json(inner) for inner in message.messages]
        return document
    for name in _FIELDS[type(message)]:
        value = getattr(message, name)
        if isinstance(value, IntEnum):
            value = value.name.lower()
        elif isinstance(value, bytes):
            value = value.hex()
        elif name == "operator_id":
            value = public_operator_id(value)
        document[name] = value
    return document


def from_json(document: object) -> Message | Pack:
    """The message in a JSON object as `to_json` makes it; missing keys have their defaults.

    Raises `RemoteIdError` for anything else. Whether the values fit into a frame is for `encode` to say.
    """
    if not isinstance(document, Mapping):
        raise MessageTypeError(f"a message is a JSON object, not {_kind(document)}")
    name = document.get("type")
    kind = TYPES.get(name) if isinstance(name, str) else None
    if kind is None:
        raise MessageTypeError(f"type {name!r:.40}; known are {', '.join(TYPES)}")
    unknown = next((key for key in document if key != "type" and key not in _FIELDS[kind]), None)
    if unknown is not None:
        raise FieldError(str(unknown)[:40], f"is no field of {name}; known are {', '.join(_FIELDS[kind])}")
    if kind is Pack:
        return _pack(document)
    values: dict[str, Any] = {}
    for key, field in _FIELDS[kind].items():
        if key in document:
            values[key] = _value(key, document[key], optional=field.default is None or key == "t_ms")
        elif field.default is dataclasses.MISSING:
            raise FieldError(key, f"is missing in a message of type {name}")
    message: Message = kind(**values)
    return message


def _pack(document: Mapping[str, Any]) -> Pack:
    inner = document.get("messages")
    if not isinstance(inner, list):
        raise PackError("messages is not a list")
    messages = []
    for index, entry in enumerate(inner[:16]):
        message = from_json(entry)
        if isinstance(message, Pack):
            raise PackError("a pack cannot hold a pack", index=index)
        messages.append(message)
    version = document.get("version", ProtocolVersion.F3411_22A.name)
    return Pack(messages=tuple(messages), version=ProtocolVersion(_enum("version", version, ProtocolVersion)))


def _value(name: str, value: object, *, optional: bool) -> object:
    if name in _TEXTS:
        if not isinstance(value, str):
            raise FieldError(name, f"is a text, not {_kind(value)}")
        return value
    if name in _ENUMS:
        if name == "description_type" and isinstance(value, int) and not isinstance(value, bool):
            return value
        return _enum(name, value, _ENUMS[name])
    if name == "data":
        if not isinstance(value, str) or len(value) > 512:
            raise FieldError(name, "is bytes as hexadecimal digits")
        try:
            return bytes.fromhex(value)
        except ValueError:
            raise FieldError(name, "is bytes as hexadecimal digits") from None
    if value is None and optional:
        return None
    if isinstance(value, bool) or not isinstance(value, int):
        raise FieldError(name, f"is a whole number{' or null' if optional else ''}, not {_kind(value)}")
    return value


def _enum(name: str, value: object, members: type[IntEnum]) -> IntEnum:
    found = members.__members__.get(value.upper()) if isinstance(value, str) else None
    if found is None:
        known = ", ".join(members.__members__).lower()
        raise FieldError(name, f"{value!r:.40}; known are {known}")
    return found


def _kind(value: object) -> str:
    return "null" if value is None else type(value).__name__
