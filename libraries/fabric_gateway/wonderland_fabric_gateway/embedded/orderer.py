"""Ordering: when a block is cut, and what it looks like.

A block is cut when its oldest transaction has waited for the batch time, or when it is full by count or bytes. While
one block is being written the next gathers, so that under load one disk sync serves many transactions.
"""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.blocks import BlockHeader, data_hash
from wonderland_fabric_gateway.embedded.errors import LedgerOverloadedError
from wonderland_fabric_gateway.embedded.genesis import METADATA_SLOTS, PREFERRED_MAX_BYTES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from wonderland_fabric_gateway.embedded.committer import Candidate
    from wonderland_fabric_gateway.embedded.config_update import SigningIdentity

DEFAULT_BATCH_MS: Final = 10
DEFAULT_BATCH_COUNT: Final = 500
MAX_WAITING: Final = 20_000
MAX_WAITING_BYTES: Final = 256 << 20
_NONCE_BYTES: Final = 24


@dataclass(frozen=True)
class BatchLimits:
    """When a block is cut."""

    time_ms: int = DEFAULT_BATCH_MS
    count: int = DEFAULT_BATCH_COUNT
    size_bytes: int = PREFERRED_MAX_BYTES


class BatchCutter:
    """Transactions that wait for a block. Belongs to one event loop."""

    def __init__(self, limits: BatchLimits) -> None:
        self.limits: Final = limits
        self._waiting: deque[tuple[float, Candidate]] = deque()
        self._bytes = 0
        self._something = asyncio.Event()
        self._enough = asyncio.Event()
        self._hurry = False

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, candidate: Candidate) -> None:
        """Put a transaction in line. Raises `LedgerOverloadedError` when the line is too long."""
        if len(self._waiting) >= MAX_WAITING or self._bytes >= MAX_WAITING_BYTES:
            raise LedgerOverloadedError("too many transactions are waiting for a block; try again in a second")
        self._waiting.append((asyncio.get_running_loop().time(), candidate))
        self._bytes += len(candidate.envelope)
        self._something.set()
        if len(self._waiting) >= self.limits.count or self._bytes >= self.limits.size_bytes:
            self._enough.set()

    def put_back(self, batch: Sequence[Candidate]) -> None:
        """Return a batch that could not be written to the head of the line."""
        for candidate in reversed(batch):
            self._waiting.appendleft((0.0, candidate))
            self._bytes += len(candidate.envelope)
        self._something.set()
        self._enough.set()

    def interrupt(self, *, hurry: bool = False) -> None:
        """Wake `wait` although nothing may be due; with `hurry`, nothing waits for its batch time any more."""
        self._hurry = self._hurry or hurry
        self._something.set()
        self._enough.set()

    async def wait(self) -> None:
        """Return when a block is due, or after `interrupt`."""
        await self._something.wait()
        if not self._waiting or self._hurry:
            return
        due = self._waiting[0][0] + self.limits.time_ms / 1000
        delay = due - asyncio.get_running_loop().time()
        if delay > 0 and not self._enough.is_set():
            timer = asyncio.get_running_loop().call_later(delay, self._enough.set)
            try:
                await self._enough.wait()
            finally:
                timer.cancel()

    def take_batch(self) -> list[Candidate]:
        """The next block's transactions, oldest first; at least one if there is any."""
        batch: list[Candidate] = []
        size = 0
        while self._waiting and len(batch) < self.limits.count:
            length = len(self._waiting[0][1].envelope)
            if batch and size + length > self.limits.size_bytes:
                break
            batch.append(self._waiting.popleft()[1])
            size += length
        self._bytes -= size
        if len(self._waiting) < self.limits.count and self._bytes < self.limits.size_bytes:
            self._enough.clear()
        if not self._waiting:
            self._something.clear()
        return batch


class BlockAssembler:
    """Makes blocks: header chain, validation codes, and the orderer's signature."""

    def __init__(self, orderer: SigningIdentity, random: Callable[[int], bytes]) -> None:
        self._orderer = orderer
        self._random = random

    def assemble(
        self,
        number: int,
        previous_hash: bytes,
        envelopes: Sequence[bytes],
        codes: Sequence[int],
        last_config: int,
        commit_hash: bytes = b"",
    ) -> tuple[BlockHeader, bytes]:
        """The block's header and its ``common.Block`` bytes.

        The orderer signs value ‖ signature header ‖ DER of the block header; the validation codes and the commit hash
        are not signed, on Fabric neither.
        """
        header = BlockHeader(number, previous_hash, data_hash(list(envelopes)))
        config = common_pb2.LastConfig(index=last_config)
        value = common_pb2.OrdererBlockMetadata(last_config=config).SerializeToString()
        signature_header = common_pb2.SignatureHeader(
            creator=self._orderer.creator, nonce=self._random(_NONCE_BYTES)
        ).SerializeToString()
        signature = common_pb2.MetadataSignature(
            signature_header=signature_header, signature=self._orderer.sign(value + signature_header + header.der)
        )
        metadata = [b""] * METADATA_SLOTS
        metadata[common_pb2.SIGNATURES] = common_pb2.Metadata(value=value, signatures=[signature]).SerializeToString()
        metadata[common_pb2.LAST_CONFIG] = common_pb2.Metadata(value=config.SerializeToString()).SerializeToString()
        metadata[common_pb2.TRANSACTIONS_FILTER] = bytes(codes)
        if commit_hash:
            metadata[common_pb2.COMMIT_HASH] = common_pb2.Metadata(value=commit_hash).SerializeToString()
        block = common_pb2.Block(
            header=common_pb2.BlockHeader(number=number, previous_hash=previous_hash, data_hash=header.data_hash),
            data=common_pb2.BlockData(data=envelopes),
            metadata=common_pb2.BlockMetadata(metadata=metadata),
        )
        return header, block.SerializeToString()
