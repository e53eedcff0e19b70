"""Zones as the interface shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from wonderland.messages import Language
from wonderland_backend.db.tables.zones import ZoneRow, ZoneSetRow
from wonderland_backend.zones.applicability import Span, spans
from wonderland_backend.zones.files.common import Json
from wonderland_backend.zones.schemas import MAX_SPAN_MS
from wonderland_backend.zones.store import validity
from wonderland_backend.zones.zone import Zone, plain, zone_of

Row = tuple[ZoneRow, ZoneSetRow]


def zone_json(row: Row, language: Language, now_ms: int) -> dict[str, Any]:
    """One zone with its feature."""
    zone_row, data_set = row
    zone = zone_of(zone_row.feature)
    its = zone.feature["properties"]
    names, messages = its.get("name", []), its.get("message", [])
    content: dict[str, Any] = {
        "zone_id": zone.zone_id,
        "source": data_set.source,
        "import_id": data_set.import_id,
        "type": zone.type,
        "variant": its["variant"],
        "name": in_language(names, language),
        "message": in_language(messages, language),
        "names": names,
        "messages": messages,
        "reasons": its.get("reason", []),
        "conditions": its.get("restrictionConditions"),
        "authorities": its["zoneAuthority"],
        "layers": [_without_none({"lower": _limit(each.lower), "upper": _limit(each.upper)}) for each in zone.volumes],
        "limited": bool(zone.periods),
        **active(spans_ahead(zone, data_set, now_ms), now_ms),
        "bbox": list(zone.bounds),
        "feature": zone.feature,
    }
    return _without_none(content)


def _limit(limit: Any) -> dict[str, Any] | None:
    return None if limit is None else asdict(limit)


def _without_none(content: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in content.items() if value is not None}


def spans_ahead(zone: Zone, data_set: ZoneSetRow, now_ms: int) -> list[Span]:
    """When it holds within the coming month."""
    return spans(zone, now_ms, now_ms + MAX_SPAN_MS, validity(data_set.about))


def active(ahead: Sequence[Span], now_ms: int) -> dict[str, Any]:
    """Whether it holds now, and when that changes."""
    if not ahead:
        return {"active": False, "changes_ms": None}
    start, end = ahead[0]
    if start > now_ms:
        return {"active": False, "changes_ms": start}
    return {"active": True, "changes_ms": end if end < now_ms + MAX_SPAN_MS else None}


def in_language(texts: Sequence[Json], language: Language) -> str | None:
    """The text in a language; else in English, in none in particular, or whichever comes first."""
    for wanted in (language, "en", "und"):
        for each in texts:
            if each["lang"].lower().startswith(wanted):
                return str(each["text"])
    return str(texts[0]["text"]) if texts else None


def taken_geometry(item: dict[str, Any]) -> dict[str, Any]:
    """The feature's geometry in plain GeoJSON; the feature itself leaves the item."""
    return plain(item.pop("feature")["geometry"])
