"""Starting over from block 0, and a digest that proves two databases equal."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import orjson
from sqlalchemy import String, Text, collate, select
from sqlalchemy.ext.asyncio import AsyncConnection

from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.base import LedgerRow
from wonderland_backend.db.tables.ledger import ledger_tables
from wonderland_backend.mirror import store
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.subscriber import AfterCommit


@dataclass(frozen=True)
class TableDigest:
    """How many rows a table has, and SHA-256 (hex) over them in the order of their keys."""

    rows: int
    sha256: str


@dataclass(frozen=True)
class Digest:
    """Of all tables that are derived from the ledger, and of each.

    Equal content gives equal digests, on SQLite and PostgreSQL alike.
    """

    sha256: str
    tables: dict[str, TableDigest]

    def to_json(self) -> dict[str, Any]:
        """For machines."""
        tables = {name: {"rows": each.rows, "sha256": each.sha256} for name, each in self.tables.items()}
        return {"sha256": self.sha256, "tables": tables}


async def digest(database: Database) -> Digest:
    """The digest of one snapshot of the database."""
    tables: dict[str, TableDigest] = {}
    async with database.read() as session:
        connection = await session.connection()
        for model in ledger_tables():
            tables[model.__tablename__] = await _table_digest(connection, model)
    whole = hashlib.sha256()
    for name, each in sorted(tables.items()):
        whole.update(orjson.dumps([name, each.rows, each.sha256]))
    return Digest(whole.hexdigest(), tables)


async def rebuild(
    database: Database,
    source: BlockSource,
    *,
    channel: str,
    chaincode: str,
    batch_transactions: int,
    on_progress: Callable[[int, int], None] = lambda _done, _of: None,
) -> None:
    """Drop what was derived from the ledger and read all of its blocks anew.

    Interrupted, it leaves a sound beginning of the chain, which a mirror continues. Raises `MirrorHalted`,
    `LedgerError` when the ledger cannot be reached at the start (then nothing was dropped).
    """
    height = await source.height()
    await store.clear(database)
    status = MirrorStatus()
    mirror = Mirror(
        database,
        source,
        channel=channel,
        chaincode=chaincode,
        status=status,
        clock=lambda: 0,
        subscribers=[AfterCommit(lambda _changes: on_progress(status.mirrored, height))],
        batch_transactions=batch_transactions,
    )
    await mirror.run_until(height)


async def _table_digest(connection: AsyncConnection, model: type[LedgerRow]) -> TableDigest:
    table = model.__table__
    columns = sorted(table.columns, key=lambda column: column.name)
    order = []
    for column in table.primary_key:
        # By bytes, whatever language the database sorts in.
        by_bytes = connection.dialect.name == "postgresql" and isinstance(column.type, String | Text)
        order.append(collate(column, "C") if by_bytes else column)
    found = hashlib.sha256()
    rows = 0
    result = await connection.stream(select(*columns).order_by(*order))
    async for partition in result.partitions(1_000):
        for row in partition:
            found.update(orjson.dumps(list(row)))
            found.update(b"\n")
            rows += 1
    return TableDigest(rows, found.hexdigest())
