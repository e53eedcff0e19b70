"""One definition for each record: a frozen dataclass whose annotations are its check and its JSON Schema.

The contract may not depend on a validation library (it has to give the same answer for decades and on every
endorser), so this is the small one that it needs: integers with bounds, strings with a pattern or an enumeration,
base64url bytes with a length, booleans, records, lists of these, named facts, and optional fields, which are left out.

>>> @dataclass(frozen=True, kw_only=True, slots=True)
... class Point(Record):
...     east_mm: Annotated[int, Integer(-1_000_000, 1_000_000, "East of the pad's origin")]
>>> Point.parse({"east_mm": 5}).to_json()
{'east_mm': 5}
"""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar, Final, Self

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError, RecordError

Check = Callable[[Any, str], Any]
_FACT: Final = r"[a-z][a-z0-9_]*"


@dataclass(frozen=True)
class Integer:
    """An integer within [minimum, maximum], both included."""

    minimum: int
    maximum: int
    description: str = ""

    def check(self, value: Any, path: str) -> int:
        """The value itself, or a RecordError."""
        if type(value) is not int:
            raise RecordError(path, f"expected an integer, got {_kind(value)}")
        if not self.minimum <= value <= self.maximum:
            raise RecordError(path, f"{value} is outside of {self.minimum}..{self.maximum}")
        return value

    def holds_for_all(self, values: Sequence[Any]) -> bool:
        """Whether every one would pass; for long columns of ranges, without a call for each."""
        return (
            bool(values)
            and set(map(type, values)) == {int}
            and self.minimum <= min(values)
            and max(values) <= self.maximum
        )

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        return _described({"type": "integer", "minimum": self.minimum, "maximum": self.maximum}, self.description)


@dataclass(frozen=True)
class Text:
    """A string of at most ``max_length`` characters that matches ``pattern`` as a whole."""

    max_length: int
    pattern: str = r"[^\x00-\x1f\x7f]*"
    description: str = ""
    min_length: int = 0

    def check(self, value: Any, path: str) -> str:
        """The value itself, or a RecordError."""
        if not isinstance(value, str):
            raise RecordError(path, f"expected a string, got {_kind(value)}")
        if not self.min_length <= len(value) <= self.max_length:
            raise RecordError(path, f"{len(value)} characters, allowed are {self.min_length}..{self.max_length}")
        if _compiled(self.pattern).fullmatch(value) is None:
            raise RecordError(path, f"{value[:60]!r} does not match {self.pattern}")
        return value

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        return _described(
            {
                "type": "string",
                "minLength": self.min_length,
                "maxLength": self.max_length,
                "pattern": f"^(?:{self.pattern})$",
            },
            self.description,
        )


@dataclass(frozen=True)
class Choice:
    """One of a few strings."""

    options: tuple[str, ...]
    description: str = ""

    def check(self, value: Any, path: str) -> str:
        """The value itself, or a RecordError."""
        if not isinstance(value, str) or value not in self.options:
            shown = repr(value)[:60] if isinstance(value, str) else _kind(value)
            raise RecordError(path, f"{shown} is none of {', '.join(self.options)}")
        return value

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        return _described({"type": "string", "enum": list(self.options)}, self.description)


@dataclass(frozen=True)
class Flag:
    """True or false."""

    description: str = ""

    def check(self, value: Any, path: str) -> bool:
        """The value itself, or a RecordError."""
        if not isinstance(value, bool):
            raise RecordError(path, f"expected true or false, got {_kind(value)}")
        return value

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        return _described({"type": "boolean"}, self.description)


@dataclass(frozen=True)
class Binary:
    """Bytes as base64url without padding; ``min_bytes`` to ``max_bytes`` of them. The record keeps the text."""

    min_bytes: int
    max_bytes: int
    description: str = ""

    def check(self, value: Any, path: str) -> str:
        """The text itself, or a RecordError."""
        if not isinstance(value, str):
            raise RecordError(path, f"expected base64url text, got {_kind(value)}")
        if len(value) > (self.max_bytes * 4 + 2) // 3:
            raise RecordError(path, f"more than {self.max_bytes} bytes")
        try:
            size = len(encoding.from_base64url(value))
        except EncodingError as error:
            raise RecordError(path, str(error)) from None
        if not self.min_bytes <= size <= self.max_bytes:
            raise RecordError(path, f"{size} bytes, allowed are {self.min_bytes}..{self.max_bytes}")
        return value

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        return _described(
            {
                "type": "string",
                "contentEncoding": "base64url",
                "pattern": "^[A-Za-z0-9_-]*$",
                "maxLength": (self.max_bytes * 4 + 2) // 3,
            },
            self.description,
        )


