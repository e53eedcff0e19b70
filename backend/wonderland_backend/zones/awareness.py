"""The geo-awareness service: which zones hold at a place, on a route or in an area, then."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, radians
from typing import Any, Final

import shapely
from shapely.affinity import scale

from wonderland.problems import said
from wonderland_backend.errors import BadRequest
from wonderland_backend.zones.applicability import Span, spans
from wonderland_backend.zones.files.findings import Findings
from wonderland_backend.zones.files.node import Node
from wonderland_backend.zones.files.shapes import polygon, position
from wonderland_backend.zones.heights import Band, Reaches, reaches
from wonderland_backend.zones.shown import Row
from wonderland_backend.zones.store import validity
from wonderland_backend.zones.zone import STRICTNESS, Zone, zone_of

MAX_POSITIONS: Final = 1_000
MAX_LISTED: Final = 500
DEGREE_M: Final = 109_500.0
"""A little less than any degree of latitude, so that a margin is never smaller than asked for."""


@dataclass(frozen=True)
class Question:
    """An area on the map, heights (None: all of them), and a span of time."""

    area: Any
    band: Band | None
    from_ms: int
    until_ms: int


@dataclass(frozen=True)
class There:
    """A zone that holds there and then."""

    row: Row
    spans: list[Span]
    reaches: Reaches


def holding(rows: Iterable[Row], question: Question) -> list[There]:
    """The zones among these that meet the question, the most restrictive first."""
    shapely.prepare(question.area)
    found = []
    for row in rows:
        zone = zone_of(row[0].feature)
        how = _reaches(zone, question)
        if how == "no":
            continue
        # A moment is the millisecond that begins with it.
        when = spans(zone, question.from_ms, max(question.until_ms, question.from_ms + 1), validity(row[1].about))
        if when:
            found.append(There(row, when, how))
    return sorted(found, key=lambda each: (STRICTNESS.index(each.row[0].type), each.row[0].zone_id))


def _reaches(zone: Zone, question: Question) -> Reaches:
    how: Reaches = "no"
    for volume in zone.volumes:
        if not question.area.intersects(volume.area):
            continue
        its = "yes" if question.band is None else reaches(volume, question.band)
        if its == "yes":
            return "yes"
        how = "perhaps" if its == "perhaps" else how
    return how


def area_of(geometry: dict[str, Any], margin_m: float) -> Any:
    """The area that a GeoJSON geometry means. Raises `BadRequest`, which names the position."""
    findings = Findings()
    node = Node(geometry, ("geometry",), findings)
    coordinates = node.need("coordinates")
    shape: Any = None
    kind = geometry.get("type")
    if coordinates is not None and kind == "Point":
        point = position(coordinates)
        shape = shapely.Point(point) if point is not None else None
    elif coordinates is not None and kind == "LineString":
        points = [position(each) for each in coordinates.items(2, MAX_POSITIONS)]
        shape = shapely.LineString([each for each in points if each is not None]) if not findings.errors else None
    elif coordinates is not None and kind == "Polygon":
        rings = polygon(coordinates)
        if rings is not None and sum(map(len, rings)) > MAX_POSITIONS:
            coordinates.error(f"more than {MAX_POSITIONS} positions; ask with a simpler outline")
        shape = shapely.Polygon(rings[0], rings[1:]) if rings is not None else None
    else:
        node.error("`type` must be Point, LineString or Polygon, with `coordinates`")
    if findings.errors or shape is None:
        errors = [(".".join(map(str, ("body", *path))), message) for path, message in findings.errors[:20]]
        raise BadRequest(said("bad_geometry"), *errors)
    return widened(shape, margin_m)


def widened(shape: Any, margin_m: float) -> Any:
    """The shape and what lies so close to it; a little more, never less."""
    if margin_m == 0:
        return shape
    _, south, _, north = shape.bounds
    narrow = max(cos(radians(max(abs(south), abs(north)))), 0.01)
    origin = (0, 0)
    flat = scale(shape, narrow, 1, origin=origin)
    return scale(flat.buffer(margin_m / DEGREE_M, quad_segs=8), 1 / narrow, 1, origin=origin)
