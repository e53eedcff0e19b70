"""ED-269: the JSON form before ED-318, still what several states publish. Its zones become features of ED-318.

Its texts have no language; they are marked ``und`` (undetermined, BCP 47).
"""

from __future__ import annotations

from typing import Any, Final

from wonderland_backend.zones.files import common, shapes
from wonderland_backend.zones.files.common import Json, set_if
from wonderland_backend.zones.files.ed318 import MAX_CONDITIONS
from wonderland_backend.zones.files.node import Node

UNKNOWN_LANGUAGE: Final = "und"
FOOT_M: Final = 0.3048
RESTRICTIONS: Final = {
    "PROHIBITED": "PROHIBITED",
    "REQ_AUTHORISATION": "REQ_AUTHORIZATION",
    "REQ_AUTHORIZATION": "REQ_AUTHORIZATION",
    "CONDITIONAL": "CONDITIONAL",
    "NO_RESTRICTION": "NO_RESTRICTION",
    "USPACE": "USPACE",
}
_RENAMED_REASONS: Final = {"FOREIGN_TERRITORY": "OTHER"}
MAX_TEXT: Final = 10_000
USPACE_CLASS: Final = "uSpaceClass"
MAX_CLASS: Final = 100


def read_about(node: Node) -> Json:
    """The file's own members."""
    document: Json = {}
    title = node.maybe("title")
    if title is not None:
        set_if(document, "name", title.text(common.SHORT))
    description = _text(node.maybe("description"))
    if description is not None:
        document["metadata"] = {"description": description}
    return document


def read_zone(node: Node) -> Json | None:
    """One UASZoneVersion as an ED-318 feature; None, or an incomplete one, with errors noted."""
    if not node.is_object():
        return None
    document: Json = {"type": "Feature", "properties": _properties(node)}
    volumes = node.need("geometry")
    parts = []
    if volumes is not None:
        for each in volumes.items(1, shapes.MAX_PARTS):
            part = _volume(each) if each.is_object() else None
            if part is not None:
                parts.append(part)
    document["geometry"] = parts[0] if len(parts) == 1 else {"type": "GeometryCollection", "geometries": parts}
    return document


def _text(node: Node | None) -> list[Json] | None:
    """One text without a language, or several; what is longer than ED-318 allows is cut, and that is said."""
    if node is None or node.value in ("", []):
        return None
    found = []
    for each in node.items(1, common.MAX_TEXTS) if isinstance(node.value, list) else (node,):
        text = each.text(MAX_TEXT)
        if not text:
            continue
        if len(text) > common.SHORT:
            each.notice(f"{len(text)} characters; ED-318 has room for {common.SHORT}, the rest is left out")
            text = text[: common.SHORT - 1] + "…"
        found.append({"text": text, "lang": UNKNOWN_LANGUAGE})
    return found or None


def _properties(node: Node) -> Json:
    document: Json = {}
    identifier, country = common.identity(node)
    set_if(document, "identifier", identifier)
    set_if(document, "country", country)
    set_if(document, "name", _text(node.maybe("name")))
    restriction = node.need("restriction")
    if restriction is not None:
        name = restriction.choice(tuple(RESTRICTIONS))
        set_if(document, "type", RESTRICTIONS[name] if name is not None else None)
    variant = node.maybe("type")
    document["variant"] = variant.choice(common.VARIANTS) if variant is not None else "COMMON"
    _conditions(node.maybe("restrictionConditions"), document)
    region = node.maybe("region")
    if region is not None and isinstance(region.value, int):
        document["region"] = region.number(-common.MAX_REGION, common.MAX_REGION)
    set_if(document, "reason", common.reasons(_listed(node.maybe("reason")), _RENAMED_REASONS))
    set_if(document, "otherReasonInfo", _text(node.maybe("otherReasonInfo")))
    exemption = node.maybe("regulationExemption")
    if exemption is not None and exemption.value != "":
        set_if(document, "regulationExemption", exemption.choice(common.YES_NO))
    set_if(document, "message", _text(node.maybe("message")))
    authorities = node.need("zoneAuthority")
    if authorities is not None:
        document["zoneAuthority"] = [_authority(each) for each in authorities.items(1, 50) if each.is_object()]
    _applicability(node, document)
    extended = node.maybe("extendedProperties")
    if extended is not None and isinstance(extended.value, dict):
        document["extendedProperties"] = extended.value
    _uspace_class(node.maybe(USPACE_CLASS), document)
    return document


