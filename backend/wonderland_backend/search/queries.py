"""Looking for names and ids. Names are found by any part, ids of hashes by their beginning."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any, Final

import orjson
from sqlalchemy import ColumnElement, func, or_, select
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import BlockRow, DroneRow, PadRow, SessionRow, TransactionRow
from wonderland_backend.db.tables.reported import LatestTrackRow
from wonderland_backend.ledger.queries import own_transactions
from wonderland_backend.masking import shown_uav
from wonderland_backend.numbers.store import drones_with, numbers_of
from wonderland_backend.person import AUTHORITY, Person

HASH_FROM: Final = 6
"""Fewer digits of a hash fit too much."""
_HEX: Final = frozenset("0123456789abcdef")

Row = dict[str, Any]
REVEALED: Final = "revealed"
"""In a hit that was found by a number which its finder sees in part: to be audited, not to be told."""


async def search(database: AsyncSession, person: Person, text: str, limit: int) -> list[Row]:
    """At most `limit` hits: pads, drones, what is only heard, then sessions, transactions and blocks."""
    wanted = text.strip()
    found: list[Row] = []
    for source in (_pads, _drones, _broadcasts, _hashes, _blocks):
        if len(found) >= limit or not wanted:
            break
        found += [hit async for hit in source(database, person, wanted, limit - len(found))]
    return found[:limit]


def _contains(column: Any, text: str) -> ColumnElement[bool]:
    """Any part, whatever the case. `autoescape`: a % that somebody types is a %."""
    return func.lower(column).contains(text.lower(), autoescape=True)


async def _pads(database: AsyncSession, person: Person, text: str, limit: int) -> AsyncIterator[Row]:
    # Names are within the record: the text as it stands in JSON, so that ä and quotes are found, too.
    inside = orjson.dumps(text).decode()[1:-1]
    query = select(PadRow).where(or_(_contains(PadRow.pad_id, text), _contains(PadRow.record, inside)))
    query = person.scope.narrow(query, pad=PadRow.pad_id)
    for row in await database.scalars(query.order_by(PadRow.pad_id).limit(5 * limit)):
        record = orjson.loads(row.record)
        values = (row.pad_id, record.get("name", ""), record.get("operator_id", ""))
        if any(text.lower() in value.lower() for value in values):
            yield {"kind": "pad", "id": row.pad_id, "name": values[1] or row.pad_id, "detail": values[2]}


async def _drones(database: AsyncSession, person: Person, text: str, limit: int) -> AsyncIterator[Row]:
    # Officers find a drone by the whole number that they were told: by a part of it they could guess the rest.
    told = frozenset(await drones_with(database, text)) if person.has(*AUTHORITY, "fleet_operator") else frozenset()
    inside = orjson.dumps(text).decode()[1:-1]
    query = select(DroneRow).where(
        or_(_contains(DroneRow.uav_id, text), _contains(DroneRow.record, inside), DroneRow.uav_id.in_(told))
    )
    query = person.scope.narrow(query, drone=DroneRow.uav_id)
    rows = (await database.scalars(query.order_by(DroneRow.uav_id).limit(5 * limit))).all()
    numbers = await numbers_of(database, [row.record for row in rows])
    for row in rows:
        record = orjson.loads(shown_uav(row.record, person))
        number = numbers[row.uav_id].shown(person).get("number", "")
        values = (row.uav_id, number, record.get("operator_id", ""), record.get("model", ""))
        shown = any(text.lower() in value.lower() for value in values)
        if shown or (row.uav_id in told and person.has(*AUTHORITY)):
            detail = " · ".join(value for value in values[1:3] if value)
            hit = {"kind": "drone", "id": row.uav_id, "name": row.uav_id, "detail": detail}
            yield hit if shown else hit | {REVEALED: True}


async def _broadcasts(database: AsyncSession, person: Person, text: str, limit: int) -> AsyncIterator[Row]:
    """Serial numbers that were heard on the air and are no drone's in the registry, the last heard first."""
    registered = person.scope.narrow(select(DroneRow.uav_id), drone=DroneRow.uav_id)
    query = select(LatestTrackRow).where(
        _contains(LatestTrackRow.uav_id, text), LatestTrackRow.uav_id.not_in(registered)
    )
    query = person.scope.narrow(query, pad=LatestTrackRow.pad_id, drone=LatestTrackRow.uav_id)
    for row in await database.scalars(query.order_by(LatestTrackRow.t_ms.desc()).limit(limit)):
        yield {
            "kind": "broadcast",
            "id": row.uav_id,
            "name": row.uav_id,
            "detail": row.pad_id,
            "heard_ms": row.t_ms,
        }


async def _hashes(database: AsyncSession, person: Person, text: str, limit: int) -> AsyncIterator[Row]:
    digits = text.lower()
    if len(digits) < HASH_FROM or not set(digits) <= _HEX:
        return
    sessions = select(SessionRow).where(SessionRow.session_id.startswith(digits)).limit(limit)
    known = set()
    sessions = person.scope.narrow(sessions, pad=SessionRow.pad_id, drone=SessionRow.uav_id)
    for row in await database.scalars(sessions):
        known.add(row.session_id)
        yield {"kind": "session", "id": row.session_id, "name": row.uav_id, "detail": row.pad_id}
    transactions = select(TransactionRow).where(TransactionRow.tx_id.startswith(digits)).limit(limit)
    for transaction in await database.scalars(own_transactions(transactions, person)):
        yield {
            "kind": "transaction",
            "id": transaction.tx_id,
            "name": transaction.function or transaction.type,
            "detail": transaction.creator_name,
        }


async def _blocks(database: AsyncSession, _: Person, text: str, limit: int) -> AsyncIterator[Row]:
    if limit < 1 or not text.isascii() or not text.isdecimal() or len(text) > 15:
        return
    row = await database.get(BlockRow, int(text))
    if row is not None:
        yield {"kind": "block", "id": text.lstrip("0") or "0", "name": text.lstrip("0") or "0"}
