"""Reading verdicts from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import SessionRow, VerdictRow
from wonderland_backend.filters import VerdictQuery
from wonderland_backend.narrowing import narrowed
from wonderland_backend.person import ALL, Scope
from wonderland_backend.responses import record


def verdict_json(row: VerdictRow) -> Any:
    """The VerdictSummary of a row."""
    return record(row.record, tx_id=row.tx_id, block=row.block, tx_index=row.tx_index)


async def find_verdict(database: AsyncSession, session_id: str) -> VerdictRow | None:
    """The verdict of a session."""
    return await database.get(VerdictRow, session_id)


async def listing(
    database: AsyncSession, filters: VerdictQuery, scope: Scope = ALL, *, position: tuple[int, int] | None = None
) -> Sequence[VerdictRow]:
    """Verdicts, newest first, one more than `filters.limit`; with `after_block` those of later blocks, oldest first.

    `position` (block, tx_index) is the last one of the page before. Raises `BadRequest` as `narrowed` does.
    """
    query = scope.narrow(select(VerdictRow).limit(filters.limit + 1), pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    place = tuple_(VerdictRow.block, VerdictRow.tx_index)
    if filters.after_block is None:
        query = query.order_by(VerdictRow.block.desc(), VerdictRow.tx_index.desc())
        if position is not None:
            query = query.where(place < position)
    else:
        query = query.order_by(VerdictRow.block, VerdictRow.tx_index).where(VerdictRow.block > filters.after_block)
        if position is not None:
            query = query.where(place > position)
    query = await narrowed(database, query, filters, scope, pad=VerdictRow.pad_id, drone=VerdictRow.uav_id)
    if filters.action is not None:
        query = query.where(VerdictRow.action == filters.action)
    if filters.outcome is not None:
        query = query.where(VerdictRow.outcome == filters.outcome)
    if filters.state is not None:
        sessions = SessionRow.session_id == VerdictRow.session_id
        query = query.join(SessionRow, sessions).where(SessionRow.state == filters.state)
    if filters.since_ms is not None:
        query = query.where(VerdictRow.decided_ms >= filters.since_ms)
    if filters.until_ms is not None:
        query = query.where(VerdictRow.decided_ms <= filters.until_ms)
    return (await database.scalars(query)).all()


async def latest_of(database: AsyncSession, uav_ids: Sequence[str]) -> dict[str, VerdictRow]:
    """The last verdict of each of these drones."""
    found: dict[str, VerdictRow] = {}
    for uav_id in uav_ids:
        rows = await listing(database, VerdictQuery(drone=uav_id, limit=1))
        if rows:
            found[uav_id] = rows[0]
    return found
