"""Starting over from block 0, and a digest that proves two databases equal."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import orjson

from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.ledger import ledger_tables
from wonderland_backend.mirror import store
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.queries import TableDigest, table_digest
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.subscriber import AfterCommit


@dataclass(frozen=True)
class Digest:
    """Of all tables that are derived from the ledger, and of each.

    Equal content gives equal digests, on SQLite and PostgreSQL alike.
    """

    sha256: str
    tables: dict[str, TableDigest]

    def to_json(self) -> dict[str, Any]:
        """JSON values, as `--json` prints them."""
        tables = {name: {"rows": each.rows, "sha256": each.sha256} for name, each in self.tables.items()}
        return {"sha256": self.sha256, "tables": tables}


async def digest(database: Database) -> Digest:
    """The digest of one snapshot of the database."""
    tables: dict[str, TableDigest] = {}
    async with database.read() as session:
        connection = await session.connection()
        for model in ledger_tables():
            tables[model.__tablename__] = await table_digest(connection, model)
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
