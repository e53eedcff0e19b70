"""Reading foreign JSON, field by field: what is not expected is refused by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

from wonderland.proofs import encoding
from wonderland.proofs.errors import EncodingError
from wonderland_evidence.errors import UnreadableError

MAX_LIST: Final = 100_000
T = TypeVar("T")


class Fields:
    """A JSON object, of which every field must be taken."""

    def __init__(self, value: Any, path: str) -> None:
        if not isinstance(value, dict):
            raise wrong(path or "the file", "is no JSON object")
        self._value: Mapping[str, Any] = value
        self._path = path
        self._taken: set[str] = set()

    def has(self, name: str) -> bool:
        """Whether an optional field is there."""
        return name in self._value

    def text(self, name: str, *, limit: int = 512) -> str:
        """A text of 1 to `limit` characters."""
        value = self._take(name)
        if not isinstance(value, str) or not 1 <= len(value) <= limit:
            raise wrong(self._name(name), f"is no text of 1 to {limit} characters")
        return value

    def number(self, name: str) -> int:
        """An integer from 0 on."""
        value = self._take(name)
        if type(value) is not int or value < 0:
            raise wrong(self._name(name), "is no integer from 0 on")
        return value

    def octets(self, name: str) -> bytes:
        """Bytes, as base64url."""
        return octets(self._take(name), self._name(name))

    def octets_list(self, name: str) -> tuple[bytes, ...]:
        """A list of those, at least one."""
        found = self._list(name)
        if not found:
            raise wrong(self._name(name), "is empty")
        return tuple(octets(each, f"{self._name(name)}[{index}]") for index, each in enumerate(found))

    def fields(self, name: str) -> Fields:
        """An object within."""
        return Fields(self._take(name), self._name(name))

    def each(self, name: str, read: Callable[[Fields], T]) -> tuple[T, ...]:
        """A list of objects."""
        found = []
        for index, each in enumerate(self._list(name)):
            fields = Fields(each, f"{self._name(name)}[{index}]")
            found.append(read(fields))
            fields.end()
        return tuple(found)

    def names(self) -> Sequence[str]:
        """All fields' names, where they are not known beforehand."""
        return tuple(self._value)

    def end(self) -> None:
        """Nothing may be left."""
        left = sorted(set(self._value) - self._taken)
        if left:
            raise wrong(self._name(left[0]), "is no field of this format")

    def wrong(self, name: str, why: str) -> UnreadableError:
        """The error that names a field."""
        return wrong(self._name(name), why)

    def _list(self, name: str) -> list[Any]:
        value = self._take(name)
        if not isinstance(value, list) or len(value) > MAX_LIST:
            raise wrong(self._name(name), f"is no list of up to {MAX_LIST}")
        return value

    def _take(self, name: str) -> Any:
        if name not in self._value:
            raise wrong(self._name(name), "is missing")
        self._taken.add(name)
        return self._value[name]

    def _name(self, name: str) -> str:
        return f"{self._path}.{name[:60]}" if self._path else name[:60]


def octets(value: Any, path: str) -> bytes:
    """Bytes from base64url."""
    if not isinstance(value, str):
        raise wrong(path, "is no text")
    try:
        return encoding.from_base64url(value)
    except EncodingError as cause:
        raise wrong(path, str(cause)) from cause


def wrong(path: str, why: str) -> UnreadableError:
    """The error that names a field."""
    return UnreadableError("wrong_field", f"{path} {why}")
