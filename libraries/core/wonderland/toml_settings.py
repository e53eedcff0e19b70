"""Settings files of agents (TOML): read with limits, checked by msgspec, with complaints that name the field."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, cast

from msgspec import Meta, Struct, ValidationError, convert
from msgspec.inspect import type_info

from wonderland.proofs.records.fields import ID_PATTERN

MAX_FILE_BYTES: Final = 256 * 1024
Text = Annotated[str, Meta(min_length=1, pattern=r"\A[^\0]*\Z")]
Identifier = Annotated[str, Meta(pattern=rf"\A(?:{ID_PATTERN})\Z")]
"""A name as the ledger's records allow it."""

_PATH: Final = re.compile(r"\.(\w+)|\[(\d+)\]")
_WORDS: Final = {
    "`int`": "a whole number",
    "`float`": "a number",
    "`str`": "a text in quotes",
    "`bool`": "true or false",
    "`array`": "a list",
    "`object`": "a table",
    "Expected": "expected",
}


class SettingsError(Exception):
    """A file that is missing, is no TOML, or holds something that an agent cannot work with; it names the field."""


class FieldError(ValueError):
    """A field that does not go with others, or is no address; the text begins with its name."""


class Table(Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the file: a misspelt field must not be ignored."""


class Address(tuple[str, int]):
    """``host:port``; without a host, ``:5480``, it is this machine alone."""

    __slots__ = ()


_T = TypeVar("_T")


def load_toml(path: Path, kind: type[_T]) -> _T:
    """Read a file as `kind`. Raises SettingsError."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as cause:
        raise SettingsError(f"{path}: cannot be read ({cause.strerror or cause})") from cause
    if len(data) > MAX_FILE_BYTES:
        raise SettingsError(f"{path}: larger than {MAX_FILE_BYTES} bytes; is it the right file?")
    try:
        document = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as cause:
        raise SettingsError(f"{path}: no TOML: {cause}") from cause
    return parse_toml(document, path, kind)


def parse_toml(document: dict[str, Any], path: Path, kind: type[_T]) -> _T:
    """Settings from a decoded document; ``path`` is the file's, for relative paths and for error texts."""
    directory = path.resolve().parent
    try:
        return convert(document, kind, dec_hook=lambda field, value: _read_field(field, value, directory))
    except ValidationError as error:
        raise SettingsError(f"{path}: {_complaint(error, document, kind)}") from error


def _read_field(kind: type, value: object, directory: Path) -> Any:
    """An address, or a path relative to the file. Raises ValueError: what is wrong with it."""
    if not isinstance(value, str):
        raise ValueError(f"is {value!r}, not a text in quotes")  # noqa: TRY004 - msgspec takes ValueErrors for refusals
    if not value or "\0" in value:
        raise ValueError("is empty" if not value else "holds a NUL character")
    return read_address(value) if kind is Address else (directory / Path(value).expanduser()).absolute()


def read_address(text: str) -> Address:
    """``host:port``. Raises ValueError: what is wrong with it."""
    host, separator, port = text.rpartition(":")
    if not (separator and port.isascii() and port.isdigit() and len(port) <= 5 and int(port) < 65_536):
        raise ValueError("is not host:port, for example 127.0.0.1:5480")
    return Address((host.strip("[]") or "127.0.0.1", int(port)))


def _field(kind: type, path: list[tuple[str, str]]) -> Any:
    """What msgspec knows of the field that the path leads to; None where there is none."""
    found: Any = type_info(kind)
    for name, _ in path:
        options = getattr(found, "types", (found,))
        if name:
            fields = [each for option in options for each in getattr(option, "fields", ()) if each.encode_name == name]
            found = fields[0].type if fields else None
        else:
            found = next((option.item_type for option in options if hasattr(option, "item_type")), None)
    return found


def _choices(found: Any) -> list[str]:
    """What a field may be that is one of several words."""
    return [str(value) for option in getattr(found, "types", (found,)) for value in getattr(option, "values", ())]


def _shape(found: Any) -> str:
    """What a text that has a form of its own should have been."""
    examples = (getattr(found, "extra_json_schema", None) or {}).get("examples")
    if examples:
        return f"which is not of the form of {' or '.join(map(repr, examples))}"
    return "of which a character is not allowed (names have letters, digits and . _ : -)"


def _complaint(error: ValidationError, document: object, kind: type) -> str:
    """Msgspec's words with the field's name before them, as it stands in the file, and what it holds."""
    text, _, where = str(error).partition(" - at `$")
    value = document
    for name, index in _PATH.findall(where):
        value = cast("Any", value)[name or int(index)]
    place = where.rstrip("`").lstrip(".")
    inside = f"{place}." if place else ""
    if isinstance(error.__cause__, FieldError):
        return f"{inside}{text}"
    if text.startswith(("Object contains unknown field", "Object missing required field")):
        return f"{inside}{text.split('`')[1]} is {'unknown' if 'unknown' in text else 'missing'}"
    if error.__cause__ is None:
        for theirs, ours in _WORDS.items():
            text = text.replace(theirs, ours)
        if "matching regex" in text:
            text = _shape(_field(kind, _PATH.findall(where)))
        elif text.startswith("Invalid enum"):
            known = _choices(_field(kind, _PATH.findall(where)))
            text = f"which is not known; {', '.join(known)} are" if known else "which is not known"
        text = f"is {value!r}, {text}"
    return f"{place} {text}"
