"""Reading drones from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import orjson
from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from backend.db.models import AuthorisationRow, DroneRow, LatestTrackRow, VerdictRow
from backend.responses import record
from backend.verdicts import queries as verdicts


def shown(row: DroneRow, authorisations: list[str], track: str | None, verdict: VerdictRow | None) -> Any:
    """The Drone of the interfaces."""
    return record(
        row.record,
        authorisations=[record(text) for text in authorisations],
        track=orjson.Fragment(track) if track is not None else None,
        verdict=verdicts.shown(verdict) if verdict is not None else None,
    )


async def listing(database: AsyncSession, *, after: str | None = None, limit: int) -> Sequence[DroneRow]:
    """Drones by identifier."""
    query = select(DroneRow).order_by(DroneRow.uav_id).limit(limit)
    if after is not None:
        query = query.where(DroneRow.uav_id > after)
    return (await database.scalars(query)).all()


async def find(database: AsyncSession, uav_id: str) -> DroneRow | None:
    """One drone."""
    return await database.get(DroneRow, uav_id)


async def details(database: AsyncSession, rows: Sequence[DroneRow]) -> list[Any]:
    """The Drones of these rows."""
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
    return [shown(row, allowed.get(row.uav_id, []), tracks.get(row.uav_id), last.get(row.uav_id)) for row in rows]
