"""Writing derived rows and the checkpoint in one database transaction."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import MetaData, Table, delete, func, insert, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.ext.asyncio import AsyncConnection

from backend.db.engine import Database
from backend.db.models import BlockRow, Checkpoint, LedgerRow, SessionRow, ledger_tables
from backend.errors import MirrorHalted
from backend.mirror.derive import APPENDED, REPLACED, Changes, Row
from wonderland.ledger.blocks import BlockHeader

_KEPT: Final = {SessionRow.__tablename__: ("verdict_tx", "complete_tx")}
"""Columns that a later write without a value leaves as they are."""

MANY_ROWS: Final = 100
"""From so many rows on a detour by COPY pays."""


@dataclass(frozen=True, slots=True)
class Position:
    """The checkpoint: the last block whose rows are in the database."""

    channel: str
    header: BlockHeader


async def position(database: Database) -> Position | None:
    """The checkpoint of the database; None before block 0."""
    async with database.read() as session:
        rows = (await session.scalars(select(Checkpoint))).all()
    if not rows:
        return None
    row = rows[0]
    header = BlockHeader(row.block, bytes.fromhex(row.previous_hash), bytes.fromhex(row.data_hash))
    if len(rows) > 1 or header.hash.hex() != row.header_hash:
        raise MirrorHalted(
            "The checkpoint in the database contradicts itself; `wonderland backend rebuild` makes the rows anew."
        )
    return Position(row.channel, header)


async def header_hash(database: Database, number: int) -> str | None:
    """The hash (hex) of a mirrored block's header; None for one that is not mirrored."""
    async with database.read() as session:
        return await session.scalar(select(BlockRow.header_hash).where(BlockRow.number == number))


AlsoWrite = Callable[[AsyncConnection, Changes], Awaitable[None]]
"""What else belongs into the same database transaction: it sees the rows that were just written."""


async def save(
    database: Database, channel: str, before: Position | None, changes: Changes, also: AlsoWrite | None = None
) -> None:
    """Write everything, or nothing. Raises `MirrorHalted` when the checkpoint is no longer the one in `before`."""
    async with database.write() as connection:
        await _move_checkpoint(connection, channel, before, changes.last)
        for table, name in APPENDED:
            await _append(connection, table, getattr(changes, name))
        if changes.organisations is not None:
            await connection.execute(delete(REPLACED))
            await _append(connection, REPLACED, changes.organisations)
        for table, keys in changes.deletes.items():
            await _delete(connection, table, keys)
        for table, rows in changes.upserts.items():
            await _upsert(connection, table, list(rows.values()))
        if also is not None:
            await also(connection, changes)


async def clear(database: Database) -> None:
    """Drop every row that was derived from the ledger, the checkpoint first; what agents reported stays."""
    async with database.write() as connection:
        tables: list[type[LedgerRow]] = [Checkpoint]
        tables += [each for each in ledger_tables() if each is not Checkpoint]
        for table in tables:
            await connection.execute(delete(table))


async def _move_checkpoint(connection: AsyncConnection, channel: str, before: Position | None, last: Row) -> None:
    values = {
        "block": last["number"],
        "header_hash": last["header_hash"],
        "data_hash": last["data_hash"],
        "previous_hash": last["previous_hash"],
    }
    if before is None:
        if (await connection.execute(select(func.count()).select_from(Checkpoint))).scalar_one():
            raise _other_writer()
        await connection.execute(insert(Checkpoint), [{"channel": channel, **values}])
        return
    moved = await connection.execute(
        update(Checkpoint)
        .where(
            Checkpoint.channel == channel,
            Checkpoint.block == before.header.number,
            Checkpoint.header_hash == before.header.hash.hex(),
        )
        .values(**values)
    )
    if moved.rowcount != 1:
        raise _other_writer()


def _other_writer() -> MirrorHalted:
    return MirrorHalted(
        "Another mirror has written to this database, or it was rebuilt meanwhile; let only one backend mirror into "
        "a database, then start this one again."
    )


async def _append(connection: AsyncConnection, model: type[LedgerRow], rows: list[Row]) -> None:
    if not rows:
        return
    table = _table(model)
    if connection.dialect.name == "postgresql":
        await _copy(connection, table, table.name, rows)
    else:
        await connection.execute(insert(table), rows)


async def _upsert(connection: AsyncConnection, model: type[LedgerRow], rows: list[Row]) -> None:
    if not rows:
        return
    table = _table(model)
    if connection.dialect.name == "postgresql" and len(rows) >= MANY_ROWS:
        await _merge(connection, table, rows)
        return
    dialect: Any = postgresql if connection.dialect.name == "postgresql" else sqlite
    await connection.execute(_or_update(table, dialect.insert(table)), rows)


async def _copy(connection: AsyncConnection, table: Table, into: str, rows: list[Row]) -> None:
    """COPY: several times as fast as INSERT for many rows."""
    names = [column.name for column in table.columns]
    raw = await connection.get_raw_connection()
    driver = raw.driver_connection
    assert driver is not None
    columns = ", ".join(f'"{name}"' for name in names)
    async with driver.cursor() as cursor, cursor.copy(f'COPY "{into}" ({columns}) FROM STDIN') as copy:
        for row in rows:
            await copy.write_row([row[name] for name in names])


async def _merge(connection: AsyncConnection, table: Table, rows: list[Row]) -> None:
    """COPY into a table aside, and from there all at once."""
    aside = table.to_metadata(MetaData(), name=f"new_{table.name}")
    await connection.exec_driver_sql(
        f'CREATE TEMPORARY TABLE IF NOT EXISTS "{aside.name}" (LIKE "{table.name}") ON COMMIT DELETE ROWS'
    )
    await _copy(connection, table, aside.name, rows)
    statement = postgresql.insert(table).from_select([column.name for column in table.columns], select(aside))
    await connection.execute(_or_update(table, statement))


def _or_update(table: Table, statement: Any) -> Any:
    """The INSERT, replacing what stands under the same key."""
    keys = [column.name for column in table.primary_key]
    kept = _KEPT.get(table.name, ())
    new = statement.excluded
    changed = {
        column.name: func.coalesce(new[column.name], column) if column.name in kept else new[column.name]
        for column in table.columns
        if column.name not in keys
    }
    return statement.on_conflict_do_update(index_elements=keys, set_=changed)


async def _delete(connection: AsyncConnection, model: type[LedgerRow], keys: set[tuple[str, ...]]) -> None:
    columns = list(_table(model).primary_key)
    for key in sorted(keys):
        await connection.execute(
            delete(model).where(*(column == value for column, value in zip(columns, key, strict=True)))
        )


def _table(model: type[LedgerRow]) -> Table:
    table = model.__table__
    assert isinstance(table, Table)
    return table
