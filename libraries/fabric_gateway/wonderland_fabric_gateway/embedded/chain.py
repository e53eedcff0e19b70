"""The chain while it runs: transactions go in, blocks come out, and whoever waits for either is told.

All of it belongs to one event loop. Only the disk sync of a block runs in a thread of its own; meanwhile proposals
are endorsed against the last committed block and the next block gathers. Nobody is told of a block before it is
durable.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Self

from wonderland_fabric_gateway.blocks import BlockHeader, parse_block
from wonderland_fabric_gateway.channel_config import endorsement_policy
from wonderland_fabric_gateway.commit_hash import Update, commit_hash
from wonderland_fabric_gateway.embedded.committer import Candidate, validate_block
from wonderland_fabric_gateway.embedded.config_update import (
    ConfigSigners,
    config_data,
    revocation_transaction,
    trust_of,
)
from wonderland_fabric_gateway.embedded.errors import (
    AccessDeniedError,
    DirectoryError,
    LedgerCorruptedError,
    LedgerOverloadedError,
    LedgerUnavailableError,
    StorageError,
    TableCorruptedError,
)
from wonderland_fabric_gateway.embedded.integrity import OlderBlocks, last_commit_hash, verify_tip
from wonderland_fabric_gateway.embedded.msp import ChannelMembership
from wonderland_fabric_gateway.embedded.orderer import BatchCutter, BatchLimits, BlockAssembler
from wonderland_fabric_gateway.embedded.recompute import verify_seal
from wonderland_fabric_gateway.embedded.seal import Seal
from wonderland_fabric_gateway.embedded.state import (
    LAST_CONFIG,
    CommittedTx,
    StateReader,
    StateWriter,
    Tip,
    TxLocation,
    create,
    reading,
)
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.transactions import ValidationCode

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

RECENT_TRANSACTIONS: Final = 16_384
RECENT_BLOCKS: Final = 64
RECENT_BLOCK_BYTES: Final = 1 << 20
MAX_STATUS_WAITERS: Final = 50_000
RETRY_S: Final = 1.0
_log: Final = logging.getLogger(__name__)


@dataclass(frozen=True)
class ChainSettings:
    """How a chain runs. `clock` gives milliseconds since the epoch, `random(n)` n random bytes."""

    channel: str
    signers: ConfigSigners
    limits: BatchLimits
    clock: Callable[[], int]
    random: Callable[[int], bytes]
    seal_key: bytes = b""
    """The secret that all rows are sealed with; without one an edited row goes unnoticed."""
    adopt: bool = False
    """The store is not sealed with this key yet: recompute it from its blocks, then seal it."""


def initialise(path: Path, genesis: Callable[[], tuple[BlockHeader, bytes]]) -> bool:
    """Make the store and, if it is empty, commit block 0; whether it was. Raises `DirectoryError`, `StorageError`."""
    create(path)
    with reading(path), contextlib.closing(StateReader(path)) as reader:
        empty = reader.tip().number < 0
    if not empty:
        return False
    header, raw = genesis()
    block = parse_block(raw)
    writer = StateWriter(path)
    try:
        transactions = [CommittedTx(tx.tx_id, tx.validation_code, tx.timestamp_ms, ()) for tx in block.transactions]
        writer.stage_block(0, header.hash, raw, transactions, {LAST_CONFIG: b"0"})
        writer.commit(0)
    finally:
        writer.close()
    return True


class Chain:
    """One channel's chain. Use `start` and `close`, or ``async with``."""

    def __init__(self, path: Path, settings: ChainSettings) -> None:
        """Open an initialised store; check its seal, and its end. Raises `LedgerCorruptedError`, `DirectoryError`."""
        self.settings: Final = settings
        seal = Seal(settings.seal_key) if settings.seal_key else None
        self.reader: Final = StateReader(path, None if seal is None else seal.rows)
        with contextlib.ExitStack() as on_failure, reading(path):
            on_failure.callback(self.reader.close)
            if seal is not None:
                verify_seal(path, self.reader, seal, adopt=settings.adopt)
            verify_tip(self.reader)
            self._tip = self.reader.tip()
            self._last_config, self._config_data, self.membership = self._load_config()
            self._policy = endorsement_policy(self._config_data)
            on_failure.pop_all()
        self.writer: Final = StateWriter(path, seal=seal)
        if settings.adopt:
            self.writer.seal_as_is(self._tip)
        self._commit_hash = last_commit_hash(self.reader)
        self._older = OlderBlocks(path, self._tip.number, self._found_damage)
        self._cutter = BatchCutter(settings.limits)
        self._assembler = BlockAssembler(settings.signers.orderer, settings.random)
        self._lists: list[tuple[Mapping[str, Sequence[bytes]], asyncio.Future[int | None]]] = []
        self._waiters: dict[str, list[asyncio.Future[TxLocation]]] = {}
        self._recent: OrderedDict[str, TxLocation] = OrderedDict()
        self._recent_blocks: OrderedDict[int, bytes] = OrderedDict()
        self._grown = asyncio.Event()
        self._trouble = ""
        self._halted = False
        self._closing = False
        self._task: asyncio.Task[None] | None = None
        if seal is not None:
            seal.rows.on_damage = self._found_edit
        self._disk = ThreadPoolExecutor(max_workers=1, thread_name_prefix="ledger-disk")

    async def __aenter__(self) -> Self:
        self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def height(self) -> int:
        """Number of committed blocks."""
        return self._tip.number + 1

    @property
    def tip(self) -> Tip:
        """The last committed block."""
        return self._tip

    @property
    def config_block(self) -> int:
        """The number of the block with the configuration in force."""
        return self._last_config

    @property
    def trouble(self) -> str:
        """Why no transaction is taken now; "" when all is well."""
        return self._trouble

    @property
    def verified_from(self) -> int:
        """The oldest block whose hashes and signatures have been checked since the start; in the end 0."""
        return self._older.verified_from

    @property
    def closing(self) -> bool:
        """Whether the ledger is stopping."""
        return self._closing

    def start(self) -> None:
        """Begin to make blocks."""
        self._task = asyncio.get_running_loop().create_task(self._make_blocks(), name="ledger-blocks")
        self._older.start()

    async def close(self) -> None:
        """Commit what was taken, then stop. Who still waits is told that the ledger is unavailable."""
        if self._closing:
            return
        self._closing = True
        await self._older.stop()
        self._cutter.interrupt(hurry=True)
        if self._task is not None:
            await self._task
        self._fail_waiters("the ledger is stopping")
        self._announce()
        self._disk.shutdown()
        self.reader.close()
        self.writer.close()

    def require_writable(self) -> None:
        """Raise `LedgerUnavailableError` unless transactions are taken now."""
        if self._trouble:
            raise LedgerUnavailableError(self._trouble)
        if self._closing:
            raise LedgerUnavailableError("the ledger is stopping")

    def submit(self, candidate: Candidate) -> None:
        """Put a checked transaction in line for a block. Raises `LedgerUnavailableError`; then it was not taken."""
        self.require_writable()
        self._cutter.add(candidate)

    def has_transaction(self, tx_id: str) -> bool:
        """Whether a transaction with this id is committed, valid or not."""
        return tx_id in self._recent or self.reader.transaction(tx_id) is not None

    async def transaction(self, tx_id: str) -> TxLocation:
        """Where a transaction is, as soon as it is committed; waits for ever for one that never comes.

        Raises `LedgerUnavailableError` when the ledger stops before it can say.
        """
        found = self._recent.get(tx_id) or self.reader.transaction(tx_id)
        # A block is in the store a moment before it is the newest: nobody is told of it before it is.
        if found is not None and found.block < self.height:
            return found
        if self._closing or self._halted:
            raise LedgerUnavailableError(self._trouble or "the ledger is stopping")
        if len(self._waiters) >= MAX_STATUS_WAITERS:
            raise LedgerOverloadedError("too many clients wait for the status of a transaction; try again in a second")
        waiter: asyncio.Future[TxLocation] = asyncio.get_running_loop().create_future()
        waiters = self._waiters.setdefault(tx_id, [])
        waiters.append(waiter)
        try:
            return await waiter
        finally:
            waiters.remove(waiter)
            if not waiters and self._waiters.get(tx_id) is waiters:
                del self._waiters[tx_id]

    async def wait_for_block(self, number: int) -> None:
        """Return when block `number` is committed. Raises `LedgerUnavailableError` when the ledger stops."""
        while number >= self.height:
            if self._closing:
                raise LedgerUnavailableError("the ledger is stopping")
            await self._grown.wait()

    def block(self, number: int) -> bytes | None:
        """A committed block's bytes, or None."""
        return self._recent_blocks.get(number) or self.reader.block(number)

    async def set_revocation_lists(self, lists: Mapping[str, Sequence[bytes]]) -> int | None:
        """Give organisations these lists (PEM) by a config block; its number, or None when nothing changes.

        From the next block on the revoked are refused. Raises `RevocationListError`, `LedgerUnavailableError`.
        """
        self.require_writable()
        done: asyncio.Future[int | None] = asyncio.get_running_loop().create_future()
        self._lists.append((lists, done))
        self._cutter.interrupt()
        return await done

    async def _make_blocks(self) -> None:
        while not self._closing or len(self._cutter) or self._lists:
            await self._cutter.wait()
            if self._halted:
                return
            if self._lists:
                lists, done = self._lists.pop(0)
                await self._make_config_block(lists, done)
            batch = self._cutter.take_batch()
            if not batch:
                continue
            try:
                await self._make_block(batch)
            except StorageError as error:
                self._cutter.put_back(batch)
                if not error.full or self._closing:
                    self._halt(f"the ledger cannot write ({error}); what is committed is safe. Mend the disk, restart")
                    return
                self._wait_for_space(error)
                await asyncio.sleep(RETRY_S)
            except TableCorruptedError:  # `_found_edit` has halted it
                return
            except Exception:  # noqa: BLE001 - a fault of ours must not leave clients waiting for ever
                _log.critical("no block could be made of %d transactions", len(batch), exc_info=True)
                self._halt("the ledger failed while it made a block; its log says why. Restart it")
                return
            else:
                self._writes_again()

    async def _make_block(self, batch: list[Candidate]) -> None:
        number = self._tip.number + 1
        candidates = [self._rechecked(candidate) for candidate in batch]
        results = validate_block(self.writer, number, candidates, self._policy)
        new_hash = self._hash_with(number, results)
        header, raw = self._assembler.assemble(
            number,
            self._tip.header_hash,
            [candidate.envelope for candidate in batch],
            [result.code for result in results],
            self._last_config,
            new_hash,
        )
        await self._write(header, raw, results, {})
        self._commit_hash = new_hash or None

    async def _make_config_block(self, lists: Mapping[str, Sequence[bytes]], done: asyncio.Future[int | None]) -> None:
        number = self._tip.number + 1
        settings = self.settings
        try:
            made = revocation_transaction(
                settings.channel,
                self._config_data,
                lists,
                settings.signers,
                timestamp_ms=settings.clock(),
                random=settings.random,
            )
            if made is not None:
                tx_id, envelope, _ = made
                result = CommittedTx(tx_id, int(ValidationCode.VALID), settings.clock(), ())
                new_hash = self._hash_with(number, [result])
                header, raw = self._assembler.assemble(number, self._tip.header_hash, [envelope], [0], number, new_hash)
                await self._write(header, raw, [result], {LAST_CONFIG: str(number).encode()})
                self._commit_hash = new_hash or None
                self._last_config, self._config_data, self.membership = self._load_config()
        except Exception as error:  # noqa: BLE001 - handed to the one who asked
            if not done.done():
                done.set_exception(error)
            if isinstance(error, StorageError) and not error.full:
                self._halt(f"the ledger cannot write ({error}); what is committed is safe. Mend the disk, restart")
        else:
            if not done.done():
                done.set_result(None if made is None else number)

    async def _write(
        self, header: BlockHeader, raw: bytes, results: Sequence[CommittedTx], meta: Mapping[str, bytes]
    ) -> None:
        """Make a block durable, then tell everybody. Raises `StorageError`; then nobody was told anything."""
        self.writer.stage_block(header.number, header.hash, raw, results, meta)
        await asyncio.get_running_loop().run_in_executor(self._disk, self.writer.commit, header.number)
        self.writer.keep()
        self._tip = Tip(header.number, header.hash)
        if len(raw) <= RECENT_BLOCK_BYTES:
            self._recent_blocks[header.number] = raw
            if len(self._recent_blocks) > RECENT_BLOCKS:
                self._recent_blocks.popitem(last=False)
        for position, result in enumerate(results):
            # A repeated id keeps the place of its first transaction, here as in the store.
            location = TxLocation(header.number, position, result.code)
            if result.code == ValidationCode.DUPLICATE_TXID:
                location = self._recent.get(result.tx_id) or self.reader.transaction(result.tx_id) or location
            self._recent[result.tx_id] = location
            for waiter in self._waiters.get(result.tx_id, ()):
                if not waiter.done():
                    waiter.set_result(location)
        while len(self._recent) > RECENT_TRANSACTIONS:
            self._recent.popitem(last=False)
        self._announce()

    def _hash_with(self, number: int, results: Sequence[CommittedTx]) -> bytes:
        """The commit hash of the next block; empty on a chain that was begun without."""
        if self._commit_hash is None:
            return b""
        updates = [
            Update(write.namespace, write.key, write.value, position)
            for position, result in enumerate(results)
            for write in result.writes
        ]
        return commit_hash(self._commit_hash, number, bytes(result.code for result in results), updates)

    def _rechecked(self, candidate: Candidate) -> Candidate:
        """The candidate, refused if its sender was revoked between submission and this block."""
        if candidate.config_sequence == self.membership.sequence or candidate.code != ValidationCode.VALID:
            return candidate
        code = ValidationCode.VALID
        try:
            self.membership.application_member(candidate.creator, self.settings.clock())
        except AccessDeniedError:
            code = ValidationCode.BAD_CREATOR_SIGNATURE
        return replace(candidate, code=int(code), config_sequence=self.membership.sequence)

    def _writes_again(self) -> None:
        if self._trouble and not self._halted:  # an edited row may have been read while the block was written
            _log.warning("the ledger writes again")
            self._trouble = ""

    def _wait_for_space(self, error: StorageError) -> None:
        if self._halted:
            return
        if not self._trouble:
            _log.error("%s; waiting for space", error)
        self._trouble = f"the ledger's disk is full ({error}); it goes on by itself when there is space"

    def _found_damage(self, error: LedgerCorruptedError) -> None:
        self._halt(f"nothing is added to this chain any more, since {error}; restore it from a copy")
        self._cutter.interrupt()

    def _found_edit(self, error: TableCorruptedError) -> None:
        self._halt(str(error))
        self._cutter.interrupt()

    def _halt(self, text: str) -> None:
        _log.error("%s", text)
        self._trouble = text
        self._halted = True
        self._fail_waiters(text)
        for _, done in self._lists:
            if not done.done():
                done.set_exception(LedgerUnavailableError(text))
        self._lists.clear()

    def _fail_waiters(self, text: str) -> None:
        for waiters in list(self._waiters.values()):
            for waiter in waiters:
                if not waiter.done():
                    waiter.set_exception(LedgerUnavailableError(text))

    def _announce(self) -> None:
        grown, self._grown = self._grown, asyncio.Event()
        grown.set()

    def _load_config(self) -> tuple[int, bytes, ChannelMembership]:
        text = self.reader.meta(LAST_CONFIG) or b""
        number = int(text) if text.isdigit() and len(text) < 19 else -1
        raw = self.reader.block(number)
        try:
            block = None if raw is None else parse_block(raw)
        except BlockError as cause:
            raise LedgerCorruptedError(f"stored block {number}: {cause}") from cause
        if block is None or block.config is None:
            raise LedgerCorruptedError(f"block {number} should carry the channel's configuration, and does not")
        channel = block.transactions[0].channel
        if channel != self.settings.channel:
            raise DirectoryError(f"the stored chain is of channel {channel!r}, not {self.settings.channel!r}")
        membership = ChannelMembership(trust_of(block.config), sequence=block.config.sequence)
        return number, config_data(block.envelopes[0]), membership
