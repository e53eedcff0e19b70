"""Boxes of latitude and longitude, across the antimeridian and at the poles; and one grid over the Earth.

Coordinates are degrees × 10⁷ (integers); lengths metres on the sphere of the equator's radius, as the test suite of
InterUSS measures them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

E7: Final = 10_000_000
TURN: Final = 360 * E7
EARTH_M: Final = 6_378_137.0
_POLE: Final = 90 * E7


@dataclass(frozen=True, slots=True)
class Box:
    """From `south` to `north`, and from `west` (−180° included, 180° not) eastwards by `width`. Edges belong to it."""

    south: int
    west: int
    north: int
    width: int

    @classmethod
    def between(cls, lat_1: float, lng_1: float, lat_2: float, lng_2: float) -> Box:
        """The smallest box with these corners (degrees), rounded outwards."""
        south, north = math.floor(min(lat_1, lat_2) * E7), math.ceil(max(lat_1, lat_2) * E7)
        west, east = sorted((lng_1, lng_2))
        low, high = math.floor(west * E7), math.ceil(east * E7)
        if high - low > TURN // 2:  # the other way round is shorter
            low, high = math.floor(east * E7), math.ceil(west * E7) + TURN
        return cls(south, _wrapped(low), north, high - low)

    @classmethod
    def around(cls, lat: float, lng: float, radius_m: float) -> Box:
        """A box that holds a circle (centre in degrees)."""
        reach = math.degrees(radius_m / EARTH_M) * 1.01  # the ellipsoid is up to 0.7 % smaller than the sphere
        south, north = max(-90.0, lat - reach), min(90.0, lat + reach)
        narrow = math.cos(math.radians(max(abs(south), abs(north))))
        wide = reach / narrow if narrow > 1e-9 else 180.0
        if wide >= 180:
            return cls(math.floor(south * E7), -TURN // 2, math.ceil(north * E7), TURN)
        west = math.floor((lng - wide) * E7)
        return cls(math.floor(south * E7), _wrapped(west), math.ceil(north * E7), math.ceil((lng + wide) * E7) - west)

    def grown(self, margin_m: float) -> Box:
        """The box with so much more on every side."""
        up = math.ceil(math.degrees(margin_m / EARTH_M) * E7)
        south, north = max(-_POLE, self.south - up), min(_POLE, self.north + up)
        narrow = math.cos(_radians(max(abs(south), abs(north))))
        aside = math.ceil(up / narrow) if narrow * TURN > up else TURN
        if self.width + 2 * aside >= TURN:
            return Box(south, -TURN // 2, north, TURN)
        return Box(south, _wrapped(self.west - aside), north, self.width + 2 * aside)

    @property
    def east(self) -> int:
        """The eastern edge, from −180° to 180°; where it is below `west`, the antimeridian is within."""
        east = self.west + self.width
        return east if east <= TURN // 2 else east - TURN

    def contains(self, lat: int, lng: int) -> bool:
        """Whether a position is within."""
        return self.south <= lat <= self.north and (lng - self.west) % TURN <= self.width

    def meets(self, other: Box) -> bool:
        """Whether two boxes have a position in common."""
        if self.south > other.north or other.south > self.north:
            return False
        return (other.west - self.west) % TURN <= self.width or (self.west - other.west) % TURN <= other.width

    def diagonal_m(self) -> float:
        """The longest distance between two of its corners."""
        east = self.west + min(self.width, TURN // 2)
        corners = [(lat, lng) for lat in (self.south, self.north) for lng in (self.west, east)]
        return max(distance_m(*one, *other) for one in corners for other in corners)

    def area_m2(self) -> float:
        """Its area in square metres, on the sphere."""
        height = abs(math.sin(_radians(self.north)) - math.sin(_radians(self.south)))
        return EARTH_M**2 * height * _radians(min(self.width, TURN))

    def view(self) -> str:
        """As the parameter `view` of F3411."""
        return ",".join(_degrees(each) for each in (self.south, self.west, self.north, self.east))

    def vertices(self) -> list[dict[str, float]]:
        """Its corners, counter-clockwise, as F3411 writes them."""
        corners = ((self.south, self.west), (self.south, self.east), (self.north, self.east), (self.north, self.west))
        return [{"lat": lat / E7, "lng": lng / E7} for lat, lng in corners]


def distance_m(lat_1: int, lng_1: int, lat_2: int, lng_2: int) -> float:
    """The distance of two positions over the sphere."""
    phi_1, phi_2 = _radians(lat_1), _radians(lat_2)
    half = math.sin((phi_2 - phi_1) / 2) ** 2
    half += math.cos(phi_1) * math.cos(phi_2) * math.sin(_radians(lng_2 - lng_1) / 2) ** 2
    return 2 * EARTH_M * math.asin(min(1.0, math.sqrt(half)))


# The grid: rows of equal height, each row cut into columns at least as wide as high at its poleward edge. A cell is
# cut into four for the next finer level, so that cells of different levels lie in each other. It does not move with
# anybody's view: what lies in a cell cannot be narrowed down by looking at it through many views.

FINEST_E7: Final = 56_250
"""Height of the finest cells: 626 m, more than twice the standard's obfuscation distance of 300 m."""
TILES: Final = 4
"""Level of the coarsest cells, about 10 km: what is announced to a DSS and what is subscribed to."""
TILE_E7: Final = FINEST_E7 << TILES
_ROWS: Final = 180 * E7 // TILE_E7


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """A cell of the grid."""

    level: int
    row: int
    column: int

    @classmethod
    def at(cls, lat: int, lng: int, level: int) -> Cell:
        """The cell that a position lies in."""
        height = FINEST_E7 << level
        row = min((lat + _POLE) // height, 2 * _POLE // height - 1)
        columns = _columns(row >> (TILES - level), level)
        return cls(level, row, (lng + TURN // 2) % TURN * columns // TURN)

    def box(self) -> Box:
        """Its edges in degrees."""
        height = FINEST_E7 << self.level
        columns = _columns(self.row >> (TILES - self.level), self.level)
        west, east = -(-self.column * TURN // columns), -(-(self.column + 1) * TURN // columns)
        south = self.row * height - _POLE
        return Box(south, west - TURN // 2, south + height, east - west)

    @property
    def is_cap(self) -> bool:
        """Whether it goes all the way round, at a pole."""
        return _columns(self.row >> (TILES - self.level), self.level) == 1


def cells_of(box: Box, level: int) -> Iterator[Cell]:
    """The cells that a box meets. For small boxes: there are 10⁷ tiles."""
    height = FINEST_E7 << level
    last = 2 * _POLE // height - 1
    for row in range(min((box.south + _POLE) // height, last), min((box.north + _POLE) // height, last) + 1):
        columns = _columns(row >> (TILES - level), level)
        first = (box.west + TURN // 2) * columns // TURN
        past = (box.west + TURN // 2 + box.width) * columns // TURN
        for column in range(first, min(past, first + columns - 1) + 1):
            yield Cell(level, row, column % columns)


@cache
def _columns(tile_row: int, level: int) -> int:
    south = tile_row * TILE_E7 - _POLE
    poleward = max(abs(south), abs(south + TILE_E7))
    tiles = int(math.cos(_radians(poleward)) * TURN / TILE_E7)
    return tiles << (TILES - level) if tiles > 1 else 1


def _wrapped(lng: int) -> int:
    return (lng + TURN // 2) % TURN - TURN // 2


def _radians(e7: int) -> float:
    return math.radians(e7 / E7)


def _degrees(e7: int) -> str:
    sign, (whole, rest) = "-" if e7 < 0 else "", divmod(abs(e7), E7)
    return f"{sign}{whole}.{rest:07d}"
