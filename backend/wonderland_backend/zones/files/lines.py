"""In which line of a JSON text a value stands. Only asked where something is wrong, so that reading stays fast."""

from __future__ import annotations

import json
import re
from bisect import bisect_right
from typing import Final

Path = tuple[str | int, ...]

_BLANK: Final = re.compile(r"[ \t\r\n]*")
_DECODER: Final = json.JSONDecoder()


def path_text(path: Path) -> str:
    """The path as people write it: ``features[0].properties.type``."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


class Lines:
    """Lines and columns (both from 1) of the values of a text that is valid JSON."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._starts = [0, *(match.end() for match in re.finditer("\n", text))]
        self._children: dict[int, dict[str | int, int]] = {}

    def of(self, path: Path) -> tuple[int, int]:
        """Where the value at a path begins; where there is none, the innermost that holds it."""
        offset = self._skip(0)
        for part in path:
            inner = self._inside(offset).get(part)
            if inner is None:
                break
            offset = inner
        return self.at(offset)

    def at(self, offset: int) -> tuple[int, int]:
        """Line and column of a character."""
        line = bisect_right(self._starts, offset)
        return line, offset - self._starts[line - 1] + 1

    def _inside(self, offset: int) -> dict[str | int, int]:
        """Where the members of the object, or the items of the array, at an offset begin."""
        found = self._children.get(offset)
        if found is None:
            try:
                found = self._scan(offset)
            except RecursionError:
                found = {}  # nested deeper than anything that is said of zones; the outer line will do
            self._children[offset] = found
        return found

    def _scan(self, start: int) -> dict[str | int, int]:
        opening = self._text[start]
        if opening not in "{[":
            return {}
        found: dict[str | int, int] = {}
        offset = self._skip(start + 1)
        while self._text[offset] not in "}]":
            key: str | int = len(found)
            if opening == "{":
                key, offset = _DECODER.raw_decode(self._text, offset)
                offset = self._skip(self._skip(offset) + 1)
            found[key] = offset
            _, offset = _DECODER.raw_decode(self._text, offset)
            offset = self._skip(offset)
            if self._text[offset] == ",":
                offset = self._skip(offset + 1)
        return found

    def _skip(self, offset: int) -> int:
        match = _BLANK.match(self._text, offset)
        assert match is not None
        return match.end()
