"""The contract's view of the ledger during one transaction, as a Fabric peer answers it over its stream.

The same as the embedded ledger's (``embedded.stub``): reads show the committed state and never the
transaction's own writes, the last write to a key counts, and the limits are those of ``contract_rules``. Writes are
kept back until the contract has ended, so that one that refuses costs the peer nothing; they then go in batches.
Source: ``peer/chaincode_shim.proto``; Fabric ``core/chaincode/handler.go``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar

from fabric_protos.ledger.queryresult import kv_query_result_pb2
from fabric_protos.peer import chaincode_shim_pb2 as shim

from wonderland_chaincode.service.errors import StreamProtocolError
from wonderland_fabric_gateway.contract_rules import Budget, check_endorsers, check_event, check_key, check_value
from wonderland_fabric_gateway.embedded.proposals import timestamp_ms
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_gateway.signature_policies import VALIDATION_PARAMETER, key_policy

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Sequence

    from wonderland_chaincode.service.facts import Facts
    from wonderland_fabric_gateway.embedded.msp import Creator

MAX_BATCH_BYTES: Final = 16 << 20
DEFAULT_BATCH_COUNT: Final = 100
_EMPTY_START: Final = "\x01"
"""What an open start means: the keys below it are those of composite keys, a namespace of their own."""

T = TypeVar("T")


class Ask(Protocol):
    """One question to the peer; the payload of its answer. Raises `PeerRefusedError`."""

    def __call__(self, kind: int, body: bytes) -> Awaitable[bytes]:
        """Send a message of this type with this payload, and wait for what comes back."""


@dataclass(frozen=True, slots=True)
class Batching:
    """What the peer takes at once: so many writes, or reads, in one message; 1 where it knows no batches."""

    max_count: int = 1
    max_reads: int = 1


@dataclass(frozen=True, slots=True)
class Modification:
    """One change of a key; see ``wonderland_chaincode.stub.Modification``."""

    tx_id: str
    timestamp_ms: int
    value: bytes
    is_delete: bool


class PeerStub:
    """One transaction's stub; see ``wonderland_chaincode.stub.Stub``."""

    __slots__ = ("_ask", "_batching", "_budget", "_facts", "_policies", "_writes", "event")

    def __init__(self, facts: Facts, ask: Ask, batching: Batching) -> None:
        self._facts = facts
        self._ask = ask
        self._batching = batching
        self._budget = Budget()
        self._writes: dict[str, bytes | None] = {}
        self._policies: dict[str, bytes] = {}
        self.event: tuple[str, bytes] | None = None

    @property
    def channel(self) -> str:
        """Name of the channel."""
        return self._facts.channel

    @property
    def tx_id(self) -> str:
        """The transaction's id: 64 hexadecimal digits."""
        return self._facts.tx_id

    @property
    def timestamp_ms(self) -> int:
        """The transaction's time, milliseconds since the Unix epoch."""
        return self._facts.timestamp_ms

    @property
    def creator(self) -> Creator:
        """Who signed the proposal: organisation, role and id from the certificate."""
        return self._facts.creator

    async def get(self, key: str) -> bytes | None:
        """The committed value of a key, or None."""
        check_key(key)
        self._budget.count_read()
        return await self._ask(shim.ChaincodeMessage.GET_STATE, shim.GetState(key=key).SerializeToString()) or None

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        """The committed values of these keys, in their order; in as few questions as the peer allows."""
        most = self._batching.max_reads
        if most <= 1 or len(keys) == 1:
            return [await self.get(key) for key in keys]
        values: list[bytes | None] = []
        for key in keys:
            check_key(key)
            self._budget.count_read()
        for first in range(0, len(keys), most):
            some = keys[first : first + most]
            question = shim.GetStateMultiple(keys=some).SerializeToString()
            answer = await self._ask(shim.ChaincodeMessage.GET_STATE_MULTIPLE, question)
            found = _decode(shim.GetStateMultipleResult, answer, "values of several keys").values
            if len(found) != len(some):
                raise StreamProtocolError(f"{len(found)} values came for {len(some)} keys")
            values += [value or None for value in found]
        return values

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
        question = shim.GetStateByRange(startKey=start or _EMPTY_START, endKey=end).SerializeToString()
        return _Pages(self._ask, shim.ChaincodeMessage.GET_STATE_BY_RANGE, question, _key_value, self._budget)

    def history(self, key: str) -> AsyncIterator[Modification]:
        """Committed changes of a key, newest first."""
        check_key(key)
        question = shim.GetHistoryForKey(key=key).SerializeToString()
        return _Pages(self._ask, shim.ChaincodeMessage.GET_HISTORY_FOR_KEY, question, _modification, self._budget)

    def set_event(self, name: str, payload: bytes) -> None:
        """The transaction's event; the last one set counts."""
        check_event(name, payload)
        self.event = name, payload

    async def flush(self) -> None:
        """Tell the peer what was written. Called once, when the contract has ended well."""
        records = [_record(key, value) for key, value in self._writes.items()]
        records += [_policy_record(key, policy) for key, policy in self._policies.items()]
        if self._batching.max_count <= 1 or len(records) == 1:
            for record in records:
                await self._send_one(record)
            return
        for batch in _batches(records, self._batching.max_count):
            body = shim.WriteBatchState(rec=batch).SerializeToString()
            await self._ask(shim.ChaincodeMessage.WRITE_BATCH_STATE, body)

    def _write(self, key: str, value: bytes | None) -> None:
        self._writes[key] = value
        self._budget.count_write(key, value, len(self._writes))

    async def _send_one(self, record: Any) -> None:
        if record.type == shim.WriteRecord.DEL_STATE:
            await self._ask(shim.ChaincodeMessage.DEL_STATE, shim.DelState(key=record.key).SerializeToString())
        elif record.type == shim.WriteRecord.PUT_STATE_METADATA:
            body = shim.PutStateMetadata(key=record.key, metadata=record.metadata).SerializeToString()
            await self._ask(shim.ChaincodeMessage.PUT_STATE_METADATA, body)
        else:
            body = shim.PutState(key=record.key, value=record.value).SerializeToString()
            await self._ask(shim.ChaincodeMessage.PUT_STATE, body)


