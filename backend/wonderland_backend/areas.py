"""A box on the map, as a query parameter writes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

from wonderland.problems import said
from wonderland_backend.errors import BadRequest

PATTERN: Final = r"^-?\d{1,3}(\.\d{1,9})?(,-?\d{1,3}(\.\d{1,9})?){3}$"
DESCRIPTION: Final = "west,south,east,north in degrees (WGS-84); west > east: across the 180th meridian"
BAD_BOX: Final = BadRequest(
    said("bad_box"),
    ("query.bbox", said("bad_box_field")),
)
E7: Final = 10_000_000


@dataclass(frozen=True)
class Box:
    """A part of the map, in degrees × 10⁷. `west` > `east`: it lies across the 180th meridian."""

    west: int
    south: int
    east: int
    north: int

    @classmethod
    def parse(cls, text: str) -> Self:
        """From ``west,south,east,north`` in degrees, of the form `PATTERN`. Raises `BadRequest`."""
        west, south, east, north = (round(float(part) * E7) for part in text.split(","))
        if not -90 * E7 <= south <= north <= 90 * E7 or max(abs(west), abs(east)) > 180 * E7:
            raise BadRequest(BAD_BOX.said, *BAD_BOX.errors)
        return cls(west, south, east, north)

    def holds(self, lat_e7: int, lon_e7: int) -> bool:
        """Whether a place is inside, or on the edge."""
        if not self.south <= lat_e7 <= self.north:
            return False
        if self.west <= self.east:
            return self.west <= lon_e7 <= self.east
        return lon_e7 >= self.west or lon_e7 <= self.east
