"""Reading tracks from the database, and forgetting old ones."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import delete, select, tuple_
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from backend.db.models import EstimateRow, FindingRow, IrregularRow, LatestTrackRow, TrackRow


async def latest(
    database: AsyncSession, *, since_ms: int | None = None, after: str | None = None, limit: int
) -> Sequence[LatestTrackRow]:
    """The last position of each drone, by serial number."""
    query = select(LatestTrackRow).order_by(LatestTrackRow.uav_id).limit(limit)
    if since_ms is not None:
        query = query.where(LatestTrackRow.t_ms >= since_ms)
    if after is not None:
        query = query.where(LatestTrackRow.uav_id > after)
    return (await database.scalars(query)).all()


async def history(
    database: AsyncSession,
    uav_id: str,
    *,
    since_ms: int | None = None,
    until_ms: int | None = None,
    after: tuple[int, int] | None = None,
    limit: int,
) -> Sequence[TrackRow]:
    """Positions of a drone, oldest first. `after` is (t_ms, id) of the page before."""
    query = select(TrackRow).where(TrackRow.uav_id == uav_id).order_by(TrackRow.t_ms, TrackRow.id).limit(limit)
    if since_ms is not None:
        query = query.where(TrackRow.t_ms >= since_ms)
    if until_ms is not None:
        query = query.where(TrackRow.t_ms <= until_ms)
    if after is not None:
        query = query.where(tuple_(TrackRow.t_ms, TrackRow.id) > after)
    return (await database.scalars(query)).all()


async def findings(
    database: AsyncSession,
    *,
    uav_id: str | None = None,
    pad_id: str | None = None,
    since_ms: int | None = None,
    until_ms: int | None = None,
    before: tuple[int, int] | None = None,
    limit: int,
) -> Sequence[FindingRow]:
    """What was odd about broadcasts, newest first. `before` is (t_ms, id) of the page before."""
    query = select(FindingRow).order_by(FindingRow.t_ms.desc(), FindingRow.id.desc()).limit(limit)
    if uav_id is not None:
        query = query.where(FindingRow.uav_id == uav_id)
    if pad_id is not None:
        query = query.where(FindingRow.pad_id == pad_id)
    if since_ms is not None:
        query = query.where(FindingRow.t_ms >= since_ms)
    if until_ms is not None:
        query = query.where(FindingRow.t_ms <= until_ms)
    if before is not None:
        query = query.where(tuple_(FindingRow.t_ms, FindingRow.id) < before)
    return (await database.scalars(query)).all()


async def forget(connection: AsyncConnection, before_ms: int) -> None:
    """Delete unverified positions, findings and estimates, and irregular records, older than this."""
    await connection.execute(delete(TrackRow).where(TrackRow.t_ms < before_ms))
    await connection.execute(delete(LatestTrackRow).where(LatestTrackRow.t_ms < before_ms))
    await connection.execute(delete(FindingRow).where(FindingRow.t_ms < before_ms))
    await connection.execute(delete(EstimateRow).where(EstimateRow.t_ms < before_ms))
    await connection.execute(delete(IrregularRow).where(IrregularRow.received_ms < before_ms))