def _uspace_class(node: Node | None, document: Json) -> None:
    """ED-318 has no member for it."""
    if node is None or node.value in ("", []):
        return
    texts = node.items(1, common.MAX_TEXTS) if isinstance(node.value, list) else (node,)
    found = [name for each in texts if (name := each.text(MAX_CLASS))]
    document["extendedProperties"] = {**document.get("extendedProperties", {}), USPACE_CLASS: found}


def _listed(node: Node | None) -> Node | None:
    """Some files have one reason where the standard has a list."""
    if node is not None and isinstance(node.value, str):
        return Node([node.value], node.path, node.findings)
    return node


def _conditions(node: Node | None, document: Json) -> None:
    if node is None:
        return
    texts = node.items(0, common.MAX_TEXTS) if isinstance(node.value, list) else (node,)
    found = [each.text(MAX_CONDITIONS) for each in texts]
    joined = "\n".join(each for each in found if each)
    if joined:
        document["restrictionConditions"] = joined[:MAX_CONDITIONS]


def _authority(node: Node) -> Json:
    document: Json = {}
    for name in ("name", "service", "contactName"):
        set_if(document, name, _text(node.maybe(name)))
    common.contact(node, document)
    return document


def _applicability(node: Node, document: Json) -> None:
    listed = node.maybe("applicability")
    if listed is None:
        node.notice("no `applicability`: the zone holds at all times")
        return
    periods = []
    permanent = False
    for each in listed.items(0, common.MAX_PERIODS):
        if not each.is_object():
            continue
        always = each.maybe("permanent")
        if always is not None and always.choice(common.YES_NO) == "YES":
            permanent = True
            continue
        period = common.period(each)
        if not period and each.findings.error_count == 0:
            each.error("neither permanent nor any time; write permanent YES, or when it holds")
        periods.append(period)
    if permanent and periods:
        listed.notice("one entry is permanent: the zone holds at all times, whatever the others say")
    if periods and not permanent:
        document["limitedApplicability"] = periods


def _volume(node: Node) -> Json | None:
    unit = node.maybe("uomDimensions")
    uom = unit.choice(("M", "FT")) if unit is not None else "M"
    projection = node.need("horizontalProjection")
    if projection is None or not projection.is_object():
        return None
    part = _projection(projection, FOOT_M if uom == "FT" else 1.0)
    layer = _layer(node, (uom or "M").lower())
    if part is not None and layer:
        part["layer"] = layer
    return part


def _layer(node: Node, uom: str) -> Json:
    """The same limits under ED-318's names; errors keep the file's."""
    document: Json = {}
    for edge in ("lower", "upper"):
        limit, reference = node.maybe(f"{edge}Limit"), node.maybe(f"{edge}VerticalReference")
        if limit is None:
            continue
        set_if(document, edge, limit.number(-shapes.MAX_LIMIT, shapes.MAX_LIMIT))
        if reference is None:
            limit.error(f"`{edge}VerticalReference` is missing; say whether the limit is AGL or AMSL")
        else:
            set_if(document, f"{edge}Reference", reference.choice(shapes.REFERENCES))
    shapes.require_order(node, document)
    return {**document, "uom": uom} if document else document


def _projection(node: Node, unit_m: float) -> dict[str, Any] | None:
    kind = node.need("type")
    name = kind.choice(("Polygon", "Circle")) if kind is not None else None
    if name == "Polygon":
        coordinates = node.need("coordinates")
        rings = shapes.polygon(coordinates) if coordinates is not None else None
        return {"type": "Polygon", "coordinates": rings} if rings is not None else None
    if name == "Circle":
        centre, radius = node.need("center"), node.need("radius")
        found = shapes.circle(centre, radius, unit_m) if centre is not None and radius is not None else None
        if found is not None:
            point, metres = found
            return {"type": "Point", "coordinates": point, "extent": {"subType": "Circle", "radius": metres}}
    return None
