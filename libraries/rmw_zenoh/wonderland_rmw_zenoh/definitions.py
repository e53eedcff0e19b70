"""Definitions of ROS 2 interfaces (.msg, .srv, .action): read with limits, and put together with all they are made of.

A text may come from a ledger, and so from anybody. Only names, types and lengths that were checked go on to `rosbags`,
which generates code from them; constants and default values, which no message carries, do not.
"""

from __future__ import annotations

import dataclasses
import keyword
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wonderland_rmw_zenoh.errors import DefinitionError
from wonderland_rmw_zenoh.wire import is_type

MAX_CHARACTERS: Final = 128 * 1024
MAX_FIELDS: Final = 2_000
MAX_DEPTH: Final = 24
MAX_FIXED: Final = 65_536
"""Elements of an array of fixed length, as a field says it."""
MAX_FIXED_COMPLEX: Final = 1_024
"""The same of strings and of messages, which cost code each."""
MAX_LEAST_BYTES: Final = 1 << 24
MAX_BOUND: Final = 2**32 - 1
SEPARATOR: Final = "=" * 80
_SIZES: Final = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32", "string"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
"""Bytes of what is built in; of a text its length alone."""
BUILT_IN: Final = frozenset(_SIZES)
_NAME: Final = re.compile(r"[a-zA-Z][a-zA-Z0-9_]{0,127}")
_FIELD_TYPE: Final = re.compile(
    r"([a-zA-Z][a-zA-Z0-9_]*(?:/[a-zA-Z0-9_]+){0,2})(?:<=(\d{1,10}))?(?:\[(<=)?(\d{0,9})\])?"
)
_CONSTANT: Final = re.compile(r"\S+\s+[A-Z][A-Z0-9_]*\s*=.*")

Array = Literal["none", "fixed", "bounded", "any"]


@dataclass(frozen=True, slots=True)
class Field:
    """A field: its type without an array's brackets, these, and what bounds a text (0: nothing)."""

    type: str
    name: str
    array: Array = "none"
    length: int = 0
    text_bound: int = 0

    def line(self) -> str:
        """As a definition has it."""
        of = f"{self.type}<={self.text_bound}" if self.text_bound else self.type
        length = {"none": "", "any": "[]", "fixed": f"[{self.length}]", "bounded": f"[<={self.length}]"}[self.array]
        return f"{of}{length} {self.name}"


EMPTY: Final = (Field("uint8", "structure_needs_at_least_one_member"),)
"""What a type without fields has on the wire, and in its hash."""


@dataclass(frozen=True, slots=True)
class Definition:
    """A type of messages with all that it is made of."""

    type: str
    fields: Mapping[str, tuple[Field, ...]]
    """By type: this one and those within it."""

    def text(self) -> str:
        """All of it, as rosbag2 stores it (``ros2msg``): each further part under a line of ``=`` and its name."""
        parts = [self.type, *sorted(self.fields.keys() - {self.type})]
        texts = ["".join(f"{each.line()}\n" for each in self.fields[part]) for part in parts]
        heads = ["", *(f"{SEPARATOR}\nMSG: {part}\n" for part in parts[1:])]
        return "".join(head + text for head, text in zip(heads, texts, strict=True))


Find = Callable[[str], "str | None"]
"""The text of a type's own fields, by its full name."""


def gathered(kind: str, find: Find) -> Definition:
    """A type and all that it is made of. Raises DefinitionError."""
    fields: dict[str, tuple[Field, ...]] = {}
    _gather(kind, find, fields, ())
    if sum(map(len, fields.values())) > MAX_FIELDS:
        raise DefinitionError(f"{kind}: more than {MAX_FIELDS} fields")
    _least_bytes(kind, fields, {})
    return Definition(kind, fields)


