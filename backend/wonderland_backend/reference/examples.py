"""An example of every schema: made from the schema itself, with values of the field for names that are known."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

Schema = Mapping[str, Any]
_HASH: Final = "9f2c4d1e8b7a6f5c3d2e1f0a9b8c7d6e5f4a3b2c1d0e9f8a7b6c5d4e3f2a1b0c"
_T_MS: Final = 1_800_000_000_000
KNOWN: Final[Mapping[str, Any]] = {
    "uav_id": "OH-DRN-0417",
    "drone": "OH-DRN-0417",
    "serial": "OH-DRN-0417",
    "pad_id": "aurajoki-2",
    "pad": "aurajoki-2",
    "operator_id": "aurora-air",
    "msp_id": "FleetMSP",
    "lat_e7": 604_518_900,
    "lon_e7": 222_666_000,
    "height_mm": 42_000,
    "error_mm": 120,
    "likelihood_ppm": 999_000,
    "buffer_mm": 1_000,
    "assurance": 2,
    "rounds": 24,
    "block": 1042,
    "tx_index": 0,
    "after": "1042.0",
    "event_id": "1042.0",
    "next": "WzEwNDIsIDBd",
    "client_id": "wl-5d0c2f6b9a7e4c1d8b3f0a62",
    "name": "Aurajoki 2",
    "url": "https://hooks.example.com/wonderland",
    "secret": "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSwMfKQ9r8GKYo=",
    "registration": "FIN---k8",
    "facts": {"error_mm": 120, "buffer_mm": 1000},
    "text": "Measured 0.12 m from the claim, within 1.00 m.",
    "detail": "No pad aurajoki-9 is registered.",
    "bbox": "22.2,60.4,22.3,60.5",
    "country": "FIN",
    "zone_id": "FIN:EFP20",
    "source": "traficom",
    "status": 200,
    "scope": "wonderland.proofs.read",
    "access_token": "eyJhbGciOiJFUzI1NiIsInR5cCI6ImF0K2p3dCJ9.eyJzdWIiOiJ3bC01ZDBjIn0.c2lnbmF0dXJl",
    "expires_in": 3600,
    "ee_mm2": 640,
    "en_mm2": 30,
    "nn_mm2": 590,
}
"""What is shown where a schema allows it."""
MAX_DEPTH: Final = 12


def example_of(schema: Schema, schemas: Mapping[str, Schema], name: str = "", depth: int = 0) -> Any:
    """A value that the schema allows. `schemas` are the document's components."""
    schema = _resolved(schema, schemas)
    if "example" in schema:
        return schema["example"]
    if schema.get("examples"):
        return schema["examples"][0]
    if "const" in schema:
        return schema["const"]
    if "enum" in schema:
        return schema["enum"][0]
    for several in ("anyOf", "oneOf"):
        if several in schema:
            option = next((each for each in schema[several] if each.get("type") != "null"), schema[several][0])
            return example_of(option, schemas, name, depth)
    if "allOf" in schema:
        return example_of(schema["allOf"][0], schemas, name, depth)
    return _by_kind(schema, schemas, name, depth)


def _by_kind(schema: Schema, schemas: Mapping[str, Schema], name: str, depth: int) -> Any:
    kind = schema.get("type", "object" if "properties" in schema else None)
    if kind == "object" and isinstance(KNOWN.get(name), dict) and "properties" not in schema:
        return KNOWN[name]
    if kind == "object":
        return _object(schema, schemas, depth)
    if kind == "array":
        items = example_of(schema.get("items", {}), schemas, _singular(name), depth + 1)
        return [] if depth > MAX_DEPTH and not schema.get("minItems") else [items] * max(1, schema.get("minItems", 1))
    if kind in {"integer", "number"}:
        return _number(schema, name)
    if kind == "string":
        return _string(schema, name)
    if kind == "boolean":
        return bool(schema.get("default", True))
    return None


def _object(schema: Schema, schemas: Mapping[str, Schema], depth: int) -> dict[str, Any]:
    required = set(schema.get("required", ()))
    properties: Mapping[str, Schema] = schema.get("properties", {})
    return {
        name: example_of(each, schemas, name, depth + 1)
        for name, each in properties.items()
        if name in required or depth <= MAX_DEPTH
    }


def _number(schema: Schema, name: str) -> int | float:
    lowest, highest = schema.get("minimum", -(2**53)), schema.get("maximum", 2**53)
    known = KNOWN.get(name)
    if isinstance(known, int) and lowest <= known <= highest:
        return known
    wanted: int | float = _T_MS if name.endswith("_ms") else schema.get("default") or 1
    found: int | float = min(max(wanted, lowest), highest)
    return found


def _string(schema: Schema, name: str) -> str:
    for given in (schema.get("default"), KNOWN.get(name), "example"):
        if isinstance(given, str) and given and _allows(schema, given):
            return given
    for guess in _GUESSES:
        if _allows(schema, guess):
            return guess
    return "x" * int(schema.get("minLength", 1))


def _allows(schema: Schema, value: str) -> bool:
    if not schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", len(value)):
        return False
    try:
        return re.search(schema.get("pattern", ""), value) is not None
    except re.error:
        return True


_GUESSES: Final = (
    "0198f2a4-7c31-4b5e-9d20-6a1f8e3c5b74",
    "inspector@authority.example",
    "FIN:R12",
    "FIN",
    _HASH,
    _HASH[:32],
    "1042.0",
    "A" * 87,
    "AAAA",
    "2026-06-01T12:00:00Z",
    "a1",
    "1",
    "FI",
    "https://example.com/",
)


def _singular(name: str) -> str:
    return name.removesuffix("s")


def _resolved(schema: Schema, schemas: Mapping[str, Schema]) -> Schema:
    while "$ref" in schema:
        schema = schemas[schema["$ref"].rpartition("/")[2]]
    return schema
