"""From the bytes of a file to a data set, or to all that is wrong with it, line by line."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import orjson

from wonderland_backend.zones.files import ed269, ed318
from wonderland_backend.zones.files.common import Json
from wonderland_backend.zones.files.findings import Finding, Findings, placed
from wonderland_backend.zones.files.lines import Lines
from wonderland_backend.zones.files.node import Node

MAX_ZONES: Final = 50_000
_BOM: Final = b"\xef\xbb\xbf"
Format = Literal["ed318", "ed269"]


@dataclass(frozen=True)
class ZoneFile:
    """What a file says: features of ED-318 where there is no error, and the findings."""

    format: Format | None
    sha256: str
    size_bytes: int
    about: Json
    features: list[Json]
    errors: list[Finding]
    error_count: int
    notices: list[Finding]
    notice_count: int


def read(data: bytes) -> ZoneFile:
    """Read and check a file of zones. Raises nothing: what is wrong is in `errors`."""
    sha256 = hashlib.sha256(data).hexdigest()

    def refused(finding: Finding) -> ZoneFile:
        return ZoneFile(None, sha256, len(data), {}, [], [finding], 1, [], 0)

    try:
        text = data.removeprefix(_BOM).decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - (data.rfind(b"\n", 0, error.start) + 1) + 1
        return refused(Finding(line, column, "", "the file is not UTF-8 from here on; save it as UTF-8"))
    try:
        document = orjson.loads(text)
    except orjson.JSONDecodeError as error:
        return refused(Finding(error.lineno, error.colno, "", f"no valid JSON: {error.msg}"))
    findings = Findings()
    top = Node(document, (), findings)
    kind = _format_of(top)
    about: Json = {}
    features: list[Json] = []
    if kind == "ed318":
        about, features = ed318.read_about(top), _zones(top.at("features"), ed318.read_feature)
    elif kind == "ed269":
        name = "features" if top.has("features") else "UASZoneList"
        about, features = ed269.read_about(top), _zones(top.at(name), ed269.read_zone)
    if not findings.error_count and not findings.notice_count:
        return ZoneFile(kind, sha256, len(data), about, features, [], 0, [], 0)
    lines = Lines(text)
    return ZoneFile(
        kind,
        sha256,
        len(data),
        about,
        [] if findings.error_count else features,
        placed(findings.errors, lines),
        findings.error_count,
        placed(findings.notices, lines),
        findings.notice_count,
    )


def _format_of(top: Node) -> Format | None:
    if not top.is_object():
        return None
    if top.value.get("type") == "FeatureCollection":
        if top.need("features") is None:
            return None
        return "ed318"
    listed = top.value.get("features", top.value.get("UASZoneList"))
    if isinstance(listed, list) and "type" not in top.value:
        return "ed269"
    top.error('neither ED-318 ("type": "FeatureCollection") nor ED-269 ("features": a list of zones)')
    return None


def _zones(listed: Node, read_one: Callable[[Node], Json | None]) -> list[Json]:
    found: list[Json] = []
    seen: dict[str, int] = {}
    for index, each in enumerate(listed.items(0, MAX_ZONES)):
        feature = read_one(each)
        if feature is None:
            continue
        found.append(feature)
        zone_id = zone_id_of(feature)
        if zone_id is not None and seen.setdefault(zone_id, index) != index:
            each.error(f"zone {zone_id} is in the file twice, first as number {seen[zone_id] + 1}; remove one")
    return found


def zone_id_of(feature: Json) -> str | None:
    """Country and identifier of a feature; None where one is missing."""
    properties = feature.get("properties", {})
    if "country" not in properties or "identifier" not in properties:
        return None
    return f"{properties['country']}:{properties['identifier']}"
