"""Geometry of zones: positions, rings, circles, vertical limits; checked, and brought to RFC 7946 and ED-318."""

from __future__ import annotations

import re
from typing import Any, Final

import shapely

from wonderland_backend.zones.files.common import Json, set_if
from wonderland_backend.zones.files.node import Node

MAX_POINTS: Final = 20_000
MAX_RINGS: Final = 500
MAX_PARTS: Final = 200
MAX_RADIUS_M: Final = 500_000.0
MAX_LIMIT: Final = 330_000.0
"""Vertical limits, in metres or feet: beyond 100 km nothing is airspace."""
REFERENCES: Final = ("AGL", "AMSL", "WGS84")
DEGREE_M: Final = 110_000.0
_AT: Final = re.compile(r"\[(\S+) (\S+)\]")

Position = list[float]
Ring = list[Position]


def polygon(node: Node) -> list[Ring] | None:
    """The rings of a polygon: closed, the outer one anticlockwise, the holes clockwise; None with errors noted."""
    rings = [_ring(each, outer=index == 0) for index, each in enumerate(node.items(1, MAX_RINGS))]
    if not rings:
        return None
    good = [ring for ring in rings if ring is not None]
    if len(good) != len(rings):
        return None
    shape = shapely.Polygon(good[0], good[1:])
    if not shape.is_valid:
        _say_invalid(node, good, shapely.is_valid_reason(shape))
        return None
    if shape.area == 0:
        node.error("the polygon has no area")
        return None
    return [_wound(node.at(index), ring, ccw=index == 0) for index, ring in enumerate(good)]


def _ring(node: Node, *, outer: bool) -> Ring | None:
    before = node.findings.error_count
    if isinstance(node.value, list) and len(node.value) < 4:
        node.error(f"{len(node.value)} positions; a ring has at least four, the last one equal to the first")
        return None
    points = [position(each) for each in node.items(4, MAX_POINTS)]
    ring = [each for each in points if each is not None]
    if node.findings.error_count != before:
        return None
    if ring[0] != ring[-1]:
        node.at(len(ring) - 1).error("the ring is not closed; repeat its first position at the end")
        return None
    longitudes = [each[0] for each in ring]
    if max(longitudes) - min(longitudes) > 180:
        where = "the zone" if outer else "the hole"
        node.error(f"{where} spans more than 180° of longitude; cut it at the 180th meridian (RFC 7946, 3.1.9)")
        return None
    return ring


def position(node: Node) -> Position | None:
    """Longitude and latitude; a height is left to the layer."""
    if not isinstance(node.value, list) or not 2 <= len(node.value) <= 3:
        node.error("expected a position: [longitude, latitude] in degrees")
        return None
    first, second = node.value[:2]
    if any(isinstance(each, bool) or not isinstance(each, int | float) for each in (first, second)):
        node.error("expected a position: [longitude, latitude], two numbers in degrees")
        return None
    if abs(second) > 90 and abs(first) <= 90:
        node.error(f"latitude {second}: longitude comes first, then latitude; these look exchanged")
        return None
    if abs(first) > 180 or abs(second) > 90:
        node.error(f"[{first}, {second}] is nowhere on Earth; longitude −180 to 180, then latitude −90 to 90")
        return None
    return [first, second]


def _wound(node: Node, ring: Ring, *, ccw: bool) -> Ring:
    """The ring in the direction that RFC 7946 wants; what comes otherwise is unambiguous all the same."""
    if shapely.LinearRing(ring).is_ccw == ccw:
        return ring
    wanted = "anticlockwise" if ccw else "clockwise"
    node.notice(f"the ring was turned: {'an outer ring' if ccw else 'a hole'} runs {wanted} (RFC 7946, 3.1.6)")
    return ring[::-1]


def _say_invalid(node: Node, rings: list[Ring], why: str) -> None:
    """The error, at the position of the polygon that is nearest to where it is."""
    match = _AT.search(why)
    what = why[: match.start()].strip() if match else why
    advice = {
        "Self-intersection": "the polygon crosses itself",
        "Ring Self-intersection": "the ring touches itself",
        "Hole lies outside shell": "a hole lies outside of the outer ring",
        "Holes are nested": "one hole lies within another",
        "Interior is disconnected": "holes cut the zone into pieces; write them as separate polygons",
        "Too few points in geometry component": "the ring has too few different positions",
    }.get(what, what)
    if match is None:
        node.error(f"{advice}; correct the rings")
        return
    x, y = float(match[1]), float(match[2])
    _, ring, index = min(
        ((point[0] - x) ** 2 + (point[1] - y) ** 2, ring_index, point_index)
        for ring_index, ring in enumerate(rings)
        for point_index, point in enumerate(ring)
    )
    node.at(ring).at(index).error(f"{advice} near [{x:.6f}, {y:.6f}]; correct the positions around there")


