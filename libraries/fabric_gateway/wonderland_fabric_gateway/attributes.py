"""The attributes that a Fabric CA puts into a certificate: extension 1.2.3.4.5.6.7.8.1, raw JSON ``{"attrs": {…}}``.

Source: fabric-ca, ``lib/attrmgr``; the value is the JSON text itself, not wrapped in an ASN.1 string.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final

from cryptography import x509

from wonderland_fabric_gateway.errors import IdentityError

if TYPE_CHECKING:
    from collections.abc import Mapping

ATTRIBUTES_OID: Final = x509.ObjectIdentifier("1.2.3.4.5.6.7.8.1")
MAX_BYTES: Final = 16_384
MAX_ATTRIBUTES: Final = 64

ROLE: Final = "pol.role"
"""Attribute with the role: admin, inspector, mirror, pad_operator, pad, fleet_operator or uav."""
ID: Final = "pol.id"
"""Attribute with the pad's or the UAV's identifier in the registry."""


def encode_attributes(attributes: Mapping[str, str]) -> bytes:
    """The extension's value. Raises `IdentityError` for what no Fabric client could read back."""
    if len(attributes) > MAX_ATTRIBUTES:
        raise IdentityError(f"{len(attributes)} attributes; a certificate carries at most {MAX_ATTRIBUTES}")
    try:
        data = json.dumps({"attrs": dict(attributes)}, ensure_ascii=False, separators=(",", ":")).encode()
    except (TypeError, UnicodeEncodeError) as cause:
        raise IdentityError(f"attributes: names and values are Unicode text ({cause})") from cause
    decode_attributes(data)  # a certificate whose own attributes nobody can read must not be issued
    return data


def decode_attributes(data: bytes) -> dict[str, str]:
    """Attributes by name from the extension's value. Raises `IdentityError`.

    Doubled names are refused: two readers could take a different one of the two, and a role hangs on it.
    """
    if len(data) > MAX_BYTES:
        raise IdentityError(f"certificate attributes of {len(data)} bytes; the limit is {MAX_BYTES}")
    try:
        document = json.loads(data.decode(), object_pairs_hook=_without_doubles)
    except (ValueError, RecursionError) as cause:
        raise IdentityError(f"certificate attributes are no JSON: {cause}") from cause
    attributes = document.get("attrs") if isinstance(document, dict) else None
    if not isinstance(attributes, dict):
        raise IdentityError('certificate attributes lack the object "attrs"')
    for name, value in attributes.items():
        if not isinstance(value, str):
            raise IdentityError(f"certificate attribute {name!r} is {type(value).__name__}, not text")
        try:
            (name + value).encode()
        except UnicodeEncodeError as cause:
            raise IdentityError(f"certificate attribute {name!r} is no Unicode text ({cause.reason})") from cause
    return attributes


def _without_doubles(pairs: list[tuple[str, object]]) -> dict[str, object]:
    names = dict(pairs)
    if len(names) != len(pairs):
        raise IdentityError("certificate attributes name the same attribute twice")
    return names
