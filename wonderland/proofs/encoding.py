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
"""Deeper nesting than any record needs; keeps a hostile text from exhausting the stack."""

Json = dict[str, "Json"] | list["Json"] | str | int | bool

_BASE64URL: Final = re.compile(r"[A-Za-z0-9_-]*\Z")


def encode(value: Any) -> bytes:
    """Canonical bytes (UTF-8) of a value; raises EncodingError for what the model does not have."""
    checked = _checked(value, 0)
    return json.dumps(checked, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode("utf-8")


def decode(data: bytes | str, *, max_bytes: int = MAX_BYTES) -> Any:
    """The value of a JSON text; raises EncodingError for floats, null, duplicate keys, huge or malformed texts."""
    if len(data) > max_bytes:
        raise EncodingError(f"{len(data)} bytes are more than the {max_bytes} allowed here")
    if isinstance(data, bytes):
        try:
            data = data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise EncodingError(f"not UTF-8 at byte {error.start}") from None
    _refuse_deep(data)
    try:
        value = json.loads(
            data, object_pairs_hook=_unique, parse_float=_no_float, parse_constant=_no_float, parse_int=_integer
        )
    except json.JSONDecodeError as error:
        raise EncodingError(f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}") from None
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
    """The value with its keys in canonical order, or an EncodingError."""
    if value is True or value is False:
        return value
    if isinstance(value, str):
        if value.isascii():
            return value
        try:
            value.encode("utf-8")
        except UnicodeEncodeError:
            raise EncodingError("a string has an unpaired surrogate") from None
        return value
    if isinstance(value, int):
        if -MAX_INTEGER <= value <= MAX_INTEGER:
            return int(value)
        raise EncodingError("an integer is beyond ±(2^53 - 1)")
    if depth >= MAX_DEPTH:
        raise EncodingError(f"nested deeper than {MAX_DEPTH}")
    if isinstance(value, dict):
        keys = list(value)
        for key in keys:
            if not isinstance(key, str):
                raise EncodingError(f"an object key is {type(key).__name__}, not a string")
            if not key.isascii():
                _checked(key, depth)
        ascii_only = all(key.isascii() for key in keys)
        keys.sort(key=None if ascii_only else _utf16)
        return {key: _checked(value[key], depth + 1) for key in keys}
    if isinstance(value, list | tuple):
        return [_checked(item, depth + 1) for item in value]
    if value is None:
        raise EncodingError("null is not part of canonical JSON here: leave the field out")
    if isinstance(value, float):
        _no_float("float")
    raise EncodingError(f"{type(value).__name__} is not part of canonical JSON")


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


def _refuse_deep(text: str) -> None:
    """Refuse a text that could nest too deep before the parser recurses into it."""
    if text.count("[") + text.count("{") <= MAX_DEPTH:
        return
    depth = 0
    in_string = escaped = False
    for character in text:
        if in_string:
            if escaped:
                escaped = False
            elif character == "\\":
                escaped = True
            elif character == '"':
                in_string = False
        elif character == '"':
            in_string = True
        elif character in "[{":
            depth += 1
            if depth > MAX_DEPTH:
                raise EncodingError(f"nested deeper than {MAX_DEPTH}")
        elif character in "]}":
            depth -= 1