class _Pages(Generic[T]):
    """Results of one query, fetched page by page. A query left before its end is closed by the peer in the end."""

    __slots__ = ("_ask", "_budget", "_item", "_kind", "_more", "_page", "_query_id", "_question")

    def __init__(self, ask: Ask, kind: int, question: bytes, item: Callable[[bytes], T], budget: Budget) -> None:
        self._ask = ask
        self._kind = kind
        self._question = question
        self._item = item
        self._budget = budget
        self._page: list[bytes] = []
        """What is left of the page, last result first."""
        self._more = True
        self._query_id = ""

    def __aiter__(self) -> _Pages[T]:
        return self

    async def __anext__(self) -> T:
        while not self._page:
            if not self._more:
                raise StopAsyncIteration
            await self._fetch()
        self._budget.count_read()
        return self._item(self._page.pop())

    async def aclose(self) -> None:
        """Let the peer forget the query now instead of when the transaction ends."""
        self._page.clear()
        more, self._more = self._more, False
        if more and self._query_id:
            body = shim.QueryStateClose(id=self._query_id).SerializeToString()
            await self._ask(shim.ChaincodeMessage.QUERY_STATE_CLOSE, body)

    async def _fetch(self) -> None:
        if self._query_id:
            body = shim.QueryStateNext(id=self._query_id).SerializeToString()
            answer = await self._ask(shim.ChaincodeMessage.QUERY_STATE_NEXT, body)
        else:
            answer = await self._ask(self._kind, self._question)
        response = _decode(shim.QueryResponse, answer, "query response")
        if response.has_more and not (response.id and response.results):
            raise StreamProtocolError("query response: more is promised, but nothing to ask for it by, or nothing came")
        self._page = [result.resultBytes for result in reversed(response.results)]
        self._more = response.has_more
        self._query_id = response.id


def _key_value(data: bytes) -> tuple[str, bytes]:
    found = _decode(kv_query_result_pb2.KV, data, "range result")
    return found.key, found.value


def _modification(data: bytes) -> Modification:
    found = _decode(kv_query_result_pb2.KeyModification, data, "history result")
    try:
        time_ms = timestamp_ms(found.timestamp)
    except LedgerError as cause:
        raise StreamProtocolError(f"history result: {cause}") from cause
    return Modification(found.tx_id, time_ms, found.value, found.is_delete)


def _record(key: str, value: bytes | None) -> Any:
    if value is None:
        return shim.WriteRecord(key=key, type=shim.WriteRecord.DEL_STATE)
    return shim.WriteRecord(key=key, value=value, type=shim.WriteRecord.PUT_STATE)


def _policy_record(key: str, policy: bytes) -> Any:
    metadata = shim.StateMetadata(metakey=VALIDATION_PARAMETER, value=policy)
    return shim.WriteRecord(key=key, metadata=metadata, type=shim.WriteRecord.PUT_STATE_METADATA)


def _batches(records: list[Any], max_count: int) -> list[list[Any]]:
    """As few batches as the peer's count and the message's size allow."""
    batches: list[list[Any]] = []
    room = 0
    for record in records:
        size = len(record.key) * 4 + len(record.value) + len(record.metadata.value)
        if not batches or len(batches[-1]) >= max_count or size > room:
            batches.append([])
            room = MAX_BATCH_BYTES
        batches[-1].append(record)
        room -= size
    return batches


def _decode(message_type: Any, data: bytes, what: str) -> Any:
    return decode(message_type, data, what, StreamProtocolError)