@lru_cache(maxsize=256)
def parse(kind: str, text: str) -> Definition:
    """A whole text, as ``Definition.text`` gives it. Raises DefinitionError."""
    if len(text) > MAX_CHARACTERS:
        raise DefinitionError(f"{kind[:100]}: a definition of {len(text)} characters; {MAX_CHARACTERS} are allowed")
    own, *others = re.split(rf"^{SEPARATOR}=*\n", text, flags=re.MULTILINE)
    texts = {kind: own}
    for other in others:
        head, _, body = other.partition("\n")
        name = full_name(head.removeprefix("MSG:").strip(), "")
        if not head.startswith("MSG:"):
            raise DefinitionError(f"{kind[:100]}: its definition has a part that begins with {head[:60]!r}, not MSG:")
        texts.setdefault(name, body)
    return gathered(kind, texts.get)


def full_name(name: str, package: str) -> str:
    """``String`` and ``std_msgs/String`` as ``std_msgs/msg/String``."""
    parts = name.split("/")
    if len(parts) == 1:
        return f"{package}/msg/{name}"
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def _gather(kind: str, find: Find, fields: dict[str, tuple[Field, ...]], within: tuple[str, ...]) -> None:
    if kind in within or len(within) >= MAX_DEPTH:
        raise DefinitionError(f"{within[0]}: {kind} is part of itself, or lies more than {MAX_DEPTH} deep")
    if kind in fields:
        return
    if not is_type(kind):
        raise DefinitionError(f"{kind[:100]!r} is no type of ROS 2 (package/msg/Type)")
    text = find(kind)
    if text is None:
        whole = f"{within[0]}: nobody here says what {kind} is" if within else f"nobody here says what {kind} is"
        raise DefinitionError(f"{whole}; name the directory of its .msg file in the settings (interfaces)")
    found = own_fields(kind, text)
    for each in found:
        if each.type not in BUILT_IN:
            _gather(each.type, find, fields, (*within, kind))
    fields[kind] = found


def own_fields(kind: str, text: str) -> tuple[Field, ...]:
    """The fields of one definition. Raises DefinitionError."""
    if len(text) > MAX_CHARACTERS:
        raise DefinitionError(f"{kind}: a definition of {len(text)} characters; {MAX_CHARACTERS} are allowed")
    fields = []
    for whole in text.splitlines():
        line = whole.partition("#")[0].strip()
        if line and not _CONSTANT.fullmatch(line):
            fields.append(_field(kind, line))
    if len({each.name for each in fields}) != len(fields):
        raise DefinitionError(f"{kind}: two fields have one name")
    return tuple(fields) or EMPTY


def _field(kind: str, line: str) -> Field:
    words = line.split(None, 2)  # a third word is a default value
    found = _FIELD_TYPE.fullmatch(words[0])
    if len(words) < 2 or found is None or not _NAME.fullmatch(words[1]):
        raise DefinitionError(f"{kind}: {line[:60]!r} is no field (type name)")
    of, text_bound, bounded, length = found.groups()
    if of in {"wstring", "time", "duration"}:
        raise DefinitionError(f"{kind}: {line[:60]!r}: {of} is not read here")
    if of not in BUILT_IN:
        of = full_name(of, kind.partition("/")[0])
    if text_bound and of != "string":
        raise DefinitionError(f"{kind}: {line[:60]!r}: only a string has a bound")
    array: Array = "none" if length is None else "any" if length == "" else "bounded" if bounded else "fixed"
    most = MAX_FIXED if of in BUILT_IN - {"string"} else MAX_FIXED_COMPLEX
    if array == "fixed" and not 0 < int(length) <= most:
        raise DefinitionError(f"{kind}: {line[:60]!r} has no element, or more than {most}")
    if int(text_bound or 0) > MAX_BOUND:
        raise DefinitionError(f"{kind}: {line[:60]!r}: no bound that ROS 2 knows")
    return Field(of, words[1], array, int(length or 0), int(text_bound or 0))


def _least_bytes(kind: str, fields: Mapping[str, tuple[Field, ...]], known: dict[str, int]) -> int:
    """What a message of a type takes at least (padding left out). Raises DefinitionError."""
    if kind not in known:
        total = 0
        for field in fields[kind]:
            one = _SIZES[field.type] if field.type in _SIZES else _least_bytes(field.type, fields, known)
            total += {"none": one, "fixed": field.length * one, "bounded": 4, "any": 4}[field.array]
        if total > MAX_LEAST_BYTES:
            raise DefinitionError(f"{kind}: a message takes at least {total} bytes; {MAX_LEAST_BYTES} are allowed")
        known[kind] = total
    return known[kind]


