"""Definitions of ROS 1 messages: what a publisher says its messages look like, and the MD5 sum that this must have.

The text comes from a peer that may be anybody. It is read here with limits, its MD5 sum is worked out as ROS does it
(``genmsg``), and only names, types and lengths that were checked go on to `rosbags`, which generates code from them.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.msg import denormalize_msgtype, normalize_msgtype

from wonderland_rmw_zenoh.definitions import plain
from wonderland_ros_bridge.errors import DefinitionError

MAX_CHARACTERS: Final = 128 * 1024
MAX_FIELDS: Final = 2_000
MAX_DEPTH: Final = 24
MAX_FIXED: Final = 65_536
"""Elements of an array of fixed length, as a field says it."""
MAX_FIXED_COMPLEX: Final = 1_024
"""The same of strings and of messages, which cost code each."""
MAX_LEAST_BYTES: Final = 1 << 24
SEPARATOR: Final = "=" * 80
_SIZES: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32", "string"), 4),
    **dict.fromkeys(("int64", "uint64", "float64", "time", "duration"), 8),
}
"""Bytes of what is built in; of a text its length alone."""
BUILT_IN: Final = frozenset(_SIZES)
_TYPE: Final = re.compile(r"[a-zA-Z][a-zA-Z0-9_]*/[a-zA-Z][a-zA-Z0-9_]*")
_NAME: Final = re.compile(r"[a-zA-Z][a-zA-Z0-9_]{0,127}")
_FIELD_TYPE: Final = re.compile(r"([a-zA-Z][a-zA-Z0-9_]*(?:/[a-zA-Z][a-zA-Z0-9_]*)?)(\[(\d{0,9})\])?")


@dataclass(frozen=True, slots=True)
class Field:
    """A field: its type without an array's brackets, and these (empty, ``[]`` or ``[9]``)."""

    type: str
    array: str
    name: str


@dataclass(frozen=True, slots=True)
class Definition:
    """A message type with all that it is made of."""

    type: str
    md5: str
    text: str
    fields: Mapping[str, tuple[Field, ...]]
    """By type: this one and those within it."""


def is_type(name: str) -> bool:
    """Whether this is ``package/Type``."""
    return len(name) <= 128 and _TYPE.fullmatch(name) is not None


@lru_cache(maxsize=256)
def parse(kind: str, text: str) -> Definition:
    """What a publisher says in ``message_definition``. Raises DefinitionError."""
    if not is_type(kind):
        raise DefinitionError(f"{kind[:60]!r} is no type of message (package/Type)")
    if len(text) > MAX_CHARACTERS:
        raise DefinitionError(f"{kind}: a definition of {len(text)} characters; {MAX_CHARACTERS} are allowed")
    own, *others = re.split(rf"^{SEPARATOR}=*\n", text, flags=re.MULTILINE)
    texts = {kind: own}
    for other in others:
        head, _, body = other.partition("\n")
        name = head.removeprefix("MSG:").strip()
        if not head.startswith("MSG:") or not is_type(name):
            raise DefinitionError(f"{kind}: its definition has a part that begins with {head[:60]!r}, not MSG: a type")
        texts.setdefault(name, body)
    parts = {name: _lines(name, body) for name, body in texts.items()}
    if sum(len(fields) for fields, _ in parts.values()) > MAX_FIELDS:
        raise DefinitionError(f"{kind}: more than {MAX_FIELDS} fields")
    used: dict[str, tuple[Field, ...]] = {}
    md5 = _md5(kind, parts, used, ())
    _least_bytes(kind, used, {})
    return Definition(kind, md5, text, used)


def _least_bytes(kind: str, fields: Mapping[str, tuple[Field, ...]], known: dict[str, int]) -> int:
    """What a message of a type takes at least. Raises DefinitionError.

    An element of an array takes a byte or more, so that a message has no more elements than bytes: four bytes that
    announce thousands of millions of nothings, or arrays of arrays of nothing, would fill the memory.
    """
    if kind not in known:
        total = 0
        for field in fields[kind]:
            one = _SIZES[field.type] if field.type in _SIZES else _least_bytes(field.type, fields, known)
            if field.array and not one:
                raise DefinitionError(f"{kind}: {field.name} is an array of {field.type}, which has no fields")
            length = field.array.strip("[]")
            total += int(length) * one if length else 4 if field.array else one
        if total > MAX_LEAST_BYTES:
            raise DefinitionError(f"{kind}: a message takes at least {total} bytes; {MAX_LEAST_BYTES} are allowed")
        known[kind] = total
    return known[kind]


