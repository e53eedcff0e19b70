"""One value of a file under way: taken as what it must be, or its error noted. A wrong value is None from then on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from wonderland_backend.zones.files.findings import Findings
from wonderland_backend.zones.files.lines import Path

_KINDS = {dict: "an object", list: "a list", str: "a text", bool: "true or false", int: "a number", float: "a number"}


class Node:
    """A value, where it stands, and the findings that its errors go to."""

    __slots__ = ("findings", "path", "value")

    def __init__(self, value: Any, path: Path, findings: Findings) -> None:
        self.value = value
        self.path = path
        self.findings = findings

    def error(self, message: str) -> None:
        """Note an error here."""
        self.findings.error(self.path, message)

    def notice(self, message: str) -> None:
        """Note something that was understood all the same."""
        self.findings.notice(self.path, message)

    def at(self, key: str | int) -> Node:
        """A member or an item that is there."""
        return Node(self.value[key], (*self.path, key), self.findings)

    def has(self, name: str) -> bool:
        """Whether the object has this member, and it is not null."""
        return isinstance(self.value, dict) and self.value.get(name) is not None

    def maybe(self, name: str) -> Node | None:
        """The member, if it is there and not null."""
        return self.at(name) if self.has(name) else None

    def need(self, name: str) -> Node | None:
        """The member; an error where it is missing."""
        found = self.maybe(name)
        if found is None:
            self.findings.error((*self.path, name), f"`{name}` is missing here; add it")
        return found

    def is_object(self) -> bool:
        """Whether it is an object; else an error."""
        return self._is(dict)

    def items(self, minimum: int, maximum: int) -> Iterator[Node]:
        """The items of a list of this many; else an error and none."""
        if not self._is(list):
            return
        count = len(self.value)
        if not minimum <= count <= maximum:
            self.error(f"{count} items; allowed are {minimum} to {maximum}")
            return
        for index in range(count):
            yield self.at(index)

    def text(self, maximum: int, minimum: int = 0) -> str | None:
        """A text of printable characters and line ends."""
        if not self._is(str):
            return None
        text: str = self.value
        if not minimum <= len(text) <= maximum:
            self.error(f"{len(text)} characters; allowed are {minimum} to {maximum}")
            return None
        if any(ord(each) < 32 and each not in "\n\r\t" for each in text):
            self.error("control characters; remove them")
            return None
        return text

    def choice(self, options: Sequence[str]) -> str | None:
        """One of these texts."""
        if not self._is(str):
            return None
        if self.value not in options:
            self.error(f"{self.value[:40]!r} is none of {', '.join(options)}")
            return None
        return str(self.value)

    def number(self, minimum: float, maximum: float) -> float | None:
        """A number within these bounds."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            self._wrong("a number")
            return None
        if not math.isfinite(self.value) or not minimum <= self.value <= maximum:
            self.error(f"{self.value} is outside of {minimum:g} to {maximum:g}")
            return None
        return self.value

    def known(self, names: Sequence[str], advice: str) -> None:
        """An error for each member that is none of these."""
        for name in self.value:
            if name not in names:
                self.at(name).error(f"`{name[:60]}` is not known here; {advice}")

    def _is(self, kind: type) -> bool:
        if isinstance(self.value, kind):
            return True
        self._wrong(_KINDS[kind])
        return False

    def _wrong(self, expected: str) -> None:
        self.error(f"expected {expected}, found {_KINDS.get(type(self.value), 'null')}")
