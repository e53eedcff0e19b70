"""Reading blocks and transactions from the database."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import select, tuple_
from sqlalchemy.ext.asyncio import AsyncSession

from wonderland_backend.db.tables.ledger import BlockRow, EventRow, TransactionRow
from wonderland_backend.person import AUTHORITY, Person
from wonderland_fabric_gateway.transactions import code_name

_BLOCK_FIELDS = (
    "number",
    "header_hash",
    "previous_hash",
    "data_hash",
    "t_ms",
    "transactions",
    "valid",
    "size_bytes",
)


def shown_block(row: BlockRow) -> dict[str, Any]:
    """The LedgerBlock of a row."""
    return {name: getattr(row, name) for name in _BLOCK_FIELDS}


def shown_transaction(row: TransactionRow, event: EventRow | None) -> dict[str, Any]:
    """The LedgerTransaction of a row."""
    shown: dict[str, Any] = {
        "tx_id": row.tx_id,
        "block": row.block,
        "tx_index": row.tx_index,
        "type": row.type,
        "valid": row.validation_code == 0,
        "validation": code_name(row.validation_code),
        "t_ms": row.t_ms,
        "endorsers": row.endorsers.split(",") if row.endorsers else [],
    }
    if row.chaincode:
        shown |= {"chaincode": row.chaincode, "function": row.function}
    if row.creator_msp:
        shown["creator"] = {
            "msp_id": row.creator_msp,
            "name": row.creator_name,
            "certificate_sha256": row.creator_certificate_sha256,
        }
    if event is not None:
        shown["event"] = event.name
    return shown


def own_transactions(query: Any, person: Person) -> Any:
    """The query of transactions, narrowed to those that this person may look at."""
    if person.scope.everything:
        return query
    return query.where(TransactionRow.creator_msp == person.msp_id, TransactionRow.creator_msp != "")


def sees_contents(row: TransactionRow, person: Person) -> bool:
    """Whether somebody may read a transaction's arguments and writes: an officer, or its own organisation."""
    own = person.has("pad_operator", "fleet_operator") and person.msp_id != "" and row.creator_msp == person.msp_id
    return own or person.has(*AUTHORITY)


async def with_events(database: AsyncSession, rows: Sequence[TransactionRow]) -> list[dict[str, Any]]:
    """Transactions with the names of their events."""
    if not rows:
        return []
    places = [(row.block, row.tx_index) for row in rows]
    query = select(EventRow).where(tuple_(EventRow.block, EventRow.tx_index).in_(places))
    events = {(event.block, event.tx_index): event for event in await database.scalars(query)}
    return [shown_transaction(row, events.get((row.block, row.tx_index))) for row in rows]


async def blocks(database: AsyncSession, *, before: int | None, limit: int) -> Sequence[BlockRow]:
    """Blocks below `before`, newest first, at most `limit`."""
    query = select(BlockRow).order_by(BlockRow.number.desc()).limit(limit)
    if before is not None:
        query = query.where(BlockRow.number < before)
    return (await database.scalars(query)).all()


async def block(database: AsyncSession, number: int) -> BlockRow | None:
    """The block of this number; None where it is not mirrored."""
    return await database.get(BlockRow, number)


async def transactions_of(database: AsyncSession, person: Person, number: int) -> list[dict[str, Any]]:
    """The transactions of a block, in order."""
    query = select(TransactionRow).where(TransactionRow.block == number).order_by(TransactionRow.tx_index)
    rows = (await database.scalars(own_transactions(query, person))).all()
    events = {
        event.tx_index: event for event in await database.scalars(select(EventRow).where(EventRow.block == number))
    }
    return [shown_transaction(row, events.get(row.tx_index)) for row in rows]


async def transaction(
    database: AsyncSession, tx_id: str, person: Person | None = None
) -> tuple[TransactionRow, EventRow | None] | None:
    """A transaction by its id: the valid one, where refused duplicates of it are on the chain, too.

    `person`: only if they may look at it.
    """
    query = (
        select(TransactionRow)
        .where(TransactionRow.tx_id == tx_id)
        .order_by(TransactionRow.validation_code != 0, TransactionRow.block, TransactionRow.tx_index)
        .limit(1)
    )
    if person is not None:
        query = own_transactions(query, person)
    row = (await database.scalars(query)).first()
    if row is None:
        return None
    return row, await database.get(EventRow, (row.block, row.tx_index))
