"""Flights by REST, as JSON or GeoJSON. Unverified, and they say so."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Final

import orjson
from fastapi import APIRouter, Path, Request
from fastapi.responses import Response

from wonderland.problems import said
from wonderland_backend import geojson
from wonderland_backend.access import SignedInPerson
from wonderland_backend.context import ContextDep
from wonderland_backend.db.tables.flights import FlightRow
from wonderland_backend.errors import BadRequest, NotFound, documented
from wonderland_backend.flights import store
from wonderland_backend.flights.grouping import GAP_MS
from wonderland_backend.flights.schemas import Flight, FlightFilters, FlightPage
from wonderland_backend.narrowing import OPERATORS_MASKED

router = APIRouter(tags=["flights"])
_NOT_FOUND: Final = NotFound(said("no_such_flight"))
MAX_PATH: Final = 5_000
FlightId = Annotated[str, Path(pattern="^[0-9a-f]{32}$")]


@router.get(
    "/flights",
    response_model=FlightPage,
    responses=documented(BadRequest, OPERATORS_MASKED) | geojson.documented(FlightPage),
)
async def list_flights(
    request: Request, context: ContextDep, filters: FlightFilters, person: SignedInPerson
) -> Response:
    """Flights, newest first. As GeoJSON each is a line from its first to its last position."""
    place = filters.after_place(int, str)
    async with context.database.read() as database:
        rows = await store.listing(
            database, filters, person.scope, before=(place[0], place[1]) if place is not None else None
        )
    return geojson.page(
        request,
        ((row, _shown(row, context.clock())) for row in rows),
        filters.limit,
        cursor_of=lambda row: (row.start_ms, row.flight_id),
        id_of=_id,
        geometry_of=lambda item: _line([item["first"], item["last"]]),
    )


@router.get(
    "/flights/{flight_id}", response_model=Flight, responses=documented(_NOT_FOUND) | geojson.documented(Flight)
)
async def read_flight(request: Request, context: ContextDep, flight_id: FlightId, person: SignedInPerson) -> Response:
    """One flight. As GeoJSON it is the line of its first 5,000 positions; as JSON they are at `/tracks/{uav_id}`."""
    async with context.database.read() as database:
        row = await store.find_flight(database, flight_id, person.scope)
        if row is None:
            raise NotFound(said("no_such_flight"))
        proofs = await store.proofs(database, row)
        path = await store.path(database, row, MAX_PATH) if geojson.wanted(request) else ()
    return geojson.one(
        request,
        _shown(row, context.clock()) | {"proofs": list(proofs)},
        id_of=_id,
        geometry_of=lambda _: _line([orjson.loads(body) for body in path]),
    )


def _shown(row: FlightRow, now_ms: int) -> dict[str, Any]:
    return {
        "flight_id": row.flight_id,
        "uav_id": row.uav_id,
        "start_ms": row.start_ms,
        "end_ms": row.end_ms,
        "active": now_ms - row.end_ms <= GAP_MS,
        "positions": row.positions,
        "first": {"lat_e7": row.first_lat_e7, "lon_e7": row.first_lon_e7},
        "last": {"lat_e7": row.last_lat_e7, "lon_e7": row.last_lon_e7},
        "extent": {name: getattr(row, name) for name in ("west_e7", "south_e7", "east_e7", "north_e7")},
        "verified": False,
    }


def _line(spots: Sequence[geojson.Item]) -> geojson.Geometry:
    """A line; a point where there is but one position, nothing where there is none."""
    points = [found["coordinates"] for spot in spots if (found := geojson.point(spot)) is not None]
    if not points:
        return None
    if len(points) == 1:
        return {"type": "Point", "coordinates": points[0]}
    return {"type": "LineString", "coordinates": points}


def _id(item: geojson.Item) -> str:
    return str(item["flight_id"])