class Codec:
    """Messages of one definition, read and written with `rosbags`."""

    def __init__(self, definition: Definition) -> None:
        self.definition = definition
        self._store = get_typestore(Stores.EMPTY)
        self._name = _inside(definition.type)
        try:
            for kind, fields in definition.fields.items():
                lines = [dataclasses.replace(each, type=_inside(each.type)).line() for each in fields]
                self._store.register(get_types_from_msg("".join(f"{line}\n" for line in lines), _inside(kind)))
            self._store.get_msgdef(self._name)
        except Exception as cause:  # what a generator of code stumbles over is not foreseen
            raise DefinitionError(f"{definition.type}: rosbags cannot read its definition: {cause}") from cause

    def decode(self, data: bytes) -> Any:
        """A message as `rosbags` has it. Raises DefinitionError for bytes that are none."""
        try:
            return self._store.deserialize_cdr(data, self._name)
        except Exception as cause:
            raise DefinitionError(f"{len(data)} bytes are no {self.definition.type}: {cause}") from cause

    def encode(self, message: Mapping[str, Any]) -> bytes:
        """A message from its fields, by name; what is left out is 0, empty or false. Raises DefinitionError."""
        try:
            return bytes(self._store.serialize_cdr(self._made(self.definition.type, message), self._name))
        except DefinitionError:
            raise
        except Exception as cause:
            raise DefinitionError(f"no {self.definition.type}: {cause}") from cause

    def to_json(self, data: bytes) -> Any:
        """A message for people: numbers that JSON does not have (NaN, infinite) are texts. Raises DefinitionError."""
        return plain(self.decode(data))

    def _made(self, kind: str, message: Mapping[str, Any]) -> Any:
        fields = self.definition.fields[kind]
        if unknown := message.keys() - {each.name for each in fields}:
            raise DefinitionError(f"{kind} has no field {min(unknown)}")
        values = {_safe(each.name): self._value(each, message.get(each.name)) for each in fields}
        return self._store.types[_inside(kind)](**values)

    def _value(self, field: Field, value: Any) -> Any:
        if field.array == "none":
            if field.type not in BUILT_IN:
                return self._made(field.type, value or {})
            return ("" if field.type == "string" else 0) if value is None else value
        given = [] if value is None else list(value)
        if field.array == "fixed" and value is None:
            given = [None] * field.length
        if (field.array == "fixed" and len(given) != field.length) or (
            field.array == "bounded" and len(given) > field.length
        ):
            raise DefinitionError(f"{field.name} has {len(given)} elements, where {field.line()} says otherwise")
        one = dataclasses.replace(field, array="none")
        made = [self._value(one, each) for each in given]
        if field.type in BUILT_IN - {"string"}:
            return np.array(made, dtype=_DTYPES.get(field.type, field.type))
        return made


_DTYPES: Final = {"byte": "uint8", "char": "uint8"}


@lru_cache(maxsize=256)
def codec_of(kind: str, text: str) -> Codec:
    """A codec for a whole text. Raises DefinitionError."""
    return Codec(parse(kind, text))


def plain(value: Any) -> Any:
    """What `rosbags` gives as lists, texts and numbers."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value) if not field.name.startswith("__")]
        return {_own_name(name): plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list):
        return [plain(each) for each in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _inside(kind: str) -> str:
    """`rosbags` knows messages alone: those of services and actions go under names of their own."""
    if kind in BUILT_IN:
        return kind
    package, group, name = kind.split("/")
    return f"{package}/msg/{name}" if group == "msg" else f"{package}/msg/{group}_{name}"


def _safe(name: str) -> str:
    return f"{name}_" if keyword.iskeyword(name) else name


def _own_name(name: str) -> str:
    """A field that is called as a word of Python has a _ after it in `rosbags`."""
    return name[:-1] if keyword.iskeyword(name[:-1]) else name
