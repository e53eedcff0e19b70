"""Mapbox Vector Tiles 2.1: features of a plane cut into tiles and coded.

The format is public (github.com/mapbox/vector-tile-spec). Lengths of the plane are metres; see `plane`.
"""

from __future__ import annotations

import gzip
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from wonderland_simulator.place.archive import Tile, _varint

EXTENT: Final = 4096
BUFFER: Final = 64
"""What a tile knows beyond its edge, so that lines and outlines do not end there."""
EQUATOR_M: Final = 40_075_016.686
Value = str | float | int | bool
_MOVE, _LINE, _CLOSE = 1, 2, 7


@dataclass(frozen=True)
class Plane:
    """Web Mercator, scaled so that a unit is a metre at this latitude; y points south."""

    lat: float

    @property
    def size_m(self) -> float:
        """Of the whole world's side."""
        return EQUATOR_M * math.cos(math.radians(self.lat))

    def at(self, lon: float, lat: float) -> tuple[float, float]:
        """Degrees to metres."""
        y = 0.5 - math.log(math.tan(math.pi / 4 + math.radians(lat) / 2)) / (2 * math.pi)
        return ((lon / 360 + 0.5) * self.size_m, y * self.size_m)


@dataclass(frozen=True)
class Feature:
    """What stands somewhere; drawn from the zoom ``least`` on."""

    layer: str
    shape: BaseGeometry
    properties: Mapping[str, Value]
    least: int


@dataclass
class _Layer:
    name: str
    keys: dict[str, int] = field(default_factory=dict)
    values: dict[tuple[str, Value], int] = field(default_factory=dict)
    features: list[bytes] = field(default_factory=list)

    def coded(self) -> bytes:
        out = _field(1, self.name.encode())
        out += b"".join(_field(2, each) for each in self.features)
        out += b"".join(_field(3, key.encode()) for key in self.keys)
        out += b"".join(_field(4, _value(value)) for _, value in self.values)
        return _field(3, out + _number(5, EXTENT) + _number(15, 2))

    def add(self, feature: Feature, kind: int, geometry: Sequence[int]) -> None:
        tags = []
        for key, value in feature.properties.items():
            tags.append(self.keys.setdefault(key, len(self.keys)))
            # True and 1 are the same key of a dictionary, but not the same value of a tile.
            tags.append(self.values.setdefault((type(value).__name__, value), len(self.values)))
        out = _field(2, b"".join(map(_varint, tags))) + _number(3, kind)
        self.features.append(out + _field(4, b"".join(map(_varint, geometry))))


def cut(features: Sequence[Feature], plane: Plane, zooms: range, bounds: BaseGeometry) -> dict[Tile, bytes]:
    """All tiles that hold something of the features within the bounds, gzipped."""
    tree = shapely.STRtree([each.shape for each in features])
    result: dict[Tile, bytes] = {}
    for zoom in zooms:
        side = plane.size_m / (1 << zoom)
        west, north, east, south = bounds.bounds
        for x in range(int(west // side), int(east // side) + 1):
            for y in range(int(north // side), int(south // side) + 1):
                edge = side * BUFFER / EXTENT
                window = (x * side - edge, y * side - edge, (x + 1) * side + edge, (y + 1) * side + edge)
                found = sorted(tree.query(shapely.box(*window)))
                layers: dict[str, _Layer] = {}
                for index in found:
                    feature = features[index]
                    if feature.least <= zoom:
                        _add(layers, feature, window, (x * side, y * side, side / EXTENT))
                if layers:
                    data = b"".join(layer.coded() for layer in layers.values())
                    result[zoom, x, y] = gzip.compress(data, mtime=0)
    return result


def _add(
    layers: dict[str, _Layer],
    feature: Feature,
    window: tuple[float, float, float, float],
    scale: tuple[float, float, float],
) -> None:
    shape = feature.shape
    if not isinstance(shape, Point):
        shape = shapely.clip_by_rect(shape, *window).simplify(scale[2] * 0.6)
    layer = layers.get(feature.layer) or _Layer(feature.layer)
    for kind in (1, 2, 3):
        geometry = _commands(shape, kind, scale)
        if geometry:
            layer.add(feature, kind, geometry)
            layers[feature.layer] = layer


def _commands(shape: BaseGeometry, kind: int, scale: tuple[float, float, float]) -> list[int]:
    """The drawing commands of the shape's parts of one kind: 1 points, 2 lines, 3 polygons."""
    out: list[int] = []
    here = (0, 0)
    for part in _parts(shape):
        if kind == 1 and isinstance(part, Point):
            lines = [_grid([(part.x, part.y)], scale)]
        elif kind == 2 and isinstance(part, LineString):
            lines = [_grid(part.coords, scale)]
        elif kind == 3 and isinstance(part, Polygon):
            # With y downwards, an outer ring that the tile wants clockwise has a positive area by the formula.
            rings = [_turned(_grid(part.exterior.coords, scale)[:-1], clockwise=True)]
            rings += [_turned(_grid(ring.coords, scale)[:-1], clockwise=False) for ring in part.interiors]
            lines = rings if len(rings[0]) >= 3 else []
        else:
            continue
        for line in lines:
            if len(line) < (1, 2, 3)[kind - 1]:
                continue
            out.append(1 << 3 | _MOVE)
            for index, point in enumerate(line):
                if index == 1:
                    out.append((len(line) - 1) << 3 | _LINE)
                out += [_zigzag(point[0] - here[0]), _zigzag(point[1] - here[1])]
                here = point
            if kind == 3:
                out.append(1 << 3 | _CLOSE)
    return out


def _parts(shape: BaseGeometry) -> Iterator[BaseGeometry]:
    parts = getattr(shape, "geoms", None)
    if parts is None:
        if not shape.is_empty:
            yield shape
        return
    for part in parts:
        yield from _parts(part)


def _grid(points: object, scale: tuple[float, float, float]) -> list[tuple[int, int]]:
    west, north, unit = scale
    out: list[tuple[int, int]] = []
    for x, y, *_ in points:  # type: ignore[attr-defined]
        at = (round((x - west) / unit), round((y - north) / unit))
        if not out or out[-1] != at:
            out.append(at)
    if len(out) == 1:
        return out
    return out


def _turned(ring: list[tuple[int, int]], *, clockwise: bool) -> list[tuple[int, int]]:
    doubled = sum(x * ring[(i + 1) % len(ring)][1] - ring[(i + 1) % len(ring)][0] * y for i, (x, y) in enumerate(ring))
    return ring if (doubled > 0) is clockwise else ring[::-1]


def _zigzag(value: int) -> int:
    return value << 1 if value >= 0 else (-value << 1) - 1


def _field(number: int, data: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _number(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _value(value: Value) -> bytes:
    if isinstance(value, bool):
        return _number(7, int(value))
    if isinstance(value, str):
        return _field(1, value.encode())
    if isinstance(value, int) and value >= 0:
        return _number(5, value)

    return _varint(3 << 3 | 1) + struct.pack("<d", value)
