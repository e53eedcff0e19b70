"""Reading the audit log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.audit.schemas import AuditQuery
from wonderland_backend.db.tables.audit import AuditRow, AuditStreamRow
from wonderland_backend.db.tables.reported import InstanceRow


async def listing(database: AsyncSession, filters: AuditQuery, *, before: int | None) -> Sequence[AuditRow]:
    """What was done and read, newest first, one more than `filters.limit`."""
    query = select(AuditRow).order_by(AuditRow.seq.desc()).limit(filters.limit + 1)
    if before is not None:
        query = query.where(AuditRow.seq < before)
    if filters.person is not None:
        query = query.where(AuditRow.person_id == filters.person)
    if filters.act is not None:
        query = query.where(AuditRow.act == filters.act)
    if filters.subject is not None:
        query = query.where(AuditRow.subject.startswith(filters.subject, autoescape=True))
    if filters.since_ms is not None:
        query = query.where(AuditRow.t_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(AuditRow.t_ms <= filters.until_ms)
    return (await database.scalars(query)).all()


async def head(session: AsyncSession) -> AuditRow | None:
    """The last row; None for an empty log."""
    return (await session.scalars(select(AuditRow).order_by(AuditRow.seq.desc()).limit(1))).first()


async def rows_after(session: AsyncSession, seq: int, limit: int) -> list[dict[str, Any]]:
    """Rows after this one in order, by their columns' names: as they were hashed."""
    rows = await session.execute(
        select(AuditRow.__table__).where(AuditRow.seq > seq).order_by(AuditRow.seq).limit(limit)
    )
    return [dict(row) for row in rows.mappings()]


async def instance(session: AsyncSession | AsyncConnection) -> str | None:
    """The installation's name; None before the server's first start."""
    return (await session.execute(select(InstanceRow.instance))).scalar_one_or_none()


async def bus_key(session: AsyncSession | AsyncConnection) -> str | None:
    """With which backends of this database seal what they say; None before one with a bus was on duty."""
    return (await session.execute(select(InstanceRow.bus_key))).scalar_one_or_none()


async def sent_to(session: AsyncSession, destination: str) -> int | None:
    """Up to which row the log was sent there; None where nothing ever was."""
    return (await session.scalars(select(AuditStreamRow.seq).where(AuditStreamRow.destination == destination))).first()