def _lines(kind: str, text: str) -> tuple[tuple[Field, ...], tuple[str, ...]]:
    """Fields, and constants as the MD5 sum is over them."""
    fields, constants = [], []
    package = kind.partition("/")[0]
    for whole in text.splitlines():
        line = whole.partition("#")[0].strip()
        if not line:
            continue
        words = line.split()
        if "=" in line:
            constants.append(_constant(kind, whole, line, words[0]))
            continue
        found = _FIELD_TYPE.fullmatch(words[0])
        if len(words) != 2 or found is None or not _NAME.fullmatch(words[1]):
            raise DefinitionError(f"{kind}: {line[:60]!r} is no field (type name)")
        of, array, length = found.groups()
        if of == "Header":
            of = "std_msgs/Header"
        elif of not in BUILT_IN and "/" not in of:
            of = f"{package}/{of}"
        most = MAX_FIXED if of in BUILT_IN - {"string"} else MAX_FIXED_COMPLEX
        if length and int(length) > most:
            raise DefinitionError(f"{kind}: {line[:60]!r} has more than {most} elements")
        fields.append(Field(of, array or "", words[1]))
    if len({field.name for field in fields}) != len(fields):
        raise DefinitionError(f"{kind}: two fields have one name")
    return tuple(fields), tuple(constants)


def _constant(kind: str, whole: str, line: str, of: str) -> str:
    if of == "string":  # all that follows is its value, a # too
        name, _, value = whole.strip().partition("=")
    else:
        name, _, value = line.partition("=")
    words = name.split()
    if of not in BUILT_IN or len(words) != 2 or not _NAME.fullmatch(words[1]):
        raise DefinitionError(f"{kind}: {line[:60]!r} is no constant (type name=value)")
    return f"{of} {words[1]}={value.strip()}"


def _md5(
    kind: str,
    parts: Mapping[str, tuple[tuple[Field, ...], tuple[str, ...]]],
    used: dict[str, tuple[Field, ...]],
    within: tuple[str, ...],
    known: dict[str, str] | None = None,
) -> str:
    known = {} if known is None else known
    if kind in known:
        return known[kind]
    if kind in within or len(within) >= MAX_DEPTH:
        raise DefinitionError(f"{within[0]}: {kind} is part of itself, or lies more than {MAX_DEPTH} deep")
    if kind not in parts:
        raise DefinitionError(f"{within[0] if within else kind}: its definition does not say what {kind} is")
    fields, constants = parts[kind]
    lines = list(constants)
    for field in fields:
        if field.type in BUILT_IN:
            lines.append(f"{field.type}{field.array} {field.name}")
        else:
            lines.append(f"{_md5(field.type, parts, used, (*within, kind), known)} {field.name}")
    used[kind] = fields
    known[kind] = hashlib.md5("\n".join(lines).encode(), usedforsecurity=False).hexdigest()
    return known[kind]


class Codec:
    """Messages of one definition, read and written with `rosbags`."""

    def __init__(self, definition: Definition) -> None:
        self.definition = definition
        self._store = get_typestore(Stores.EMPTY)
        self._name = normalize_msgtype(definition.type)
        try:
            for kind, fields in definition.fields.items():
                text = "".join(f"{field.type}{field.array} {field.name}\n" for field in fields)
                self._store.register(get_types_from_msg(text, normalize_msgtype(kind)))
            self._store.get_msgdef(self._name)
        except Exception as cause:  # what a generator of code stumbles over is not foreseen
            raise DefinitionError(f"{definition.type}: rosbags cannot read its definition: {cause}") from cause

    def decode(self, data: bytes) -> Any:
        """The message as `rosbags` has it. Raises DefinitionError for bytes that are none."""
        try:
            return self._store.deserialize_ros1(data, self._name)
        except Exception as cause:
            raise DefinitionError(f"{len(data)} bytes are no {self.definition.type}: {cause}") from cause

    def to_json(self, data: bytes) -> Any:
        """A message for people: numbers that JSON does not have (NaN, infinite) are texts. Raises DefinitionError."""
        return plain(self.decode(data))


@lru_cache(maxsize=256)
def codec(kind: str, text: str) -> Codec:
    """A codec for what a publisher says its messages look like. Raises DefinitionError."""
    return Codec(parse(kind, text))


@lru_cache(maxsize=256)
def standard(kind: str) -> str | None:
    """The definition of a type of ROS Noetic's standard packages; None for another."""
    store = get_typestore(Stores.ROS1_NOETIC)
    name = normalize_msgtype(kind)
    if name not in store.fielddefs:
        return None
    parts: dict[str, tuple[str, str]] = {}
    text, _ = store.gendefhash(name, parts)
    return text + "".join(f"{SEPARATOR}\nMSG: {denormalize_msgtype(part)}\n{of}" for part, (of, _) in parts.items())
