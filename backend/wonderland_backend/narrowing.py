"""Which pads and drones a filter means: those in a box on the map, those of an operator."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

import orjson
from sqlalchemy import Select, select
from sqlalchemy.ext.asyncio import AsyncSession
from sqlalchemy.orm import InstrumentedAttribute

from wonderland.problems import said
from wonderland_backend.areas import Box
from wonderland_backend.db.tables.ledger import DroneRow, PadRow
from wonderland_backend.db.tables.reported import LatestTrackRow
from wonderland_backend.errors import BadRequest, Forbidden
from wonderland_backend.filters import AboutQuery
from wonderland_backend.person import EVERYBODY, Scope

OPERATORS_MASKED: Final = Forbidden(said("operators_masked"))
MAX_PADS: Final = 5_000
MAX_DRONES: Final = 5_000
_Column = InstrumentedAttribute[str] | InstrumentedAttribute[str | None]


async def pads_within(database: AsyncSession, box: Box) -> list[str]:
    """The pads in a box. Raises `BadRequest` where there are too many to filter by."""
    rows = await database.execute(select(PadRow.pad_id, PadRow.record))
    found = [pad_id for pad_id, record in rows if (place := _place(record)) is not None and box.holds(*place)]
    if len(found) > MAX_PADS:
        raise BadRequest(said("too_many_pads_there", most=MAX_PADS))
    return found


async def drones_within(database: AsyncSession, box: Box) -> list[str]:
    """The drones that were heard last in a box. Raises `BadRequest` where there are too many to filter by."""
    rows = await database.execute(select(LatestTrackRow.uav_id, LatestTrackRow.body))
    found = [uav_id for uav_id, body in rows if (place := _place_in(body)) is not None and box.holds(*place)]
    if len(found) > MAX_DRONES:
        raise BadRequest(said("too_many_drones_there", most=MAX_DRONES))
    return found


async def narrowed(
    database: AsyncSession, query: Select[Any], filters: AboutQuery, scope: Scope, *, pad: _Column, drone: _Column
) -> Select[Any]:
    """Those that are about the pads and drones that a filter means; `pad` and `drone` are the columns of their names.

    Raises `BadRequest` for a box that is none, or has too many pads; `Forbidden` for an operator they may not know.
    """
    if filters.pad is not None:
        query = query.where(pad == filters.pad)
    if filters.drone is not None:
        query = query.where(drone == filters.drone)
    if filters.operator is not None:
        query = query.where(drone.in_(drones_of(filters.operator, scope)))
    if filters.bbox is not None:
        query = query.where(pad.in_(await pads_within(database, Box.parse(filters.bbox))))
    return query


def drones_of(operator: str, scope: Scope) -> Select[Any]:
    """The drones of an operator, as a subquery: of those whose operators are not masked to whoever asks.

    Else whoever sees an operator id in part would find the rest by trying. Raises `Forbidden`.
    """
    require_operators(scope)
    query = select(DroneRow.uav_id).where(DroneRow.record.contains(field("operator_id", operator), autoescape=True))
    return query if scope.operators_of == EVERYBODY else query.where(DroneRow.msp_id == scope.operators_of)


def require_operators(scope: Scope) -> None:
    """Raises `Forbidden` for somebody who sees no drone's operator whole."""
    if not scope.operators_of:
        raise Forbidden(said("operators_masked"))


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