def circle(centre: Node, radius: Node, unit_m: float) -> tuple[Position, float] | None:
    """Centre, and radius in metres."""
    point = position(centre)
    length = radius.number(0.1, MAX_RADIUS_M / unit_m)
    if point is None or length is None:
        return None
    metres = length * unit_m
    if abs(point[1]) + metres / DEGREE_M > 89:
        centre.error("the circle reaches a pole; write the zone as a polygon")
        return None
    return point, metres


def layer(node: Node) -> Json:
    """Vertical limits as ED-318 writes them."""
    document: Json = {}
    unit = node.maybe("uom")
    uom = unit.choice(("m", "ft")) if unit is not None else None
    for edge in ("lower", "upper"):
        limit, reference = node.maybe(edge), node.maybe(f"{edge}Reference")
        if limit is None:
            continue
        set_if(document, edge, limit.number(-MAX_LIMIT, MAX_LIMIT))
        if reference is None:
            limit.error(f"`{edge}Reference` is missing; say whether the limit is AGL, AMSL or WGS84")
        else:
            set_if(document, f"{edge}Reference", reference.choice(REFERENCES))
    if uom is not None:
        document["uom"] = uom
    require_order(node, document)
    return document


def require_order(node: Node, document: Json) -> None:
    """An error where the lower limit is not below the upper one and both are over the same ground."""
    lower, upper = document.get("lower"), document.get("upper")
    same = document.get("lowerReference") == document.get("upperReference")
    if lower is not None and upper is not None and same and lower >= upper:
        node.error(f"the lower limit ({lower:g}) is not below the upper one ({upper:g})")


def geometry(node: Node) -> Json | None:
    """A geometry of ED-318 that covers an area; None with errors noted."""
    if not node.is_object():
        return None
    kind = node.need("type")
    name = kind.value if kind is not None else None
    if name != "GeometryCollection":
        return _part(node, name)
    listed = node.need("geometries")
    if listed is None:
        return None
    outer = node.maybe("layer")
    common = layer(outer) if outer is not None and outer.is_object() else None
    parts = []
    for each in listed.items(1, MAX_PARTS):
        if each.is_object():
            inner = each.need("type")
            part = _part(each, inner.value if inner is not None else None)
            if part is not None:
                if common is not None:
                    part.setdefault("layer", common)
                parts.append(part)
    return {"type": "GeometryCollection", "geometries": parts}


def _part(node: Node, kind: Any) -> Json | None:
    kind = kind if isinstance(kind, str) else None
    document: Json = {"type": kind}
    coordinates = node.need("coordinates") if kind in {"Polygon", "MultiPolygon", "Point"} else None
    if kind == "Polygon" and coordinates is not None:
        set_if(document, "coordinates", polygon(coordinates))
    elif kind == "MultiPolygon" and coordinates is not None:
        parts = [polygon(each) for each in coordinates.items(1, MAX_PARTS)]
        document["coordinates"] = [part for part in parts if part is not None]
    elif kind == "Point" and coordinates is not None:
        _circle_of(node, coordinates, document)
    elif coordinates is None and kind not in {"Polygon", "MultiPolygon", "Point"}:
        node.error(f"{str(kind)[:40]} has no area; write a Polygon, a MultiPolygon, or a Point with `extent`")
        return None
    inner = node.maybe("layer")
    if inner is not None and inner.is_object():
        document["layer"] = layer(inner)
    return document


def _circle_of(node: Node, coordinates: Node, document: Json) -> None:
    extent = node.maybe("extent")
    if extent is None or not extent.is_object():
        node.error('a Point has no area; add `extent`: {"subType": "Circle", "radius": metres}')
        return
    sub_type, radius = extent.need("subType"), extent.need("radius")
    if sub_type is not None:
        sub_type.choice(("Circle",))
    found = circle(coordinates, radius, 1.0) if radius is not None else None
    if found is not None:
        document["coordinates"] = found[0]
        document["extent"] = {"subType": "Circle", "radius": found[1]}
