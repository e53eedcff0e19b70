"""Writing derived rows and the checkpoint in one database transaction."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncSession

from wonderland_backend.db import bulk
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.base import LedgerRow
from wonderland_backend.db.tables.ledger import (
    BlockRow,
    Checkpoint,
    EndorsementPolicyRow,
    OrganisationRow,
    ledger_tables,
)
from wonderland_backend.errors import MirrorHalted
from wonderland_backend.mirror.derive import Changes
from wonderland_backend.mirror.rows import BlockWrite, Row, SessionWrite
from wonderland_backend.mirror.subscriber import Subscriber
from wonderland_fabric_gateway.blocks import BlockHeader

_KEPT: Final[dict[type[Row], tuple[str, ...]]] = {SessionWrite: ("verdict_tx", "complete_tx")}
"""Columns that a later write without a value leaves as they are."""


@dataclass(frozen=True, slots=True)
class Position:
    """The checkpoint: the last block whose rows are in the database."""

    channel: str
    header: BlockHeader


async def position(database: Database) -> Position | None:
    """The checkpoint of the database; None before block 0."""
    async with database.read() as session:
        return await position_in(session)


async def position_in(session: AsyncSession) -> Position | None:
    """The same in a snapshot that is open already."""
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


async def endorsement_policies(database: Database) -> tuple[int | None, dict[bytes, bytes]]:
    """The last block whose rows are here, and which policies hold after it."""
    async with database.read() as session:
        number = await session.scalar(select(Checkpoint.block))
        rows = await session.execute(select(EndorsementPolicyRow.key_sha256, EndorsementPolicyRow.policy))
        return number, {bytes.fromhex(key): b64decode(policy) for key, policy in rows}


async def save(
    database: Database,
    channel: str,
    before: Position | None,
    changes: Changes,
    subscribers: Sequence[Subscriber[Any]] = (),
) -> list[tuple[Subscriber[Any], Any]]:
    """Write everything, or nothing; what each subscriber found, to be handed back to it.

    Raises `MirrorHalted` when the checkpoint is no longer the one in `before`.
    """
    async with database.write() as connection:
        await _move_checkpoint(connection, channel, before, changes.last)
        for rows in changes.grown:
            await _append(connection, rows)
        if changes.organisations is not None:
            await connection.execute(delete(OrganisationRow))
            await _append(connection, changes.organisations)
        for kind, keys in changes.deletes.items():
            await _delete(connection, kind.table, keys)
        for kind, written in changes.upserts.items():
            await bulk.upsert(connection, kind.table, _plain(written.values()), fill=_KEPT.get(kind, ()))
        return [(each, await each.in_transaction(connection, changes)) for each in subscribers]


async def create_tables(database: Database) -> None:
    """The tables that are derived from the ledger, in a database that is used for a while only."""
    tables = [bulk.table_of(each) for each in ledger_tables()]
    async with database.write() as connection:
        await connection.run_sync(lambda sync: LedgerRow.metadata.create_all(sync, tables=tables))


async def clear(database: Database) -> None:
    """Drop every row that was derived from the ledger, the checkpoint first; what agents reported stays."""
    async with database.write() as connection:
        tables: list[type[LedgerRow]] = [Checkpoint]
        tables += [each for each in ledger_tables() if each is not Checkpoint]
        for table in tables:
            await connection.execute(delete(table))


async def _move_checkpoint(
    connection: AsyncConnection, channel: str, before: Position | None, last: BlockWrite
) -> None:
    values = {
        "block": last.number,
        "header_hash": last.header_hash,
        "data_hash": last.data_hash,
        "previous_hash": last.previous_hash,
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


async def _append(connection: AsyncConnection, rows: Sequence[Row]) -> None:
    if rows:
        await bulk.append(connection, rows[0].table, _plain(rows))


def _plain(rows: Iterable[Row]) -> list[bulk.Row]:
    return [msgspec.structs.asdict(row) for row in rows]


async def _delete(connection: AsyncConnection, model: type[LedgerRow], keys: set[tuple[str, ...]]) -> None:
    columns = list(bulk.table_of(model).primary_key)
    for key in sorted(keys):
        await connection.execute(
            delete(model).where(*(column == value for column, value in zip(columns, key, strict=True)))
        )
