"""What a transaction read and wrote: the read-write set, as it is simulated, endorsed, and checked at commit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fabric_protos.ledger.rwset import rwset_pb2
from fabric_protos.ledger.rwset.kvrwset import kv_rwset_pb2

from wonderland_fabric_gateway.embedded.errors import MalformedRequestError
from wonderland_fabric_gateway.embedded.range_reads import Version, summary_of
from wonderland_fabric_gateway.signature_policies import VALIDATION_PARAMETER

if TYPE_CHECKING:
    from collections.abc import Iterable

    from wonderland_fabric_gateway import transactions
    from wonderland_fabric_gateway.transactions import NamespaceAccess, ReadsSummary


@dataclass(frozen=True, slots=True)
class Read:
    """A key that was read, and the version that was found there (None: the key was not there)."""

    namespace: str
    key: str
    version: Version | None


@dataclass(frozen=True, slots=True)
class RangeRead:
    """A range that was read. Unless `exhausted`, reading stopped early and `end` is the last key seen (included).

    `summary` stands in place of `results` where the set was read back from a transaction that has only that.
    """

    namespace: str
    start: str
    end: str
    exhausted: bool
    results: tuple[tuple[str, Version], ...]
    summary: ReadsSummary | None = None


@dataclass(frozen=True, slots=True)
class Write:
    """A key and its new value; None deletes it."""

    namespace: str
    key: str
    value: bytes | None


@dataclass(frozen=True, slots=True)
class KeyPolicy:
    """A key and who must endorse its changes from now on (``common.SignaturePolicyEnvelope``)."""

    namespace: str
    key: str
    policy: bytes


@dataclass(frozen=True, slots=True)
class ReadWriteSet:
    """One transaction's reads, range reads and writes, in the order in which they are encoded."""

    reads: tuple[Read, ...] = ()
    ranges: tuple[RangeRead, ...] = ()
    writes: tuple[Write, ...] = ()
    policies: tuple[KeyPolicy, ...] = ()

    def size_bytes(self) -> int:
        """A rough size in memory, for bounding caches."""
        return (
            sum(len(read.key) + 64 for read in self.reads)
            + sum(64 + sum(len(key) + 64 for key, _ in item.results) for item in self.ranges)
            + sum(len(write.key) + len(write.value or b"") + 64 for write in self.writes)
            + sum(len(each.key) + len(each.policy) + 64 for each in self.policies)
        )


def encode(rwset: ReadWriteSet, namespace: str) -> bytes:
    """``ledger.rwset.TxReadWriteSet`` with the one namespace of the contract that ran; keys sorted as Fabric does.

    A set without anything has no namespace, and a range without keys no list of them, as on Fabric.
    """
    if rwset == ReadWriteSet():
        return bytes(rwset_pb2.TxReadWriteSet(data_model=rwset_pb2.TxReadWriteSet.KV).SerializeToString())
    kv = kv_rwset_pb2.KVRWSet()
    for read in sorted(rwset.reads, key=lambda item: item.key.encode()):
        entry = kv.reads.add(key=read.key)
        if read.version is not None:
            entry.version.block_num, entry.version.tx_num = read.version
            entry.version.SetInParent()
    for item in rwset.ranges:
        query = kv.range_queries_info.add(start_key=item.start, end_key=item.end, itr_exhausted=item.exhausted)
        summary = item.summary or summary_of(item.results)
        if summary is not None:
            found = query.reads_merkle_hashes
            found.max_degree, found.max_level = summary.max_degree, summary.max_level
            found.max_level_hashes.extend(summary.hashes)
            continue
        for key, version in item.results:
            entry = query.raw_reads.kv_reads.add(key=key)
            entry.version.block_num, entry.version.tx_num = version
            entry.version.SetInParent()
    for write in sorted(rwset.writes, key=lambda item: item.key.encode()):
        kv.writes.add(key=write.key, is_delete=write.value is None, value=write.value or b"")
    for each in sorted(rwset.policies, key=lambda item: item.key.encode()):
        kv.metadata_writes.add(key=each.key).entries.add(name=VALIDATION_PARAMETER, value=each.policy)
    return bytes(
        rwset_pb2.TxReadWriteSet(
            data_model=rwset_pb2.TxReadWriteSet.KV,
            ns_rwset=[rwset_pb2.NsReadWriteSet(namespace=namespace, rwset=kv.SerializeToString())],
        ).SerializeToString()
    )


def from_accesses(accesses: Iterable[NamespaceAccess]) -> ReadWriteSet:
    """The set of a parsed transaction. Raises `MalformedRequestError` for what this ledger never endorses."""
    reads: list[Read] = []
    ranges: list[RangeRead] = []
    writes: list[Write] = []
    policies: list[KeyPolicy] = []
    for access in accesses:
        namespace = access.namespace
        reads.extend(Read(namespace, read.key, _version(read)) for read in access.reads)
        for query in access.range_queries:
            results = tuple((read.key, _version(read)) for read in query.reads or ())
            if any(version is None for _, version in results):
                raise MalformedRequestError(f"the range read from {query.start_key!r} lists a key without its version")
            found = tuple((key, version) for key, version in results if version is not None)
            ranges.append(RangeRead(namespace, query.start_key, query.end_key, query.exhausted, found, query.summary))
        writes.extend(Write(namespace, write.key, None if write.is_delete else write.value) for write in access.writes)
        policies.extend(
            KeyPolicy(namespace, each.key, value)
            for each in access.metadata_writes
            for name, value in each.entries
            if name == VALIDATION_PARAMETER
        )
    return ReadWriteSet(tuple(reads), tuple(ranges), tuple(writes), tuple(policies))


def _version(read: transactions.Read) -> Version | None:
    return None if read.version is None else (read.version.block, read.version.transaction)
