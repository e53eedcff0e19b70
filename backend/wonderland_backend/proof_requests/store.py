"""Requests for a proof in the database, and their state as it follows from the ledger."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import insert, select, tuple_, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.db.tables.ledger import SessionRow, VerdictRow
from wonderland_backend.db.tables.proof_requests import ProofRequestRow
from wonderland_backend.person import Scope
from wonderland_backend.proof_requests.schemas import ProofRequestQuery

Row = dict[str, Any]


async def add(connection: AsyncConnection, row: Row) -> None:
    """Insert a request, not told to the drone yet."""
    await connection.execute(insert(ProofRequestRow), [row])


async def change(connection: AsyncConnection, request_id: str, uav_id: str, **values: Any) -> bool:
    """Note what has happened to a request of this drone; False where there is none."""
    done = await connection.execute(
        update(ProofRequestRow)
        .where(ProofRequestRow.request_id == request_id, ProofRequestRow.uav_id == uav_id)
        .values(**values)
    )
    return bool(done.rowcount)


async def find_request(database: AsyncSession, request_id: str, scope: Scope) -> ProofRequestRow | None:
    """One request, if its drone or pad is within the scope."""
    query = select(ProofRequestRow).where(ProofRequestRow.request_id == request_id)
    query = scope.narrow(query, pad=ProofRequestRow.pad_id, drone=ProofRequestRow.uav_id)
    return (await database.scalars(query)).first()


async def listing(
    database: AsyncSession, filters: ProofRequestQuery, scope: Scope, *, before: tuple[int, str] | None
) -> Sequence[ProofRequestRow]:
    """Requests, newest first, one more than `filters.limit`."""
    query = select(ProofRequestRow).limit(filters.limit + 1)
    query = query.order_by(ProofRequestRow.created_ms.desc(), ProofRequestRow.request_id.desc())
    query = scope.narrow(query, pad=ProofRequestRow.pad_id, drone=ProofRequestRow.uav_id)
    if before is not None:
        query = query.where(tuple_(ProofRequestRow.created_ms, ProofRequestRow.request_id) < before)
    if filters.drone is not None:
        query = query.where(ProofRequestRow.uav_id == filters.drone)
    if filters.pad is not None:
        query = query.where(ProofRequestRow.pad_id == filters.pad)
    return (await database.scalars(query)).all()


async def unanswered(database: AsyncSession, uav_id: str, now_ms: int) -> list[ProofRequestRow]:
    """What this drone's agent has not answered yet, oldest first."""
    query = (
        select(ProofRequestRow)
        .where(
            ProofRequestRow.uav_id == uav_id,
            ProofRequestRow.expires_ms > now_ms,
            ProofRequestRow.accepted.is_(None),
            ProofRequestRow.cancelled_ms.is_(None),
        )
        .order_by(ProofRequestRow.created_ms)
    )
    return list((await database.scalars(query)).all())


async def request_json(database: AsyncSession, row: ProofRequestRow, now_ms: int) -> Row:
    """The request as the interface shows it: the first session that fits to it says how far it is."""
    content: Row = {
        name: getattr(row, name)
        for name in (
            "request_id", "uav_id", "pad_id", "action", "requested_by", "note", "created_ms", "expires_ms", "told_ms",
            "accepted", "answer", "cancelled_ms",
        )
        if getattr(row, name) is not None
    }  # fmt: skip
    until = row.expires_ms if row.cancelled_ms is None else min(row.expires_ms, row.cancelled_ms)
    found = (
        await database.execute(
            select(SessionRow.session_id, SessionRow.state, VerdictRow.outcome)
            .outerjoin(VerdictRow, VerdictRow.session_id == SessionRow.session_id)
            .where(
                SessionRow.uav_id == row.uav_id,
                SessionRow.pad_id == row.pad_id,
                SessionRow.action == row.action,
                SessionRow.requested_ms.between(row.created_ms, until),
            )
            .order_by(SessionRow.requested_ms)
            .limit(1)
        )
    ).first()
    if found is not None:
        content["session_id"] = found.session_id
        if found.outcome is not None:
            content["outcome"] = found.outcome
    return content | {"state": _state(row, found, now_ms)}


def _state(row: ProofRequestRow, found: Any, now_ms: int) -> str:
    if found is not None:
        if found.outcome is not None:
            return "decided"
        return "asked" if found.state == "requested" else "ended"
    if row.cancelled_ms is not None:
        return "cancelled"
    if row.accepted is False:
        return "declined"
    return "pending" if now_ms < row.expires_ms else "expired"
