"""Classes of messages as rosidl's generated ones are used: made of texts, read by rosbags."""

from __future__ import annotations

from functools import cache

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PACKAGES: dict[str, dict[str, str]] = {
    "builtin_interfaces": {"Time": "int32 sec\nuint32 nanosec\n", "Duration": "int32 sec\nuint32 nanosec\n"},
    "std_msgs": {"Bool": "bool data\n", "Empty": "\n"},
}
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_STORE = get_typestore(Stores.EMPTY)


@cache
def fields_of(kind):
    """Constants and fields of a type."""
    package, _, name = kind.split("/")
    return get_types_from_msg(PACKAGES[package][name], kind)[kind]


def within(kind):
    """The types within a type, and theirs, by name: their texts."""
    found = {}
    for _, (node, of) in fields_of(kind)[1]:
        inner = of if node == _NAME else of[0][1] if node in {_ARRAY, _SEQUENCE} and of[0][0] == _NAME else None
        if inner is not None:
            package, _, name = inner.split("/")
            found |= {inner: PACKAGES[package][name], **within(inner)}
    return found


def classes_of(package):
    return {name: class_of(f"{package}/msg/{name}") for name in PACKAGES[package]}


@cache
def class_of(kind):
    constants, fields = fields_of(kind)

    def start(self, **values):
        for name, of in fields:
            setattr(self, name, values.pop(name) if name in values else _nothing(of))
        assert not values, f"{kind} has no {', '.join(values)}"

    body = {name: value for name, _, value in constants} | {"__init__": start, "kind": kind}
    return type(kind.rsplit("/", 1)[1], (), body)


def _nothing(of):
    node, inner = of
    if node == _NAME:
        return class_of(inner)()
    if node == _BASE:
        return {"string": "", "bool": False}.get(inner[0], 0.0 if inner[0].startswith("float") else 0)
    return []


def as_sent(store, kind, message):
    """The message as a rosbags store has it."""
    return store.types[kind](**{name: _sent(store, of, getattr(message, name)) for name, of in fields_of(kind)[1]})


def _sent(store, of, value):
    node, inner = of
    if node == _NAME:
        return as_sent(store, inner, value)
    if node == _BASE:
        return value
    if inner[0][0] == _BASE and inner[0][1][0] != "string":
        return np.array(value, dtype=inner[0][1][0])
    return [_sent(store, inner[0], each) for each in value]