@dataclass(frozen=True)
class Facts:
    """An object of a few integers and short texts, each with a name of its own."""

    maximum: int = 8
    max_length: int = 600
    description: str = ""

    def check(self, value: Any, path: str) -> dict[str, int | str]:
        """The value itself, or a RecordError."""
        if not isinstance(value, dict):
            raise RecordError(path, f"expected an object, got {_kind(value)}")
        if len(value) > self.maximum:
            raise RecordError(path, f"{len(value)} facts, allowed are {self.maximum}")
        name, integer, text = (
            Text(32, _FACT),
            Integer(-encoding.MAX_INTEGER, encoding.MAX_INTEGER),
            Text(self.max_length),
        )
        for key, item in value.items():
            name.check(key, path)
            (text if isinstance(item, str) else integer).check(item, f"{path}.{key}")
        return value

    def schema(self) -> dict[str, Any]:
        """JSON Schema (2020-12)."""
        bounds = {"minimum": -encoding.MAX_INTEGER, "maximum": encoding.MAX_INTEGER}
        values = [{"type": "integer", **bounds}, {"type": "string", "maxLength": self.max_length}]
        return _described(
            {
                "type": "object",
                "maxProperties": self.maximum,
                "propertyNames": {"pattern": f"^(?:{_FACT})$", "maxLength": 32},
                "additionalProperties": {"anyOf": values},
            },
            self.description,
        )


@dataclass(frozen=True)
class Items:
    """Bounds of a list; stands beside the element's type: ``Annotated[tuple[Anchor, ...], Items(3, 16)]``."""

    minimum: int
    maximum: int
    description: str = ""
    of: Integer | Text | Choice | Binary | None = None
    """The check of plain elements, where they are no records."""


@dataclass(frozen=True)
class Described:
    """Says what a nested record is for."""

    description: str


