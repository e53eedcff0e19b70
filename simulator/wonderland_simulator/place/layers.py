"""What a map shows of an extract, in the layers and words of the Protomaps schema, so that one style serves both.

Layers: landuse, water, roads, buildings, places, pois, trees. Shapes are in the plane of `vector_tiles.Plane`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import shapely
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import polygonize, unary_union

from wonderland_simulator.place.osm import Extract, Tags, Way
from wonderland_simulator.place.vector_tiles import Feature, Plane, Value

STOREY_M: Final = 3.2
PARAPET_M: Final = 0.8
MAX_HEIGHT_M: Final = 900.0
UNDERGROUND: Final = frozenset({"underground", "indoor"})

GROUND: Final[dict[tuple[str, str], str]] = {
    ("leisure", "park"): "park",
    ("leisure", "garden"): "park",
    ("leisure", "pitch"): "pitch",
    ("leisure", "playground"): "playground",
    ("leisure", "stadium"): "pitch",
    ("leisure", "swimming_pool"): "swimming_pool",
    ("landuse", "grass"): "grass",
    ("landuse", "flowerbed"): "grass",
    ("landuse", "forest"): "wood",
    ("landuse", "cemetery"): "cemetery",
    ("natural", "wood"): "wood",
    ("natural", "scrub"): "scrub",
    ("natural", "beach"): "beach",
    ("natural", "bare_rock"): "bare_rock",
    ("amenity", "parking"): "parking",
    ("aeroway", "heliport"): "heliport",
    ("aeroway", "helipad"): "helipad",
    ("man_made", "pier"): "pier",
    ("man_made", "quay"): "pier",
    ("man_made", "breakwater"): "pier",
}
ROADS: Final[dict[str, tuple[str, int]]] = {
    "motorway": ("highway", 11),
    "trunk": ("major_road", 11),
    "primary": ("major_road", 11),
    "secondary": ("major_road", 11),
    "tertiary": ("medium_road", 12),
    "unclassified": ("minor_road", 13),
    "residential": ("minor_road", 13),
    "living_street": ("minor_road", 13),
    "service": ("service", 14),
    "pedestrian": ("pedestrian", 14),
    "footway": ("path", 15),
    "path": ("path", 15),
    "cycleway": ("path", 15),
    "steps": ("steps", 15),
}
POIS: Final[dict[tuple[str, str], str]] = {
    ("railway", "station"): "station",
    ("amenity", "hospital"): "hospital",
    ("aeroway", "heliport"): "heliport",
    ("tourism", "museum"): "museum",
    ("amenity", "casino"): "casino",
    ("amenity", "theatre"): "theatre",
    ("amenity", "townhall"): "townhall",
    ("amenity", "police"): "police",
    ("amenity", "fire_station"): "fire_station",
    ("leisure", "stadium"): "stadium",
    ("leisure", "park"): "park",
    ("leisure", "garden"): "park",
    ("natural", "beach"): "beach",
}
PLACES: Final = {"city": 10, "town": 10, "suburb": 12, "quarter": 13, "neighbourhood": 13}


@dataclass(frozen=True)
class Contents:
    """The features, and how the heights of the buildings are known."""

    features: list[Feature]
    heights: Counter[str]


def features_of(extract: Extract, plane: Plane) -> Contents:
    """Everything but the shore."""
    result: list[Feature] = []
    heights: Counter[str] = Counter()
    for shape, tags in _areas(extract, plane):
        result += _ground(shape, tags)
        built = _building(shape, tags, heights)
        if built is not None:
            result.append(built)
    for way in extract.ways.values():
        line = _line(extract, way, plane)
        if line is not None and way.tags:
            result += _roads(line, way.tags)
    for number, tags in extract.marked.items():
        if number in extract.places:
            result += _points(Point(plane.at(*extract.places[number])), tags, number)
    return Contents(result, heights)


def _line(extract: Extract, way: Way, plane: Plane) -> LineString | None:
    points = [plane.at(*each) for each in extract.line(way)]
    return LineString(points) if len(points) >= 2 else None


def _areas(extract: Extract, plane: Plane) -> Iterator[tuple[BaseGeometry, Tags]]:
    """Closed ways and multipolygons, made valid."""
    for way in extract.ways.values():
        closed = len(way.nodes) >= 4 and way.nodes[0] == way.nodes[-1]
        if closed and way.tags and (way.tags.get("area") == "yes" or "highway" not in way.tags):
            points = [plane.at(*each) for each in extract.line(way)]
            if len(points) >= 4:
                yield from _valid(Polygon(points), way.tags)
    for relation in extract.relations.values():
        if relation.tags.get("type") != "multipolygon":
            continue
        rings: dict[str, list[LineString]] = {"outer": [], "inner": []}
        for kind, number, role in relation.members:
            way_of = extract.ways.get(number) if kind == 1 else None
            line = None if way_of is None else _line(extract, way_of, plane)
            if line is not None:
                rings["inner" if role == "inner" else "outer"].append(line)
        outer = unary_union(list(polygonize(unary_union(rings["outer"])))) if rings["outer"] else Polygon()
        inner = unary_union(list(polygonize(unary_union(rings["inner"])))) if rings["inner"] else Polygon()
        yield from _valid(outer.difference(inner), relation.tags)


def _valid(shape: BaseGeometry, tags: Tags) -> Iterator[tuple[BaseGeometry, Tags]]:
    whole = shape if shape.is_valid else shapely.make_valid(shape)
    parts = [each for each in getattr(whole, "geoms", [whole]) if isinstance(each, Polygon | MultiPolygon)]
    if parts:
        yield unary_union(parts), tags


def _named(tags: Tags, kind: str) -> dict[str, Value]:
    names = {key: value for key, value in tags.items() if key in {"name", "name:en", "name:fi"}}
    return {"kind": kind, **names}


def _ground(shape: BaseGeometry, tags: Tags) -> Iterator[Feature]:
    if tags.get("natural") == "water" or tags.get("amenity") == "fountain":
        yield Feature("water", shape, _named(tags, "lake"), 13)
        return
    kind = next((GROUND[key, tags[key]] for key, _ in GROUND if (key, tags.get(key)) in GROUND), None)
    if tags.get("highway") in {"pedestrian", "footway"} or tags.get("place") == "square":
        kind = kind or "pedestrian"
    if kind is None:
        return
    yield Feature("landuse", shape, _named(tags, kind), 11 if kind in {"park", "wood", "beach", "pier"} else 13)
    if kind == "helipad":
        yield Feature("pois", shape.centroid, _named(tags, "helipad"), 15)
    poi = next((POIS[each] for each in POIS if tags.get(each[0]) == each[1]), None)
    if poi is not None and "name" in tags:
        yield Feature("pois", shape.representative_point(), _named(tags, poi), 14)


def _building(shape: BaseGeometry, tags: Tags, heights: Counter[str]) -> Feature | None:
    kind = tags.get("building", "no"), tags.get("building:part", "no")
    if kind == ("no", "no") or tags.get("location") in UNDERGROUND or tags.get("layer", "").startswith("-"):
        return None
    height, source = _height(shape.area, tags)
    heights[source] += 1
    storeys = _metres(tags.get("building:min_level")) or 0.0
    from_m = _metres(tags.get("min_height")) or storeys * STOREY_M
    properties: dict[str, Value] = {
        "kind": "building" if kind[0] != "no" else "building_part",
        "height": round(height, 1),
        "min_height": round(min(from_m, height), 1),
        "height_source": source,
    }
    if "name" in tags:
        properties["name"] = tags["name"]
    return Feature("buildings", shape, properties, 13)


def _height(area_m2: float, tags: Tags) -> tuple[float, str]:
    """Metres, and whether they were measured, follow from the storeys, or are guessed from the size."""
    told = _metres(tags.get("height"))
    if told:
        return told, "measured"
    storeys = _metres(tags.get("building:levels"))
    if storeys:
        roof = _metres(tags.get("roof:levels")) or 0.0
        return min(MAX_HEIGHT_M, (storeys + roof) * STOREY_M + PARAPET_M), "storeys"
    low = tags.get("building") in {"roof", "garage", "garages", "shed", "kiosk", "hut", "service"}
    guess = 1 if low or area_m2 < 45 else 2 if area_m2 < 110 else 3 if area_m2 < 200 else 4
    return guess * STOREY_M + PARAPET_M, "guessed"


def _metres(text: str | None) -> float | None:
    found = re.match(r"\s*(\d{1,4}(?:[.,]\d+)?)", text or "")
    return None if found is None else min(MAX_HEIGHT_M, float(found.group(1).replace(",", ".")))


def _roads(line: LineString, tags: Tags) -> Iterator[Feature]:
    if tags.get("area") == "yes":
        return
    highway = tags.get("highway", "").removesuffix("_link")
    if highway in ROADS:
        kind, least = ROADS[highway]
        hidden = tags.get("tunnel", "no") != "no" or tags.get("covered") == "yes" or tags.get("indoor") == "yes"
        properties = {**_named(tags, kind), "kind_detail": highway}
        if hidden:
            properties["is_tunnel"] = True
        if tags.get("bridge", "no") != "no":
            properties["is_bridge"] = True
        yield Feature("roads", line, properties, least)
    elif tags.get("railway") in {"rail", "light_rail", "tram"} and tags.get("tunnel", "no") == "no":
        yield Feature("roads", line, _named(tags, "rail"), 12)
    elif tags.get("man_made") in {"pier", "breakwater"} and not line.is_closed:
        yield Feature("landuse", line.buffer(2.0, cap_style="flat"), _named(tags, "pier"), 13)


def _points(at: Point, tags: Tags, number: int) -> Iterator[Feature]:
    if tags.get("natural") == "tree":
        # Crowns differ, and are the same at every making: by the tree's number.
        crown = at.buffer(1.4 + number % 7 * 0.2, quad_segs=2)
        yield Feature("trees", crown, {"height": 5 + number % 4, "min_height": 1.8}, 15)
    elif tags.get("place") in PLACES and "name" in tags:
        kind = tags["place"]
        yield Feature(
            "places",
            at,
            _named(tags, "locality" if kind in {"city", "town"} else "neighbourhood") | {"kind_detail": kind},
            PLACES[kind],
        )
    elif "name" in tags:
        poi = next((POIS[each] for each in POIS if tags.get(each[0]) == each[1]), None)
        if poi is not None:
            yield Feature("pois", at, _named(tags, poi), 14)


def harbour_names(extract: Extract, plane: Plane) -> Iterator[Feature]:
    """Harbours are areas or points, by several tags; their names stand on the water."""
    for shape, tags in _areas(extract, plane):
        is_harbour = tags.get("leisure") == "marina" or tags.get("seamark:type") == "harbour"
        if is_harbour and "name" in tags:
            yield Feature("pois", shape.representative_point(), _named(tags, "harbour"), 12)


def street_width_m(kind: str) -> float:
    """How far a street reaches to either side, about: where an extract knows the ground."""
    return {"highway": 16.0, "major_road": 12.0, "medium_road": 10.0}.get(kind, 8.0) + math.sqrt(2)
