"""What tables of ``pad.toml`` are, and how fields are read that msgspec does not know."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct

from wonderland.proofs.records.fields import ID_PATTERN

Text = Annotated[str, Meta(min_length=1, pattern=r"\A[^\0]*\Z")]
Identifier = Annotated[str, Meta(pattern=rf"\A(?:{ID_PATTERN})\Z")]
"""A name as the ledger's records allow it."""


class FieldError(ValueError):
    """A field that does not go with others, or is no address; the text begins with its name."""


class Table(Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the file: a misspelt field must not be ignored."""


class Address(tuple[str, int]):
    """``host:port``; without a host, ``:5480``, it is this machine alone."""

    __slots__ = ()


def read_field(kind: type, value: object, directory: Path) -> Any:
    """An address, or a path relative to the file. Raises ValueError: what is wrong with it."""
    if not isinstance(value, str):
        raise ValueError(f"is {value!r}, not a text in quotes")  # noqa: TRY004 - msgspec takes ValueErrors for refusals
    if not value or "\0" in value:
        raise ValueError("is empty" if not value else "holds a NUL character")
    return _address(value) if kind is Address else (directory / Path(value).expanduser()).absolute()


def _address(text: str) -> Address:
    host, separator, port = text.rpartition(":")
    if not (separator and port.isascii() and port.isdigit() and len(port) <= 5 and int(port) < 65_536):
        raise ValueError("is not host:port, for example 127.0.0.1:5480")
    return Address((host.strip("[]") or "127.0.0.1", int(port)))
