"""Following the ledger: block after block into the database, over interruptions, until something contradicts."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final

from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from wonderland_backend.db.engine import Database
from wonderland_backend.errors import MirrorHalted
from wonderland_backend.mirror import store
from wonderland_backend.mirror.derive import Changes, derive
from wonderland_backend.mirror.rows import participants
from wonderland_backend.mirror.source import BlockSource
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.store import Position
from wonderland_backend.mirror.subscriber import Subscriber
from wonderland_fabric_gateway.blocks import Block, BlockHeader
from wonderland_fabric_gateway.errors import BlockError, LedgerError

logger = logging.getLogger(__name__)

QUEUE_BLOCKS: Final = 256
FIRST_PAUSE_S: Final = 0.1
LONGEST_PAUSE_S: Final = 5.0


class Mirror:
    """Mirrors one channel into one database.

    `subscribers` have their part in each commit, in this order. `status` is kept up to date for others to read.
    """

    def __init__(
        self,
        database: Database,
        source: BlockSource,
        *,
        channel: str,
        chaincode: str,
        status: MirrorStatus,
        clock: Callable[[], int],
        subscribers: Sequence[Subscriber[Any]] = (),
        batch_transactions: int = 2_000,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._database = database
        self._source = source
        self._channel = channel
        self._chaincode = chaincode
        self._status = status
        self._clock = clock
        self._subscribers = subscribers
        self._batch = batch_transactions
        self._sleep = sleep
        self._until: int | None = None
        status.channel = channel

    async def run(self) -> None:
        """Mirror until cancelled. A contradiction ends it: the status says so, and what was mirrored stands."""
        try:
            await self._persist()
        except MirrorHalted as halt:
            self._status.halt(self._clock(), str(halt))
            logger.critical("the mirror has halted: %s", halt)

    async def run_until(self, height: int) -> None:
        """Mirror until so many blocks are here. Raises `MirrorHalted`."""
        self._until = height
        await self._persist()

    async def _persist(self) -> None:
        pause_s = FIRST_PAUSE_S
        while True:
            mirrored = self._status.mirrored
            try:
                await self._follow()
            except BlockError as error:
                raise MirrorHalted(f"The ledger sent what cannot be: {error}.") from error
            except IntegrityError as error:
                raise MirrorHalted(
                    f"The database refused a row that the ledger demands ({error.orig}); `wonderland backend rebuild` "
                    "makes the rows anew."
                ) from error
            except (LedgerError, SQLAlchemyError, OSError) as error:
                problem = str(getattr(error, "orig", None) or error).splitlines()[0][:500]
                self._status.lost(self._clock(), problem)
                logger.warning("the mirror was interrupted: %s", problem)
            else:
                return
            if self._status.mirrored > mirrored:
                pause_s = FIRST_PAUSE_S
            await self._sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    async def _follow(self) -> None:
        """One connection's worth; returns only when `run_until` has what it wants."""
        before = await store.position(self._database)
        if before is not None and before.channel != self._channel:
            raise MirrorHalted(
                f"The database mirrors channel {before.channel}, this ledger's is {self._channel}; use another one."
            )
        start = before.header.number if before is not None else 0
        height = await self._source.height()
        self._status.mirrored = start + 1 if before is not None else 0
        if height < self._status.mirrored:
            await self._require_same_chain(height)
            raise LedgerError(
                f"the ledger has only {height} blocks, of which {self._status.mirrored} are mirrored already: this "
                "peer is still catching up, or the ledger was restored from a backup (then rebuild this database)"
            )
        self._status.saw(height, self._clock())
        self._connected()
        if self._is_done():
            return
        queue: asyncio.Queue[Block | Exception] = asyncio.Queue(QUEUE_BLOCKS)
        reader = asyncio.create_task(self._read(start, before, queue), name="mirror-reader")
        try:
            while not self._is_done():
                before = await self._take(queue, before)
        finally:
            reader.cancel()
            await asyncio.gather(reader, return_exceptions=True)

    async def _require_same_chain(self, height: int) -> None:
        """Raise `MirrorHalted` when a shorter ledger is not the beginning of what is mirrored, but another one."""
        async with contextlib.aclosing(self._source.blocks(height - 1)) as blocks:
            newest = await anext(blocks)
        mirrored = await store.header_hash(self._database, newest.number)
        if newest.header.hash.hex() != mirrored:
            raise _another(newest.number)

    async def _read(self, start: int, before: Position | None, queue: asyncio.Queue[Block | Exception]) -> None:
        """Blocks into the queue; the error that ended the stream after them."""
        try:
            async with contextlib.aclosing(self._source.blocks(start)) as blocks:
                async for block in blocks:
                    if before is not None and block.number == start:
                        _require_same(block, before)
                        continue
                    self._status.saw(block.number + 1, self._clock())
                    await queue.put(block)
            await queue.put(LedgerError("the ledger ended the stream of blocks"))
        except Exception as error:  # noqa: BLE001 - handed over, so that blocks before it are written first
            await queue.put(error)

    async def _take(self, queue: asyncio.Queue[Block | Exception], before: Position | None) -> Position | None:
        """Write what waits, as one commit of whole blocks. Raises the reader's error when it is its turn."""
        item = await queue.get()
        if isinstance(item, Exception):
            raise item
        changes = Changes()
        failed: Exception | None = None
        header = before.header if before is not None else None
        while True:
            try:
                _require_next(item, header)
            except BlockError as error:
                if not changes.blocks:
                    raise
                failed = error  # those before it stand
                break
            header = item.header
            derive(item, self._chaincode, changes)
            await asyncio.sleep(0)
            if len(changes.transactions) >= self._batch or queue.empty() or self._is_done(item.number + 1):
                break
            following = queue.get_nowait()
            if isinstance(following, Exception):
                failed = following
                break
            item = following
        found = await store.save(self._database, self._channel, before, changes, self._subscribers)
        self._committed(changes)
        for subscriber, each in found:
            subscriber.after_commit(changes, each)
        if failed is not None:
            raise failed
        assert header is not None
        return Position(self._channel, header)

    def _committed(self, changes: Changes) -> None:
        status = self._status
        status.mirrored = changes.last.number + 1
        status.transactions += len(changes.transactions)
        status.unread += len(changes.unread)
        for row in changes.unread:
            logger.error("block %s, transaction %s: %s", row.block, row.tx_index, row.problem)
        if changes.organisations is not None:
            status.organisations = participants((row.msp_id, row.definition) for row in changes.organisations)
        self._connected()

    def _connected(self) -> None:
        self._status.connected = True
        self._status.problem = None
        if self._status.is_level:
            self._status.level_ms = self._clock()

    def _is_done(self, mirrored: int | None = None) -> bool:
        return self._until is not None and (self._status.mirrored if mirrored is None else mirrored) >= self._until


def _require_next(block: Block, header: BlockHeader | None) -> None:
    if header is not None:
        block.require_follows(header)
    elif block.number != 0:
        raise BlockError(f"the first block is {block.number}, not 0")


def _require_same(block: Block, before: Position) -> None:
    if block.header != before.header:
        raise _another(block.number)


def _another(number: int) -> MirrorHalted:
    return MirrorHalted(
        f"The ledger has another block {number} than the one that was mirrored: it was set up anew, or it is another "
        "ledger. Use another database, or `wonderland backend rebuild` for this one."
    )