class Record:
    """Base of all records: checked construction from JSON, and back."""

    __slots__ = ()
    RECORD: ClassVar[str] = ""
    """Name in the reference and in ``$id``; the class name where empty."""
    REFUSED: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Names that look like fields and must never be, and why; the value is not repeated."""

    @classmethod
    def parse(cls, value: Any, path: str = "") -> Self:
        """The record in ``value`` (a decoded JSON object); raises RecordError and names the field."""
        if not isinstance(value, dict):
            raise RecordError(path, f"expected an object, got {_kind(value)}")
        checks, required = _checks(_key(cls))
        prefix = f"{path}." if path else ""
        arguments = {}
        for name, item in value.items():
            check = checks.get(name)
            if check is None:
                why = cls.REFUSED.get(name) or f"unknown field; known are {', '.join(sorted(checks))}"
                raise RecordError(prefix + str(name)[:60], why)
            arguments[name] = check(item, prefix + name)
        for name in required:
            if name not in arguments:
                raise RecordError(prefix + name, "missing")
        record = cls(**arguments)
        record.validate(path)
        return record

    @classmethod
    def decode(cls, data: bytes | str, *, max_bytes: int = encoding.MAX_BYTES) -> Self:
        """The record in a JSON text; raises EncodingError or RecordError."""
        return cls.parse(encoding.decode(data, max_bytes=max_bytes))

    def validate(self, path: str) -> None:
        """Checks that concern more than one field; raises RecordError."""

    def to_json(self) -> dict[str, Any]:
        """The JSON object of this record; fields that are None are left out."""
        result: dict[str, Any] = {}
        for name in _names(_key(type(self))):
            value = getattr(self, name)
            if value is not None:
                result[name] = _plain(value)
        return result

    def encode(self) -> bytes:
        """Canonical bytes."""
        return encoding.encode(self.to_json())

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """JSON Schema (2020-12) of this record, nested records in place."""
        hints = typing.get_type_hints(cls, include_extras=True)
        _, required = _checks(_key(cls))
        properties = {field.name: _schema_of(hints[field.name]) for field in fields(cls)}  # type: ignore[arg-type]
        return {
            "title": cls.RECORD or cls.__name__,
            "description": (cls.__doc__ or "").strip().split("\n\n")[0],
            "type": "object",
            "additionalProperties": False,
            "properties": properties,
            "required": list(required),
        }


def _plain(value: Any) -> Any:
    if isinstance(value, Record):
        return value.to_json()
    if isinstance(value, tuple):
        if value and type(value[0]) is int:  # a column of ranges: one type throughout, as its field says
            return list(value)
        return [_plain(item) for item in value]
    return value


def _key(cls: type[Record]) -> Any:
    """The class as a cache key: mypy holds a class whose instances compare by value for unhashable."""
    return cls


@cache
def _names(cls: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(cls))


@cache
def _checks(cls: Any) -> tuple[dict[str, Check], tuple[str, ...]]:
    hints = typing.get_type_hints(cls, include_extras=True)
    checks = {field.name: _check_of(hints[field.name]) for field in fields(cls)}
    required = tuple(
        field.name for field in fields(cls) if field.default is MISSING and field.default_factory is MISSING
    )
    return checks, required


def _parts(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """(type, annotations) of a field, with ``| None`` taken off."""
    annotations: tuple[Any, ...] = ()
    if typing.get_origin(hint) is typing.Annotated:
        hint, *extra = typing.get_args(hint)
        annotations = tuple(extra)
    if typing.get_origin(hint) in {types.UnionType, typing.Union}:
        (hint,) = [part for part in typing.get_args(hint) if part is not type(None)]
        if typing.get_origin(hint) is typing.Annotated:
            return _parts(hint)
    return hint, annotations


def _check_of(hint: Any) -> Check:
    kind, annotations = _parts(hint)
    bounds = next((item for item in annotations if isinstance(item, Items)), None)
    if bounds is not None:
        element = typing.get_args(kind)[0]
        check_element: Check = bounds.of.check if bounds.of is not None else element.parse
        return _list_check(bounds, check_element)
    if isinstance(kind, type) and issubclass(kind, Record):
        return kind.parse
    for item in annotations:
        if isinstance(item, Integer | Text | Choice | Flag | Binary | Facts):
            return item.check
    if kind is bool:
        return Flag().check
    raise TypeError(f"a record's field has no check: {hint}")


def _list_check(bounds: Items, check_element: Check) -> Check:
    integer = bounds.of if isinstance(bounds.of, Integer) else None

    def check(value: Any, path: str) -> Any:
        if not isinstance(value, list | tuple):
            raise RecordError(path, f"expected a list, got {_kind(value)}")
        if not bounds.minimum <= len(value) <= bounds.maximum:
            raise RecordError(path, f"{len(value)} items, allowed are {bounds.minimum}..{bounds.maximum}")
        if integer is not None and integer.holds_for_all(value):
            return tuple(value)
        return tuple(check_element(item, f"{path}[{index}]") for index, item in enumerate(value))

    return check


def _schema_of(hint: Any) -> dict[str, Any]:
    kind, annotations = _parts(hint)
    described = next((item.description for item in annotations if isinstance(item, Described)), "")
    bounds = next((item for item in annotations if isinstance(item, Items)), None)
    if bounds is not None:
        element = typing.get_args(kind)[0]
        items = bounds.of.schema() if bounds.of is not None else element.json_schema()
        schema = {"type": "array", "items": items, "minItems": bounds.minimum, "maxItems": bounds.maximum}
        return _described(schema, bounds.description)
    if isinstance(kind, type) and issubclass(kind, Record):
        schema = kind.json_schema()
        return _described(schema, described) if described else schema
    for item in annotations:
        if isinstance(item, Integer | Text | Choice | Flag | Binary | Facts):
            return item.schema()
    return {"type": "boolean"}


def _described(schema: dict[str, Any], description: str) -> dict[str, Any]:
    return {**schema, "description": description} if description else schema


def _kind(value: Any) -> str:
    names: Final = {bool: "a boolean", int: "an integer", str: "a string", dict: "an object", list: "a list"}
    return names.get(type(value), type(value).__name__)


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern)
