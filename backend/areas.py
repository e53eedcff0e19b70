"""Which pads and drones a filter means: those in a box on the map, those of an operator."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Self

import orjson
from sqlalchemy import Select, select
from sqlalchemy.ext.asyncio import AsyncSession

from backend.db.tables.ledger import DroneRow, PadRow
from backend.db.tables.reported import LatestTrackRow
from backend.errors import BadRequest

if TYPE_CHECKING:
    from sqlalchemy.orm import InstrumentedAttribute

    from backend.filters import AboutQuery

    _Column = InstrumentedAttribute[str] | InstrumentedAttribute[str | None]

PATTERN: Final = r"^-?\d{1,3}(\.\d{1,9})?(,-?\d{1,3}(\.\d{1,9})?){3}$"
DESCRIPTION: Final = "west,south,east,north in degrees (WGS-84); west > east: across the 180th meridian"
BAD_BOX: Final = BadRequest(
    "`bbox` is west,south,east,north in degrees: south not above north, nothing beyond 90 or 180.",
    ("query.bbox", "not a box on the map"),
)
MAX_PADS: Final = 5_000
MAX_DRONES: Final = 5_000
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
            raise BadRequest(BAD_BOX.detail, *BAD_BOX.errors)
        return cls(west, south, east, north)

    def holds(self, lat_e7: int, lon_e7: int) -> bool:
        """Whether a place is inside, or on the edge."""
        if not self.south <= lat_e7 <= self.north:
            return False
        if self.west <= self.east:
            return self.west <= lon_e7 <= self.east
        return lon_e7 >= self.west or lon_e7 <= self.east


async def pads_within(database: AsyncSession, box: Box) -> list[str]:
    """The pads in a box. Raises `BadRequest` where there are too many to filter by."""
    rows = await database.execute(select(PadRow.pad_id, PadRow.record))
    found = [pad_id for pad_id, record in rows if (place := _place(record)) is not None and box.holds(*place)]
    if len(found) > MAX_PADS:
        raise BadRequest(f"There are more than {MAX_PADS} pads in this area; ask for a smaller one.")
    return found


async def drones_within(database: AsyncSession, box: Box) -> list[str]:
    """The drones that were heard last in a box. Raises `BadRequest` where there are too many to filter by."""
    rows = await database.execute(select(LatestTrackRow.uav_id, LatestTrackRow.body))
    found = [uav_id for uav_id, body in rows if (place := _place_in(body)) is not None and box.holds(*place)]
    if len(found) > MAX_DRONES:
        raise BadRequest(f"More than {MAX_DRONES} drones were heard in this area; ask for a smaller one.")
    return found


async def narrowed(
    database: AsyncSession, query: Select[Any], filters: AboutQuery, *, pad: _Column, drone: _Column
) -> Select[Any]:
    """Those that are about the pads and drones that a filter means; `pad` and `drone` are the columns of their names.

    Raises `BadRequest` for a box that is none, or has too many pads.
    """
    if filters.pad is not None:
        query = query.where(pad == filters.pad)
    if filters.drone is not None:
        query = query.where(drone == filters.drone)
    if filters.operator is not None:
        query = query.where(drone.in_(drones_of(filters.operator)))
    if filters.bbox is not None:
        query = query.where(pad.in_(await pads_within(database, Box.parse(filters.bbox))))
    return query


def drones_of(operator: str) -> Select[Any]:
    """The drones of an operator, as a subquery."""
    return select(DroneRow.uav_id).where(DroneRow.record.contains(field("operator_id", operator), autoescape=True))


def field(name: str, value: str) -> str:
    """A member of a record as it stands in canonical JSON.

    No text within a record can look like it: there a quotation mark has a backslash before it.
    """
    return f'"{name}":{orjson.dumps(value).decode()}'


@lru_cache(maxsize=65_536)
def _place(record: str) -> tuple[int, int] | None:
    return _place_in(record)


def _place_in(record: str) -> tuple[int, int] | None:
    found = orjson.loads(record)
    place = found.get("lat_e7"), found.get("lon_e7")
    return place if isinstance(place[0], int) and isinstance(place[1], int) else None
