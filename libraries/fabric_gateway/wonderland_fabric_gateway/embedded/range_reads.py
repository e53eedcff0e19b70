"""What a long range read leaves in the read-write set: not each key, but a Merkle tree's top, as on Fabric.

Up to `MAX_DEGREE` keys are listed. Beyond, they are hashed in groups of one more than that, and the hashes again, level
by level. Source: Fabric ``core/ledger/kvledger/txmgmt/rwsetutil/query_results_helper.go``.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Final, TypeAlias

from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2

from wonderland_fabric_gateway.transactions import ReadsSummary

if TYPE_CHECKING:
    from collections.abc import Iterable
MAX_DEGREE: Final = 50
Version: TypeAlias = tuple[int, int]
"""Where a value was written: block number and position in the block. A key that is not there has no version."""


def summary_of(results: Iterable[tuple[str, Version]]) -> ReadsSummary | None:
    """The summary of these keys with their versions; None for so few that they are listed."""
    pending: list[tuple[str, Version]] = []
    levels: dict[int, list[bytes]] = {}
    for result in results:
        pending.append(result)
        if len(pending) > MAX_DEGREE:
            _add(levels, _leaf(pending))
            pending = []
    if not levels:
        return None
    if pending:
        _add(levels, _leaf(pending))
    return _top(levels)


def _leaf(results: list[tuple[str, Version]]) -> bytes:
    reads = kv_rwset_pb2.QueryReads()
    for key, version in results:
        read = reads.kv_reads.add(key=key)
        read.version.block_num, read.version.tx_num = version
        read.version.SetInParent()
    return hashlib.sha256(reads.SerializeToString()).digest()


def _combined(hashes: list[bytes]) -> bytes:
    return hashlib.sha256(b"".join(hashes)).digest()


def _add(levels: dict[int, list[bytes]], leaf: bytes) -> None:
    """Put a leaf's hash in; a level that is too full becomes one hash of the next."""
    level, value = 1, leaf
    while True:
        hashes = levels.setdefault(level, [])
        hashes.append(value)
        if len(hashes) <= MAX_DEGREE:
            return
        value = _combined(hashes)
        levels[level] = []
        level += 1


def _top(levels: dict[int, list[bytes]]) -> ReadsSummary:
    """Carry what is left on the lower levels upwards."""
    top = max(levels)
    for level in range(1, top):
        hashes = levels[level]
        if hashes:
            levels[level + 1].append(hashes[0] if len(hashes) == 1 else _combined(hashes))
    hashes = levels[top]
    if len(hashes) > MAX_DEGREE:
        top, hashes = top + 1, [_combined(hashes)]
    return ReadsSummary(MAX_DEGREE, top, tuple(hashes))
