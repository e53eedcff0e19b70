"""The contract's view of the ledger during one transaction: committed state in, read-write set out.

Reads see the state of one block and never the transaction's own writes, as on Fabric. Every read is recorded with the
version found, every range with all that it showed, so that the commit can tell whether it would read the same.
No awaitable of this stub ever suspends.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.contract_rules import Budget, check_endorsers, check_event, check_key, check_value
from wonderland_fabric_gateway.embedded.rwset import KeyPolicy, RangeRead, Read, ReadWriteSet, Write
from wonderland_fabric_gateway.signature_policies import key_policy

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator, Sequence

    from wonderland_fabric_gateway.embedded.msp import Creator
    from wonderland_fabric_gateway.embedded.range_reads import Version
    from wonderland_fabric_gateway.embedded.state import Modification, StateReader

PAGE_ROWS: Final = 100
"""Rows of a range that a Fabric peer hands over at once; it takes one more, to know whether another page follows."""


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
    """One range being read. It keeps its own record, so that leaving a loop early loses nothing.

    Rows are taken in pages, as a Fabric peer hands them to its contract, and what was taken counts as read although
    the contract may not have looked at it.
    """

    __slots__ = ("_ahead", "_count", "_end", "_exhausted", "_page", "_rows", "_seen", "_start", "started")

    def __init__(
        self, start: str, end: str, rows: Iterator[tuple[str, bytes, Version]], count: Callable[[], None]
    ) -> None:
        self._start = start
        self._end = end
        self._rows = rows
        self._count = count
        self._seen: list[tuple[str, Version]] = []
        self._page: deque[tuple[str, bytes]] = deque()
        self._ahead: tuple[str, bytes] | None = None
        """The row by which it is known that another page follows."""
        self._exhausted = False
        self.started = False

    def __aiter__(self) -> _RangeCursor:
        return self

    async def __anext__(self) -> tuple[str, bytes]:
        self.started = True
        if not self._page and not self._exhausted:
            self._fetch()
        if not self._page:
            raise StopAsyncIteration
        self._count()
        return self._page.popleft()

    def record(self, namespace: str) -> RangeRead:
        """What was taken. Left early, the range ends with the last key taken: nothing beyond it was relied on."""
        end = self._end if self._exhausted or not self._seen else self._seen[-1][0]
        return RangeRead(namespace, self._start, end, self._exhausted, tuple(self._seen))

    def _fetch(self) -> None:
        if self._ahead is not None:
            self._page.append(self._ahead)
            self._ahead = None
        for key, value, version in self._rows:
            self._seen.append((key, version))
            if len(self._page) == PAGE_ROWS:
                self._ahead = key, value
                return
            self._page.append((key, value))
        self._exhausted = True
