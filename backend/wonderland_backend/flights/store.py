"""Flights in the database: kept up with each batch of positions, in the same transaction."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from sqlalchemy import and_, delete, or_, select, tuple_
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.areas import Box
from wonderland_backend.db import bulk
from wonderland_backend.db.tables.flights import FlightRow
from wonderland_backend.db.tables.ledger import VerdictRow
from wonderland_backend.db.tables.reported import TrackRow
from wonderland_backend.flights.grouping import Flight, Position, grouped, span, stretches
from wonderland_backend.flights.schemas import FlightQuery
from wonderland_backend.narrowing import drones_of
from wonderland_backend.person import Scope

WRITE_EVERY_MS: Final = 10_000
MAX_REMEMBERED: Final = 10_000
_COLUMNS = tuple(FlightRow.__table__.columns)


class FlightLog:
    """Takes in positions as they are written, and brings the flights up to date every few seconds for each drone.

    A row for each position would cost as much as the positions themselves. What waits is lost with the process: a
    flight then counts fewer positions, and ends some seconds early if it is not heard again.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, list[Position]] = {}
        self._written: dict[str, int] = {}

    async def take_positions(
        self, connection: AsyncConnection, positions: Iterable[tuple[str, Position]], now_ms: int
    ) -> None:
        """Take in positions, (uav_id, position) each; write those of drones that have waited long enough."""
        for uav_id, position in positions:
            self._waiting.setdefault(uav_id, []).append(position)
        due = {
            uav_id: of_drone
            for uav_id, of_drone in self._waiting.items()
            if now_ms - self._written.get(uav_id, 0) >= WRITE_EVERY_MS
        }
        await note(connection, due)
        for uav_id in due:
            del self._waiting[uav_id]
            self._written[uav_id] = now_ms
        if len(self._written) > MAX_REMEMBERED:
            recent = now_ms - WRITE_EVERY_MS
            self._written = {uav_id: t_ms for uav_id, t_ms in self._written.items() if t_ms > recent}


async def note(connection: AsyncConnection, heard: Mapping[str, Iterable[Position]]) -> None:
    """Bring the flights of these drones up to date."""
    if not heard:
        return
    new = {uav_id: stretches(uav_id, of_drone) for uav_id, of_drone in heard.items()}
    begin, end = span([flight for flights in new.values() for flight in flights])
    query = select(*_COLUMNS).where(
        FlightRow.uav_id.in_(list(new)), FlightRow.end_ms >= begin, FlightRow.start_ms <= end
    )
    known: dict[str, list[Flight]] = {}
    for row in await connection.execute(query):
        known.setdefault(row.uav_id, []).append(Flight(*row))
    changed: list[Flight] = []
    gone: list[str] = []
    for uav_id, flights in new.items():
        of_drone = grouped(known.get(uav_id, ()), flights)
        changed += of_drone[0]
        gone += of_drone[1]
    if gone:
        await connection.execute(delete(FlightRow).where(FlightRow.flight_id.in_(gone)))
    await bulk.upsert(connection, FlightRow, [flight.to_row() for flight in changed])


async def forget(connection: AsyncConnection, before_ms: int) -> None:
    """Delete flights that ended before this."""
    await connection.execute(delete(FlightRow).where(FlightRow.end_ms < before_ms))


async def listing(
    database: AsyncSession, filters: FlightQuery, scope: Scope, *, before: tuple[int, str] | None
) -> Sequence[FlightRow]:
    """Flights, newest first, one more than `filters.limit`."""
    query = select(FlightRow).order_by(FlightRow.start_ms.desc(), FlightRow.flight_id.desc()).limit(filters.limit + 1)
    query = scope.narrow(query, drone=FlightRow.uav_id)
    if before is not None:
        query = query.where(tuple_(FlightRow.start_ms, FlightRow.flight_id) < before)
    if filters.drone is not None:
        query = query.where(FlightRow.uav_id == filters.drone)
    if filters.operator is not None:
        query = query.where(FlightRow.uav_id.in_(drones_of(filters.operator, scope)))
    if filters.since_ms is not None:
        query = query.where(FlightRow.end_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(FlightRow.start_ms <= filters.until_ms)
    if filters.bbox is not None:
        box = Box.parse(filters.bbox)
        query = query.where(FlightRow.south_e7 <= box.north, FlightRow.north_e7 >= box.south)
        overlap = and_ if box.west <= box.east else or_
        query = query.where(overlap(FlightRow.west_e7 <= box.east, FlightRow.east_e7 >= box.west))
    return (await database.scalars(query)).all()


async def find_flight(database: AsyncSession, flight_id: str, scope: Scope) -> FlightRow | None:
    """One flight, if its drone is within the scope."""
    query = scope.narrow(select(FlightRow).where(FlightRow.flight_id == flight_id), drone=FlightRow.uav_id)
    return (await database.scalars(query)).first()


async def path(database: AsyncSession, row: FlightRow, limit: int) -> Sequence[str]:
    """Its first positions, as JSON texts."""
    query = (
        select(TrackRow.body)
        .where(TrackRow.uav_id == row.uav_id, TrackRow.t_ms.between(row.start_ms, row.end_ms))
        .order_by(TrackRow.t_ms)
        .limit(limit)
    )
    return (await database.scalars(query)).all()


async def proofs(database: AsyncSession, row: FlightRow) -> Sequence[str]:
    """The proofs that were decided meanwhile."""
    query = (
        select(VerdictRow.session_id)
        .where(VerdictRow.uav_id == row.uav_id, VerdictRow.decided_ms.between(row.start_ms, row.end_ms))
        .order_by(VerdictRow.block, VerdictRow.tx_index)
    )
    return (await database.scalars(query)).all()
