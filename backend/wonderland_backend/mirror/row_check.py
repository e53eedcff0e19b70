"""Whether the rows are still what the ledger says: derived anew beside them, again and again, and compared.

Somebody with the database's password can change a row; a hash beside it could be changed with it. So each pass reads
the ledger from block 0 into a database of its own, at an easy pace, and compares every table with one snapshot of the
real one. Nothing is stopped: what differs is named, and an alert is raised.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import tempfile
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Final

from sqlalchemy.exc import SQLAlchemyError

from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.ledger import ledger_tables
from wonderland_backend.db.tables.numbers import RegistrationNumberRow
from wonderland_backend.errors import BackendError
from wonderland_backend.mirror import store
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.queries import differing_rows, drone_records, table_digest
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.numbers.store import altered
from wonderland_fabric_gateway.blocks import Block
from wonderland_fabric_gateway.errors import LedgerError

_log = logging.getLogger(__name__)

PAUSE_S: Final = 60.0
"""Before each pass."""
MOST_NAMED: Final = 20
_NUMBERS: Final = RegistrationNumberRow.__tablename__
FEW_BLOCKS: Final = 100
"""So many may be missing when the snapshot is opened: they are derived while it is held, at full pace."""


class RowCheck:
    """Compares until cancelled; ``status`` shows when the last pass ended, and what differed in it."""

    def __init__(
        self,
        database: Database,
        source: BlockSource,
        *,
        channel: str,
        chaincode: str,
        status: MirrorStatus,
        clock: Callable[[], int],
        transactions_per_s: int,
    ) -> None:
        self._database = database
        self._source = source
        self._unhurried = Unhurried(source, transactions_per_s)
        self._channel = channel
        self._chaincode = chaincode
        self._status = status
        self._clock = clock

    async def run(self) -> None:
        """Pass after pass. What keeps one from its end is said, and the next one follows."""
        while True:
            await asyncio.sleep(PAUSE_S)
            try:
                await self.once()
            except (LedgerError, BackendError, SQLAlchemyError, OSError) as error:
                _log.warning("the rows could not be compared with the ledger: %s", error)

    async def once(self) -> None:
        """One pass. Raises `LedgerError`, `BackendError`."""
        mirrored = await store.position(self._database)
        if mirrored is None:
            return
        with tempfile.TemporaryDirectory(prefix="wonderland-rows-") as directory:
            beside = Database(f"sqlite:///{Path(directory) / 'rows.db'}")
            try:
                await store.create_tables(beside)
                height = 0
                while mirrored is not None and mirrored.header.number + 1 - height > FEW_BLOCKS:
                    height = mirrored.header.number + 1
                    await self._derive(beside, self._unhurried, height)
                    mirrored = await store.position(self._database)
                differing, height = await self._compare(beside)
            finally:
                await beside.close()
        for each in differing:
            _log.critical("a row is not what the ledger says: %s", each)
        self._status.rows_checked_ms, self._status.rows_checked_height = self._clock(), height
        self._status.rows_differ = tuple(differing)

    async def _derive(self, beside: Database, source: BlockSource, height: int) -> None:
        mirror = Mirror(
            beside,
            source,
            channel=self._channel,
            chaincode=self._chaincode,
            status=MirrorStatus(),
            clock=self._clock,
            batch_transactions=200,
        )
        await mirror.run_until(height)

    async def _compare(self, beside: Database) -> tuple[list[str], int]:
        """Which rows differ, as of one snapshot of the real database, and how many blocks it had."""
        found: list[str] = []
        async with self._database.read() as theirs:
            position = await store.position_in(theirs)
            if position is None:  # it is being rebuilt
                return found, 0
            await self._derive(beside, self._source, position.header.number + 1)
            async with beside.read() as ours:
                here, there = await theirs.connection(), await ours.connection()
                for model in ledger_tables():
                    if await table_digest(here, model) == await table_digest(there, model):
                        continue
                    async for key in differing_rows(here, there, model):
                        found.append(f"{model.__tablename__} {key}")
                        if len(found) >= MOST_NAMED:
                            return found, position.header.number + 1
                # Numbers do not come from the ledger, but each has to open what the ledger has of it.
                found += [f"{_NUMBERS} {uav_id}" for uav_id in await altered(theirs, await drone_records(there))]
        return found, position.header.number + 1


class Unhurried:
    """A ledger's blocks, no faster than so many transactions a second."""

    def __init__(self, source: BlockSource, transactions_per_s: int) -> None:
        self._source = source
        self._per_s = transactions_per_s

    async def height(self) -> int:
        """Number of blocks on the ledger."""
        return await self._source.height()

    async def blocks(self, start: int) -> AsyncGenerator[Block, None]:
        """Blocks from number `start` on."""
        async with contextlib.aclosing(self._source.blocks(start)) as stream:
            async for block in stream:
                yield block
                await asyncio.sleep(len(block.transactions) / self._per_s)
