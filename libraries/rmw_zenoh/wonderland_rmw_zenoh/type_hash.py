"""Type hashes (RIHS01, REP-2011): SHA-256 over a type's description, so that both ends mean the same bytes. Pure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Final

from wonderland_rmw_zenoh.definitions import Definition, Field

_NESTED: Final = 1
_STRING: Final = 17
_BOUNDED_STRING: Final = 21
_IDS: Final = {
    "int8": 2,
    "uint8": 3,
    "char": 3,  # of a .msg file: rosidl makes it a uint8
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": _STRING,
}
_ARRAYS: Final = {"none": 0, "fixed": 48, "bounded": 96, "any": 144}


def type_hash(definition: Definition) -> str:
    """``RIHS01_`` and 64 hexadecimal digits."""
    return _hash(definition.type, definition.fields)


def service_hash(kind: str, request: Definition, response: Definition, event_info: Definition) -> str:
    """Of a service, which is a type with a request, a response and an event (of ``service_msgs``)."""
    fields = {**request.fields, **response.fields, **event_info.fields}
    event = f"{kind}_Event"
    fields[event] = (
        Field(event_info.type, "info"),
        Field(request.type, "request", "bounded", 1),
        Field(response.type, "response", "bounded", 1),
    )
    fields[kind] = (
        Field(request.type, "request_message"),
        Field(response.type, "response_message"),
        Field(event, "event_message"),
    )
    return _hash(kind, fields)


def _hash(kind: str, fields: Mapping[str, tuple[Field, ...]]) -> str:
    description = {
        "type_description": _individual(kind, fields[kind]),
        "referenced_type_descriptions": [_individual(each, fields[each]) for each in sorted(fields) if each != kind],
    }
    return f"RIHS01_{hashlib.sha256(json.dumps(description).encode()).hexdigest()}"


def _individual(kind: str, fields: tuple[Field, ...]) -> dict[str, Any]:
    return {"type_name": kind, "fields": [{"name": each.name, "type": _type(each)} for each in fields]}


def _type(field: Field) -> dict[str, Any]:
    nested = field.type not in _IDS
    one = _NESTED if nested else _BOUNDED_STRING if field.text_bound else _IDS[field.type]
    return {
        "type_id": one + _ARRAYS[field.array],
        "capacity": field.length,
        "string_capacity": field.text_bound,
        "nested_type_name": field.type if nested else "",
    }
