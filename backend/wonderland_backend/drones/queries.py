"""Reading drones from the database."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import orjson
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.areas import Box
from wonderland_backend.db.tables.ledger import AuthorisationRow, DroneRow, VerdictRow
from wonderland_backend.db.tables.reported import BroadcastOperatorRow, LatestTrackRow
from wonderland_backend.filters import DroneQuery
from wonderland_backend.masking import shown_uav
from wonderland_backend.narrowing import drones_of, drones_within
from wonderland_backend.numbers.store import Number, numbers_of
from wonderland_backend.person import Person, Scope
from wonderland_backend.responses import record
from wonderland_backend.verdicts import queries as verdicts


def drone_json(
    row: DroneRow,
    person: Person,
    number: Number,
    authorisations: list[str],
    track: str | None,
    verdict: VerdictRow | None,
) -> Any:
    """The Drone of the interfaces, as this person sees it."""
    return record(
        shown_uav(row.record, person),
        registration=number.shown(person),
        authorisations=[record(text) for text in authorisations],
        track=orjson.Fragment(track) if track is not None else None,
        verdict=verdicts.verdict_json(verdict) if verdict is not None else None,
    )


async def listing(
    database: AsyncSession, scope: Scope, filters: DroneQuery, *, after: str | None = None
) -> Sequence[DroneRow]:
    """Drones by identifier, one more than `filters.limit`. Raises `BadRequest` for a box with too many."""
    query = select(DroneRow).order_by(DroneRow.uav_id).limit(filters.limit + 1)
    query = scope.narrow(query, drone=DroneRow.uav_id)
    if after is not None:
        query = query.where(DroneRow.uav_id > after)
    if filters.operator is not None:
        query = query.where(DroneRow.uav_id.in_(drones_of(filters.operator, scope)))
    if filters.bbox is not None:
        query = query.where(DroneRow.uav_id.in_(await drones_within(database, Box.parse(filters.bbox))))
    return (await database.scalars(query)).all()


async def find_drone(database: AsyncSession, scope: Scope, uav_id: str) -> DroneRow | None:
    """The drone's row; None for one that the ledger does not know, or that is not theirs to see."""
    query = scope.narrow(select(DroneRow).where(DroneRow.uav_id == uav_id), drone=DroneRow.uav_id)
    return (await database.scalars(query)).first()


async def details(database: AsyncSession, person: Person, rows: Sequence[DroneRow]) -> list[Any]:
    """The Drones of these rows, as this person sees them."""
    names = [row.uav_id for row in rows]
    allowed: dict[str, list[str]] = {}
    query = (
        select(AuthorisationRow.uav_id, AuthorisationRow.record)
        .where(AuthorisationRow.uav_id.in_(names))
        .order_by(AuthorisationRow.uav_id, AuthorisationRow.authorisation_id)
    )
    for uav_id, text in await database.execute(query):
        allowed.setdefault(uav_id, []).append(text)
    positions = select(LatestTrackRow.uav_id, LatestTrackRow.body).where(LatestTrackRow.uav_id.in_(names))
    tracks = {row.uav_id: row.body for row in await database.execute(positions)}
    last = await verdicts.latest_of(database, names)
    numbers = await numbers_of(database, [row.record for row in rows])
    return [
        drone_json(
            row,
            person,
            numbers[row.uav_id],
            allowed.get(row.uav_id, []),
            tracks.get(row.uav_id),
            last.get(row.uav_id),
        )
        for row in rows
    ]


async def operator_of(connection: AsyncConnection, uav_id: str, field: str) -> str | None:
    """A drone's operator in full: this field of its record, or what it broadcasts."""
    if field == "broadcast_operator_id":
        query = select(BroadcastOperatorRow.operator_id).where(BroadcastOperatorRow.uav_id == uav_id)
        return (await connection.execute(query)).scalar_one_or_none()
    record = (await connection.execute(select(DroneRow.record).where(DroneRow.uav_id == uav_id))).scalar_one_or_none()
    return None if record is None else orjson.loads(record).get(field)


async def records_of(session: AsyncSession, drones: Collection[str]) -> list[tuple[str, str]]:
    """Those of these drones that the ledger knows, and their records (JSON)."""
    rows = await session.execute(select(DroneRow.uav_id, DroneRow.record).where(DroneRow.uav_id.in_(drones)))
    return [(row[0], row[1]) for row in rows]
