"""ED-318: a FeatureCollection (GeoJSON) whose features are zones."""

from __future__ import annotations

from typing import Final

from wonderland_backend.zones.files import common, shapes
from wonderland_backend.zones.files.common import Json, set_if
from wonderland_backend.zones.files.node import Node

_PROPERTIES: Final = (
    "identifier", "country", "name", "type", "variant", "restrictionConditions", "region", "reason",
    "otherReasonInfo", "regulationExemption", "message", "zoneAuthority", "limitedApplicability", "dataSource",
    "extendedProperties",
)  # fmt: skip
_METADATA_TEXTS: Final = ("provider", "description", "technicalLimitations")
MAX_CONDITIONS: Final = 10_000


def read_about(node: Node) -> Json:
    """The collection's own members."""
    document: Json = {}
    for name in ("name", "title"):
        member = node.maybe(name)
        if member is not None:
            set_if(document, name, member.text(common.SHORT))
    metadata = node.maybe("metadata")
    if metadata is not None and metadata.is_object():
        document["metadata"] = _metadata(metadata)
    return document


def _metadata(node: Node) -> Json:
    document: Json = {}
    times = {}
    for name in ("validFrom", "validTo", "issued"):
        member = node.maybe(name)
        if member is not None:
            times[name] = common.date_time(member)
            set_if(document, name, times[name])
    start, end = times.get("validFrom"), times.get("validTo")
    if start and end and common.moment(start) >= common.moment(end):
        node.at("validTo").error("the data set ends before it begins")
    for name in _METADATA_TEXTS:
        set_if(document, name, common.texts(node.maybe(name)))
    geoid = node.maybe("otherGeoid")
    if geoid is not None:
        set_if(document, "otherGeoid", geoid.text(common.SHORT))
    return document


def read_feature(node: Node) -> Json | None:
    """One zone as an ED-318 feature; None, or an incomplete one, with errors noted."""
    if not node.is_object():
        return None
    kind = node.need("type")
    if kind is not None:
        kind.choice(("Feature",))
    inner, properties = node.need("geometry"), node.need("properties")
    document: Json = {"type": "Feature"}
    identifier = node.maybe("id")
    if identifier is not None and isinstance(identifier.value, str | int | float):
        document["id"] = identifier.value
    if properties is not None and properties.is_object():
        document["properties"] = _properties(properties)
    if inner is not None:
        set_if(document, "geometry", shapes.geometry(inner))
    return document


def _properties(node: Node) -> Json:
    node.known(_PROPERTIES, "ED-318 keeps further ones in `extendedProperties`")
    document: Json = {}
    identifier, country = common.identity(node)
    set_if(document, "identifier", identifier)
    set_if(document, "country", country)
    set_if(document, "name", common.texts(node.maybe("name")))
    for name, options in (("type", common.TYPES), ("variant", common.VARIANTS)):
        member = node.need(name)
        if member is not None:
            set_if(document, name, member.choice(options))
    conditions = node.maybe("restrictionConditions")
    if conditions is not None:
        set_if(document, "restrictionConditions", conditions.text(MAX_CONDITIONS))
    _rest(node, document)
    return document


def _rest(node: Node, document: Json) -> None:
    region = node.maybe("region")
    if region is not None:
        if isinstance(region.value, int) and not isinstance(region.value, bool):
            set_if(document, "region", region.number(-common.MAX_REGION, common.MAX_REGION))
        else:
            region.error("expected a whole number")
    set_if(document, "reason", common.reasons(node.maybe("reason"), {}))
    set_if(document, "otherReasonInfo", common.texts(node.maybe("otherReasonInfo")))
    exemption = node.maybe("regulationExemption")
    if exemption is not None:
        set_if(document, "regulationExemption", exemption.choice(common.YES_NO))
    set_if(document, "message", common.texts(node.maybe("message")))
    authorities = node.need("zoneAuthority")
    if authorities is not None:
        document["zoneAuthority"] = [_authority(each) for each in authorities.items(1, 50) if each.is_object()]
    periods = node.maybe("limitedApplicability")
    if periods is not None:
        found = [_period(each) for each in periods.items(0, common.MAX_PERIODS) if each.is_object()]
        if found:
            document["limitedApplicability"] = found
        else:
            periods.notice("an empty list limits nothing: the zone holds at all times")
    for name in ("dataSource", "extendedProperties"):
        member = node.maybe(name)
        if member is not None and member.is_object():
            document[name] = member.value


def _period(node: Node) -> Json:
    node.known(("startDateTime", "endDateTime", "schedule"), "a period has these two times and a schedule")
    return common.period(node)


def _authority(node: Node) -> Json:
    document: Json = {}
    for name in ("name", "service", "contactName"):
        set_if(document, name, common.texts(node.maybe(name)))
    common.contact(node, document)
    return document
