"""Reading zones and their data sets from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from sqlalchemy import Select, select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.areas import Box
from wonderland_backend.db.tables.ledger import ClosuresRow, PadRow
from wonderland_backend.db.tables.zones import ZoneRow, ZoneSetRow
from wonderland_backend.zones.applicability import spans
from wonderland_backend.zones.schemas import ImportsQuery, ZoneQuery
from wonderland_backend.zones.shown import Row
from wonderland_backend.zones.store import holding, validity, within
from wonderland_backend.zones.zone import zone_of

_LOOKED_AT: Final = 200
"""Zones read at a time where a filter by time sorts some of them out."""


async def listing(database: AsyncSession, filters: ZoneQuery, *, after: str | None) -> list[Row]:
    """The zones of all data sets that hold, by identifier, one more than `filters.limit`."""
    query = holding(filters.at_ms)
    if filters.bbox is not None:
        query = within(query, Box.parse(filters.bbox))
    for column, value in (
        (ZoneRow.type, filters.type),
        (ZoneRow.country, filters.country),
        (ZoneSetRow.source, filters.source),
    ):
        if value is not None:
            query = query.where(column == value)
    found: list[Row] = []
    timed = filters.since_ms is not None
    many = max(_LOOKED_AT, filters.limit + 1) if timed else filters.limit + 1
    while len(found) <= filters.limit:
        part = query if after is None else query.where(ZoneRow.zone_id > after)
        rows = [(row[0], row[1]) for row in await database.execute(part.limit(many))]
        found += [row for row in rows if not timed or _holds(row, filters)]
        if len(rows) < many:
            break
        after = rows[-1][0].zone_id
    return found[: filters.limit + 1]


def _holds(row: Row, filters: ZoneQuery) -> bool:
    assert filters.since_ms is not None
    assert filters.until_ms is not None
    until = max(filters.until_ms, filters.since_ms + 1)
    return bool(spans(zone_of(row[0].feature), filters.since_ms, until, validity(row[1].about)))


async def find_zone(database: AsyncSession, zone_id: str) -> Row | None:
    """One zone that is in force."""
    row = (await database.execute(holding().where(ZoneRow.zone_id == zone_id))).first()
    return None if row is None else (row[0], row[1])


async def in_force(database: AsyncSession, *, box: Box | None = None, source: str | None = None) -> list[Row]:
    """The zones that hold, by identifier: all, or those whose box meets this one, or of one source."""
    query = holding() if box is None else within(holding(), box)
    if source is not None:
        query = query.where(ZoneSetRow.source == source)
    return [(row[0], row[1]) for row in await database.execute(query)]


async def imports(
    database: AsyncSession, filters: ImportsQuery, *, before: tuple[int, str] | None
) -> Sequence[ZoneSetRow]:
    """Every import, newest first, one more than `filters.limit`."""
    query = (
        select(ZoneSetRow).order_by(ZoneSetRow.imported_ms.desc(), ZoneSetRow.import_id.desc()).limit(filters.limit + 1)
    )
    if filters.source is not None:
        query = query.where(ZoneSetRow.source == filters.source)
    if filters.current is not None:
        column = ZoneSetRow.current
        query = query.where(column.is_not(None) if filters.current else column.is_(None))
    if before is not None:
        query = query.where(tuple_(ZoneSetRow.imported_ms, ZoneSetRow.import_id) < before)
    return (await database.scalars(query)).all()


async def imports_that_hold(session: AsyncSession) -> list[tuple[str, int]]:
    """The current import of each data set, and when it came (Unix, ms)."""
    query = select(ZoneSetRow.import_id, ZoneSetRow.imported_ms).where(ZoneSetRow.current.is_not(None))
    return [(row[0], row[1]) for row in await session.execute(query.order_by(ZoneSetRow.import_id))]


async def pads_with_closures(session: AsyncSession) -> list[tuple[PadRow, ClosuresRow | None]]:
    """Pads in service, each with what is published of its closures."""
    query = (
        select(PadRow, ClosuresRow)
        .outerjoin(ClosuresRow, ClosuresRow.pad_id == PadRow.pad_id)
        .where(PadRow.status != "retired")
    )
    return [(row[0], row[1]) for row in await session.execute(query)]


def in_service(after: str | None, limit: int) -> Select[PadRow, ClosuresRow]:
    """Pads that are not retired, with the closures that the ledger has of them, by name."""
    query = (
        select(PadRow, ClosuresRow)
        .outerjoin(ClosuresRow, ClosuresRow.pad_id == PadRow.pad_id)
        .where(PadRow.status != "retired")
        .order_by(PadRow.pad_id)
        .limit(limit)
    )
    return query if after is None else query.where(PadRow.pad_id > after)
