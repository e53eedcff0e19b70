"""Reading the audit log."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.audit.schemas import AuditQuery
from wonderland_backend.db.tables.audit import AuditRow


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
