"""The contract's view of the ledger during one transaction: committed state in, read-write set out.

Reads see the state of one block and never the transaction's own writes, as on Fabric. Every read is recorded with the
version found, every range with all that it showed, so that the commit can tell whether it would read the same.
No awaitable of this stub ever suspends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wonderland.ledger.contract_rules import Budget, check_endorsers, check_event, check_key, check_value
from wonderland.ledger.embedded.rwset import KeyPolicy, RangeRead, Read, ReadWriteSet, Write
from wonderland.ledger.signature_policies import key_policy

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator, Sequence

    from wonderland.ledger.embedded.msp import Creator
    from wonderland.ledger.embedded.rwset import Version
    from wonderland.ledger.embedded.state import Modification, StateReader


class TransactionStub:
    """One transaction's stub. The attributes are set by the ledger; the contract only reads them.

    `timestamp_ms` is the client's word, checked to be within 15 minutes of the ledger's clock.
    """

    __slots__ = ("_budget", "_event", "_namespace", "_policies", "_ranges", "_reader", "_reads", "_writes", "channel",
                 "creator", "timestamp_ms", "tx_id")  # fmt: skip

    def __init__(
        self,
        reader: StateReader,
        namespace: str,
        *,
        channel: str,
        tx_id: str,
        timestamp_ms: int,
        creator: Creator,
    ) -> None:
        self._reader = reader
        self._namespace = namespace
        self.channel = channel
        self.tx_id = tx_id
        self.timestamp_ms = timestamp_ms
        self.creator = creator
        self._reads: dict[str, Version | None] = {}
        self._ranges: list[_RangeCursor] = []
        self._writes: dict[str, bytes | None] = {}
        self._policies: dict[str, bytes] = {}
        self._event: tuple[str, bytes] | None = None
        self._budget = Budget()

    async def get(self, key: str) -> bytes | None:
        """The committed value of a key, or None."""
        check_key(key)
        self._budget.count_read()
        found = self._reader.get(self._namespace, key)
        # The first version seen is the one to be checked; a snapshot shows no other.
        self._reads.setdefault(key, None if found is None else found[1])
        return None if found is None else found[0]

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        """The committed values of these keys, in their order."""
        return [await self.get(key) for key in keys]

    async def put(self, key: str, value: bytes) -> None:
        """Write a key when the transaction is committed; the last write to a key counts."""
        check_key(key)
        check_value(key, value)
        self._write(key, value)

    async def delete(self, key: str) -> None:
        """Delete a key when the transaction is committed."""
        check_key(key)
        self._write(key, None)
        self._policies.pop(key, None)

    async def require_endorsement(self, key: str, msp_ids: Sequence[str]) -> None:
        """Let changes of a key that this transaction has put need peers of all these organisations from then on."""
        self._policies[key] = key_policy(check_endorsers(key, msp_ids, self._writes))

    def range(self, start: str, end: str) -> AsyncIterator[tuple[str, bytes]]:
        """Committed keys from `start` (included) to `end` (excluded) in UTF-8 order; "" leaves a side open."""
        for key in (start, end):
            if key:
                check_key(key)
        start = start or "\x01"
        cursor = _RangeCursor(start, end, self._reader.range(self._namespace, start, end), self._budget.count_read)
        self._ranges.append(cursor)
        return cursor

    async def history(self, key: str) -> AsyncIterator[Modification]:
        """Committed changes of a key, newest first. As on Fabric, they are not checked again at commit."""
        check_key(key)
        for modification in self._reader.history(self._namespace, key):
            self._budget.count_read()
            yield modification

    def set_event(self, name: str, payload: bytes) -> None:
        """The transaction's event; the last one set counts."""
        check_event(name, payload)
        self._event = name, payload

    @property
    def event(self) -> tuple[str, bytes] | None:
        """Name and payload of the event, or None."""
        return self._event

    def result(self) -> ReadWriteSet:
        """What the transaction read and wrote."""
        namespace = self._namespace
        return ReadWriteSet(
            tuple(Read(namespace, key, version) for key, version in self._reads.items()),
            tuple(cursor.record(namespace) for cursor in self._ranges if cursor.started),
            tuple(Write(namespace, key, value) for key, value in self._writes.items()),
            tuple(KeyPolicy(namespace, key, policy) for key, policy in self._policies.items()),
        )

    def _write(self, key: str, value: bytes | None) -> None:
        self._writes[key] = value
        self._budget.count_write(key, value, len(self._writes))


class _RangeCursor:
    """One range being read. It keeps its own record, so that leaving a loop early loses nothing."""

    __slots__ = ("_count", "_end", "_exhausted", "_rows", "_seen", "_start", "started")

    def __init__(
        self, start: str, end: str, rows: Iterator[tuple[str, bytes, Version]], count: Callable[[], None]
    ) -> None:
        self._start = start
        self._end = end
        self._rows = rows
        self._count = count
        self._seen: list[tuple[str, Version]] = []
        self._exhausted = False
        self.started = False

    def __aiter__(self) -> _RangeCursor:
        return self

    async def __anext__(self) -> tuple[str, bytes]:
        self.started = True
        row = next(self._rows, None)
        if row is None:
            self._exhausted = True
            raise StopAsyncIteration
        self._count()
        key, value, version = row
        self._seen.append((key, version))
        return key, value

    def record(self, namespace: str) -> RangeRead:
        """What was seen. Left early, the range ends with the last key seen: nothing beyond it was relied on."""
        end = self._end if self._exhausted else self._seen[-1][0]
        return RangeRead(namespace, self._start, end, self._exhausted, tuple(self._seen))
