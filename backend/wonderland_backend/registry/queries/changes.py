"""Reading what somebody proposed and somebody else has to approve."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland.proofs.records.changes import OPEN
from wonderland_backend.db.tables.ledger import ChangeRow
from wonderland_backend.registry.schemas import ChangeQuery
from wonderland_backend.responses import record

EXPIRED = "expired"


async def proposals(
    database: AsyncSession, filters: ChangeQuery, place: tuple[Any, ...] | None, now_ms: int
) -> Sequence[ChangeRow]:
    """The last changed first; one more than asked for where there are more."""
    query = select(ChangeRow)
    if filters.state is not None:
        query = query.where(ChangeRow.state == (OPEN if filters.state == EXPIRED else filters.state))
    if filters.state == OPEN:
        query = query.where(ChangeRow.expires_ms > now_ms)
    if filters.state == EXPIRED:
        query = query.where(ChangeRow.expires_ms <= now_ms)
    order = (ChangeRow.block, ChangeRow.tx_index, ChangeRow.change_id)
    if place is not None:
        query = query.where(tuple_(*order) < place)
    return (await database.scalars(query.order_by(*(each.desc() for each in order)).limit(filters.limit + 1))).all()


def shown_proposal(row: ChangeRow, now_ms: int) -> dict[str, Any]:
    """The RegistryProposal of a row."""
    over = row.state == OPEN and row.expires_ms <= now_ms
    return {
        "record": record(row.record),
        "version": {"block": row.block, "tx_index": row.tx_index},
        "state": EXPIRED if over else row.state,
    }
