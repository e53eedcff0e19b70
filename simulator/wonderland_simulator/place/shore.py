"""Where the sea begins, and where the extract ends: both drawn as areas, since a map has no word for either."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import linemerge, polygonize, unary_union

from wonderland_simulator.place.layers import street_width_m
from wonderland_simulator.place.osm import Extract
from wonderland_simulator.place.vector_tiles import Feature, Plane

STEPS: Final = 6
STEP_M: Final = 16.0
ASIDE_M: Final = 0.5


def shore(
    extract: Extract, plane: Plane, window: Polygon, leads: Sequence[Sequence[tuple[float, float]]]
) -> BaseGeometry:
    """The sea within the window, one (multi)polygon in the plane.

    Coastlines have land on their left. ``leads``: where the coast goes on beyond the extract's first and last node,
    degrees, to the window's edge; there the map fades anyway.
    """
    ways = [
        LineString([plane.at(*each) for each in extract.line(way)])
        for way in extract.ways.values()
        if way.tags.get("natural") == "coastline" and len(extract.line(way)) >= 2
    ]
    merged = linemerge(ways)
    lines = list(getattr(merged, "geoms", [merged]))
    if not lines:
        return Polygon()
    main = max(lines, key=lambda line: line.length)
    before, after = ([plane.at(*each) for each in lead] for lead in leads)
    longest = LineString([*before, *main.coords, *after])
    coast = [longest, *(line for line in lines if line is not main)]
    edges = unary_union([*coast, window.boundary])
    faces = [face for face in polygonize(edges) if window.buffer(0.01).contains(face)]
    return unary_union([face for face in faces if _is_sea(face, coast)])


def _is_sea(face: Polygon, coast: Sequence[LineString]) -> bool:
    """Whether the nearest coastline has the face on its right. With y southwards, right is a positive cross product."""
    point = face.representative_point()
    line = min(coast, key=point.distance)
    along = line.project(point)
    a = line.interpolate(max(0.0, along - ASIDE_M))
    b = line.interpolate(min(line.length, along + ASIDE_M))
    cross: float = (b.x - a.x) * (point.y - a.y) - (b.y - a.y) * (point.x - a.x)
    return cross > 0


def known_ground(features: Sequence[Feature]) -> BaseGeometry:
    """What the extract knows: around its buildings and streets, without holes."""
    buildings = [each.shape.simplify(3) for each in features if each.layer == "buildings"]
    streets = [
        each.shape.simplify(3).buffer(street_width_m(str(each.properties["kind"])), quad_segs=1)
        for each in features
        if each.layer == "roads" and each.properties["kind"] != "rail"
    ]
    near = unary_union([unary_union(buildings).buffer(30, quad_segs=2), unary_union(streets)])
    closed = near.simplify(2).buffer(45, quad_segs=3).buffer(-50, quad_segs=3)
    parts = list(getattr(closed, "geoms", [closed]))
    return Polygon(max(parts, key=lambda part: part.area).exterior).simplify(2)


def fading(known: BaseGeometry, sea: BaseGeometry, window: Polygon) -> Iterator[Feature]:
    """Bands around what is known, ever denser outwards: land beyond the data must not look like empty land."""
    land = window.difference(sea.buffer(0.5))
    for step in range(STEPS):
        ring = land.difference(known.buffer(step * STEP_M - 20, quad_segs=3).simplify(1))
        if step < STEPS - 1:
            # Bands that do not cover each other: painting the same ground six times costs frames.
            ring = ring.intersection(known.buffer((step + 1) * STEP_M - 20, quad_segs=3).simplify(1))
        ring = unary_union([part for part in getattr(ring, "geoms", [ring]) if part.area > 20])
        yield Feature("fade", ring, {"step": step}, 11)


def earth(sea: BaseGeometry, window: Polygon) -> Iterator[Feature]:
    """Land and sea as areas, and the coast as a line."""
    yield Feature("earth", window.difference(sea), {"kind": "earth"}, 11)
    yield Feature("water", sea, {"kind": "ocean"}, 11)
    coast = shapely.intersection(sea.boundary, window.buffer(-1))
    yield Feature("earth", coast, {"kind": "coast"}, 11)
