"""Exports as they are kept: wished for, running, done."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import delete, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.tables.exports import ExportRow


async def add(connection: AsyncConnection, row: dict[str, Any], *, forget_before_ms: int) -> None:
    """A new one; those of long ago go."""
    await connection.execute(delete(ExportRow).where(ExportRow.created_ms < forget_before_ms))
    await connection.execute(insert(ExportRow), [row])


async def people_of_running(connection: AsyncConnection, since_ms: int) -> Sequence[str]:
    """Whose exports run that were heard of since then, one for each export."""
    query = select(ExportRow.person_id).where(ExportRow.state == "running", ExportRow.changed_ms > since_ms)
    return (await connection.execute(query)).scalars().all()


async def claim(connection: AsyncConnection, export_id: str, now_ms: int) -> bool:
    """Begin it; False where that was done before."""
    claimed = await connection.execute(
        update(ExportRow)
        .where(ExportRow.export_id == export_id, ExportRow.state == "prepared")
        .values(state="running", changed_ms=now_ms)
    )
    return claimed.rowcount == 1


async def change(connection: AsyncConnection, export_id: str, values: dict[str, Any]) -> None:
    """How far it came."""
    await connection.execute(update(ExportRow).where(ExportRow.export_id == export_id).values(**values))
