"""Canonical JSON: RFC 8785 restricted to objects, arrays, strings, booleans and integers.

No floats and no null: they are where implementations differ. Integers keep to ±(2⁵³ − 1), so that every JSON
reader sees the same number (RFC 8785, section 3.2.2.3; I-JSON, RFC 7493). Object keys are sorted by their UTF-16
code units. Binary travels as base64url without padding.

``decode`` accepts any spelling of a value of this model (white space, key order) and refuses everything else;
what is hashed, signed or stored is always what ``encode`` makes of it.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
from typing import Any, Final, NoReturn

from wonderland.proofs.errors import EncodingError

MAX_INTEGER: Final = 2**53 - 1
MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 32
"""Deeper nesting than any record needs. What is deeper still stops Python's parser before it exhausts the stack."""

Json = dict[str, "Json"] | list["Json"] | str | int | bool

_ENCODER: Final = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), allow_nan=False)
_BASE64URL: Final = re.compile(r"[A-Za-z0-9_-]*\Z")


def encode(value: Any) -> bytes:
    """Canonical bytes (UTF-8) of a value; raises EncodingError for what the model does not have."""
    return _ENCODER.encode(_checked(value, 0)).encode("utf-8")


def decode(data: bytes | str, *, max_bytes: int = MAX_BYTES) -> Any:
    """The value of a JSON text; raises EncodingError for floats, null, duplicate keys, huge or malformed texts."""
    if len(data) > max_bytes:
        raise EncodingError(f"{len(data)} bytes are more than the {max_bytes} allowed here")
    if isinstance(data, bytes):
        try:
            data = data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise EncodingError(f"not UTF-8 at byte {error.start}") from None
    # A call for each integer is only made where one might be -0, which its value would not show any more.
    parse_int = _integer if "-0" in data else None
    try:
        value = json.loads(
            data, object_pairs_hook=_unique, parse_float=_no_float, parse_constant=_no_float, parse_int=parse_int
        )
    except json.JSONDecodeError as error:
        raise EncodingError(f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}") from None
    except RecursionError:
        raise EncodingError(f"nested deeper than {MAX_DEPTH}") from None
    except ValueError:  # more digits than Python converts
        raise EncodingError("an integer is beyond ±(2^53 - 1)") from None
    return _checked(value, 0)


def digest(value: Any) -> bytes:
    """SHA-256 of the canonical bytes (32 B)."""
    return hashlib.sha256(encode(value)).digest()


def to_base64url(data: bytes) -> str:
    """Base64url without padding (RFC 4648, section 5)."""
    return base64.urlsafe_b64encode(data).rstrip(b"=").decode("ascii")


def from_base64url(text: str) -> bytes:
    """Bytes of a base64url text; raises EncodingError for padding, other alphabets or left-over bits."""
    if not _BASE64URL.match(text):
        raise EncodingError("not base64url (A-Z a-z 0-9 - _ without padding)")
    try:
        data = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
    except binascii.Error:
        raise EncodingError("not base64url: wrong length") from None
    if to_base64url(data) != text:
        raise EncodingError("not base64url: left-over bits are set")
    return data


def _checked(value: Any, depth: int) -> Any:
    """The value with its keys in canonical order, or an EncodingError.

    Every byte of the ledger comes through here: what is frequent is asked first, and by exact type.
    """
    kind = type(value)
    if kind is str:
        return value if value.isascii() else _encodable(value)
    if kind is int:
        return _in_range(value)
    if kind is bool:
        return value
    if depth >= MAX_DEPTH and isinstance(value, dict | list | tuple):
        raise EncodingError(f"nested deeper than {MAX_DEPTH}")
    if kind is dict:
        result = {}
        for key in _sorted_keys(value):
            item = value[key]
            kind = type(item)  # plain fields are most of all: asked here, they cost no call
            plain = (kind is int and -MAX_INTEGER <= item <= MAX_INTEGER) or (kind is str and item.isascii())
            result[key] = item if plain else _checked(item, depth + 1)
        return result
    if kind is list or kind is tuple:
        if value and set(map(type, value)) == {int}:
            _in_range(min(value))
            _in_range(max(value))
            return list(value)
        return [_checked(item, depth + 1) for item in value]
    return _checked_subclass(value, depth)


def _checked_subclass(value: Any, depth: int) -> Any:
    """Enumerations and other subclasses, as the plain values that they are; the rest is refused."""
    if isinstance(value, str):
        return _encodable(value)
    if isinstance(value, int):
        return _in_range(int(value))
    if isinstance(value, dict):
        return _checked(dict(value), depth)
    if isinstance(value, list | tuple):
        return _checked(list(value), depth)
    if value is None:
        raise EncodingError("null is not part of canonical JSON here: leave the field out")
    if isinstance(value, float):
        _no_float("float")
    raise EncodingError(f"{type(value).__name__} is not part of canonical JSON")


def _sorted_keys(value: dict[Any, Any]) -> list[str]:
    try:
        ascii_only = "".join(value).isascii()
    except TypeError:
        other = next(key for key in value if not isinstance(key, str))
        raise EncodingError(f"an object key is {type(other).__name__}, not a string") from None
    if ascii_only:
        return sorted(value)
    return sorted(map(_encodable, value), key=_utf16)


def _in_range(value: int) -> int:
    if -MAX_INTEGER <= value <= MAX_INTEGER:
        return value
    raise EncodingError("an integer is beyond ±(2^53 - 1)")


def _encodable(text: str) -> str:
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise EncodingError("a string has an unpaired surrogate") from None
    return text


def _utf16(key: str) -> bytes:
    return key.encode("utf-16-be")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                raise EncodingError(f"the key {key[:60]!r} appears twice")
            seen.add(key)
    return result


def _no_float(text: str) -> NoReturn:
    raise EncodingError(f"{text[:20]} is not an integer: use a smaller unit (mm, ms, ppm, degrees × 10⁷)")


def _integer(text: str) -> int:
    if len(text) > 17:
        raise EncodingError("an integer is beyond ±(2^53 - 1)")
    if text == "-0":
        raise EncodingError("-0 is not canonical: write 0")
    return int(text)
