"""Whether the stored blocks hang together: the last ones when the ledger starts, all others while it already serves.

That no row of any table was changed is another matter, and known before anything is served (`recompute`, `seal`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.blocks import block_signatures, parse_block
from wonderland_fabric_gateway.commit_hash import commit_hash_of, expected_commit_hash
from wonderland_fabric_gateway.embedded.errors import LedgerCorruptedError
from wonderland_fabric_gateway.embedded.state import StateReader, reading
from wonderland_fabric_gateway.errors import LedgerError, VerificationError
from wonderland_fabric_gateway.signing import verify

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from wonderland_fabric_gateway.blocks import Block

CHECKED_BLOCKS: Final = 100
"""How many blocks of its end a start waits for."""
AT_ONCE: Final = 10
PAUSE_S: Final = 0.05
"""Between so many older blocks, so that checking them takes a small share of the ledger's time."""
_log: Final = logging.getLogger(__name__)


def verify_tip(reader: StateReader, depth: int = CHECKED_BLOCKS) -> None:
    """Check the last `depth` blocks: numbers, data hashes, header chain, signatures, commit hashes, index.

    Raises `LedgerCorruptedError` naming the block. An empty store passes.
    """
    tip = reader.tip()
    if reader.block_count() != tip.number + 1:
        raise LedgerCorruptedError(
            f"the chain ends with block {tip.number}, but only {reader.block_count()} are stored"
        )
    last = verify_blocks(reader, max(0, tip.number + 1 - depth), tip.number)
    if last is not None and last.header_hash != tip.header_hash:
        raise LedgerCorruptedError(f"block {tip.number} is not the one that its stored header hash is of")


def verify_blocks(reader: StateReader, first: int, last: int) -> Block | None:
    """Check these blocks and how they hang together; the last of them. Raises `LedgerCorruptedError`."""
    previous: Block | None = None
    for number in range(first, last + 1):
        block = load_block(reader, number)
        try:
            if previous is not None:
                block.require_follows(previous.header)
                require_commit_hash(previous, block)
            for signature in block_signatures(block):
                if signature.signer is not None:
                    verify(signature.signer.public_key, signature.message, signature.signature)
        except LedgerError as cause:
            raise LedgerCorruptedError(f"stored block {number}: {cause}") from cause
        for transaction in block.transactions:
            if transaction.tx_id and reader.transaction(transaction.tx_id) is None:
                raise LedgerCorruptedError(f"transaction {transaction.tx_id} of block {number} is not in the index")
        previous = block
    return previous


def last_commit_hash(reader: StateReader) -> bytes | None:
    """The tip's commit hash, empty for block 0; None for a chain that a version without commit hashes began."""
    tip = reader.tip()
    return b"" if tip.number <= 0 else commit_hash_of(load_block(reader, tip.number)) or None


class OlderBlocks:
    """Checks what lies before a chain's end, from there to block 0, with a reader and a thread of its own.

    `damaged` is called once, if something is wrong.
    """

    def __init__(self, path: Path, tip: int, damaged: Callable[[LedgerCorruptedError], None]) -> None:
        self.verified_from = max(0, tip + 1 - CHECKED_BLOCKS)
        self.damage: LedgerCorruptedError | None = None
        self._path = path
        self._damaged = damaged
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin, if there is anything to check."""
        if self.verified_from:
            self._task = asyncio.get_running_loop().create_task(self._run(), name="ledger-older-blocks")

    async def stop(self) -> None:
        """End, also in the middle."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _run(self) -> None:
        reader = StateReader(self._path)
        try:
            while self.verified_from:
                first = max(0, self.verified_from - AT_ONCE)
                # Not to be cancelled in the middle: the thread uses the reader.
                check = asyncio.ensure_future(asyncio.to_thread(self._check, reader, first))
                try:
                    await asyncio.shield(check)
                except asyncio.CancelledError:
                    await asyncio.wait((check,))
                    raise
                self.verified_from = first
                await asyncio.sleep(PAUSE_S)
        except LedgerCorruptedError as error:
            _log.critical("%s", error)
            self.damage = error
            self._damaged(error)
        else:
            _log.info("all blocks of the chain are sound")
        finally:
            reader.close()

    def _check(self, reader: StateReader, first: int) -> None:
        """These blocks, and how the next one, which is checked already, follows them."""
        with reading(self._path):
            verify_blocks(reader, first, self.verified_from)


def require_commit_hash(previous: Block, block: Block) -> None:
    """Raise `VerificationError` where a block's commit hash is not the one after that of the block before."""
    stated = commit_hash_of(block)
    if stated and stated != expected_commit_hash(commit_hash_of(previous), block):
        raise VerificationError("its commit hash does not fit its transactions and validation codes")


def load_block(reader: StateReader, number: int) -> Block:
    """A stored block. Raises `LedgerCorruptedError`."""
    raw = reader.block(number)
    if raw is None:
        raise LedgerCorruptedError(f"block {number} is missing from the store")
    try:
        block = parse_block(raw)
    except LedgerError as cause:
        raise LedgerCorruptedError(f"stored block {number}: {cause}") from cause
    if block.number != number:
        raise LedgerCorruptedError(f"block {block.number} is stored where {number} should be")
    return block
