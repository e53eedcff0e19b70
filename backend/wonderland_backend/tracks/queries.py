"""Reading tracks from the database, and forgetting old ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import Row, delete, select, tuple_
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.db import partitions
from wonderland_backend.db.tables.reported import (
    BroadcastOperatorRow,
    EstimateRow,
    FindingRow,
    IrregularRow,
    LatestTrackRow,
    PadConnectionRow,
    PadHealthRow,
    TrackMinuteRow,
    TrackRow,
)
from wonderland_backend.person import ALL, Scope
from wonderland_backend.settings import Settings

MAX_AHEAD_MS: Final = 60_000
"""Telemetry dated further ahead would stand before everybody else's: its clock is wrong, and it is refused."""


async def latest(
    database: AsyncSession, scope: Scope, *, since_ms: int | None = None, after: str | None = None, limit: int
) -> Sequence[LatestTrackRow]:
    """The last position of each drone, by serial number."""
    query = select(LatestTrackRow).order_by(LatestTrackRow.uav_id).limit(limit)
    query = scope.narrow(query, pad=LatestTrackRow.pad_id, drone=LatestTrackRow.uav_id)
    if since_ms is not None:
        query = query.where(LatestTrackRow.t_ms >= since_ms)
    if after is not None:
        query = query.where(LatestTrackRow.uav_id > after)
    return (await database.scalars(query)).all()


async def history(
    database: AsyncSession,
    scope: Scope,
    uav_id: str,
    *,
    since_ms: int | None = None,
    until_ms: int | None = None,
    after: tuple[int, int] | None = None,
    limit: int,
) -> Sequence[Row[int, int, str]]:
    """(t_ms, id, body) of a drone's positions, oldest first. `after` is (t_ms, id) of the page before."""
    query = (
        select(TrackRow.t_ms, TrackRow.id, TrackRow.body)
        .where(TrackRow.uav_id == uav_id)
        .order_by(TrackRow.t_ms, TrackRow.id)
        .limit(limit)
    )
    query = scope.narrow(query, pad=TrackRow.pad_id, drone=TrackRow.uav_id)
    begin_ms = max(since_ms or 0, after[0] if after is not None else 0)
    if begin_ms:
        # No pad may be further ahead; so partitions that were over before need not be looked at.
        query = query.where(TrackRow.t_ms >= begin_ms, TrackRow.received_ms >= begin_ms - MAX_AHEAD_MS)
    if until_ms is not None:
        query = query.where(TrackRow.t_ms <= until_ms)
    if after is not None:
        query = query.where(tuple_(TrackRow.t_ms, TrackRow.id) > after)
    return (await database.execute(query)).all()


async def findings(
    database: AsyncSession,
    scope: Scope = ALL,
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
    query = scope.narrow(query, pad=FindingRow.pad_id, drone=FindingRow.uav_id)
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


@dataclass(frozen=True)
class Retention:
    """From when on what is kept, by this server's clock (ms)."""

    tracks_ms: int
    estimates_ms: int
    health_ms: int
    findings_ms: int


def kept(settings: Settings, now_ms: int) -> Retention:
    """What is kept by these settings."""
    hours = (
        settings.track_retention_h,
        settings.estimate_retention_h,
        settings.health_retention_h,
        settings.finding_retention_h,
    )
    return Retention(*(now_ms - int(each * 3_600_000) for each in hours))


async def forget(connection: AsyncConnection, before: Retention) -> None:
    """Delete unverified positions, estimates, health reports and findings that are older than they are kept."""
    await partitions.forget(connection, TrackRow, before.tracks_ms)
    await partitions.forget(connection, EstimateRow, before.estimates_ms)
    await partitions.forget(connection, PadHealthRow, before.health_ms)
    for column, before_ms in (
        (LatestTrackRow.t_ms, before.tracks_ms),
        (BroadcastOperatorRow.t_ms, before.tracks_ms),
        (TrackMinuteRow.minute_ms, before.tracks_ms),
        (PadConnectionRow.until_ms, before.health_ms),
        (FindingRow.t_ms, before.findings_ms),
        (IrregularRow.received_ms, before.findings_ms),
    ):
        await connection.execute(delete(column.class_).where(column < before_ms))
