"""The commit hash: what a peer says, block by block, about all that it has committed so far.

SHA-256 over the block's validation codes, its valid writes and the commit hash before it. Two peers with the same hash
in the same block have the same state. It is in the block's metadata (``COMMIT_HASH``) and not signed. Source: Fabric
``core/ledger/kvledger`` (addBlockCommitHash) and ``txmgmt/privacyenabledstate`` (the updates' bytes).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wonderland_fabric_gateway.blocks import Block

_VARINT: Final = 0
_BYTES: Final = 2


@dataclass(frozen=True, slots=True)
class Update:
    """What a key is after a block; None: it is deleted. `position` is that of the transaction in the block."""

    namespace: str
    key: str
    value: bytes | None
    position: int


def commit_hash(previous: bytes, block_number: int, codes: bytes, updates: Iterable[Update]) -> bytes:
    """The hash of a block. `updates` of its valid transactions, in order; the last one of a key counts.

    `previous` is the hash of the block before; block 0 has none, so that it is empty for block 1. No private data is
    thought of.
    """
    last = {(each.namespace.encode(), each.key.encode()): each for each in updates}
    batch = bytearray()
    namespace: bytes | None = None
    for place in sorted(last):
        batch += _field(1, _write(last[place], block_number, first=place[0] != namespace))
        namespace = place[0]
    digest = hashlib.sha256(_varint(len(codes)))
    digest.update(codes)
    digest.update(batch)
    digest.update(previous)
    return digest.digest()


def commit_hash_of(block: Block) -> bytes:
    """What a block's metadata gives for its commit hash; empty where there is none. Raises `BlockError`."""
    if len(block.metadata) <= common_pb2.COMMIT_HASH:
        return b""
    what = f"block {block.number}: commit hash"
    return bytes(decode(common_pb2.Metadata, block.metadata[common_pb2.COMMIT_HASH], what, BlockError).value)


def expected_commit_hash(previous: bytes, block: Block) -> bytes:
    """What a block's commit hash must be after that of the block before, by its codes and its valid writes."""
    updates = [
        Update(namespace, write.key, None if write.is_delete else write.value, transaction.index)
        for transaction in block.transactions
        if transaction.is_valid
        for namespace, write in transaction.writes
    ]
    codes = bytes(transaction.validation_code for transaction in block.transactions)
    return commit_hash(previous, block.number, codes, updates)


def _write(update: Update, block_number: int, *, first: bool) -> bytes:
    """``KVWriteProto``: 1 namespace (only with the first key of it), 3 key, 4 is_delete, 5 value, 6 version."""
    parts = [_field(1, update.namespace.encode()) if first else b"", _field(3, update.key.encode())]
    if update.value is None:
        parts.append(bytes((4 << 3 | _VARINT, 1)))
    elif update.value:
        parts.append(_field(5, update.value))
    parts.append(_field(6, _ordered(block_number) + _ordered(update.position)))
    return b"".join(parts)


def _field(number: int, data: bytes) -> bytes:
    return bytes((number << 3 | _BYTES,)) + _varint(len(data)) + data


def _varint(number: int) -> bytes:
    encoded = bytearray()
    while number >= 0x80:
        encoded.append(number & 0x7F | 0x80)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)


def _ordered(number: int) -> bytes:
    """Fabric's variable-length number that sorts as it counts: the count of its bytes, then these, big-endian."""
    size = (number.bit_length() + 7) // 8
    return bytes((size,)) + number.to_bytes(size, "big")
