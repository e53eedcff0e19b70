"""One peer's stream: registration, then many transactions at once, each with at most one question in flight.

The bytes come and go by two functions, so that this is tested without a network. Source: Fabric
``core/chaincode/handler.go`` (the peer's side), ``peer/chaincode_shim.proto``.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from typing import TYPE_CHECKING, Any, Final

from fabric_protos.peer import chaincode_pb2
from fabric_protos.peer import chaincode_shim_pb2 as shim

from wonderland_chaincode.service.errors import (
    ContractFaultError,
    PeerRefusedError,
    StreamProtocolError,
    UnavailableError,
)
from wonderland_chaincode.service.invocation import failed, invoke
from wonderland_chaincode.service.stub import DEFAULT_BATCH_COUNT, Batching
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from wonderland_chaincode.service.facts import Facts
    from wonderland_chaincode.service.metrics import Metrics
    from wonderland_chaincode.service.settings import Limits
    from wonderland_fabric_gateway.embedded.contracts import Contract

MAX_QUOTED: Final = 300
_log: Final = logging.getLogger(__name__)
_M: Final = shim.ChaincodeMessage
_Key = tuple[str, str]


class PeerStream:
    """Serves the contract to one peer. `serve` runs until the peer leaves or, after `drain`, nothing is under way."""

    def __init__(
        self,
        peer: str,
        read: Callable[[], Awaitable[bytes | None]],
        write: Callable[[bytes], Awaitable[None]],
        *,
        package_id: str,
        contract: Contract,
        limits: Limits,
        metrics: Metrics,
        now_ms: Callable[[], int],
    ) -> None:
        """`read` gives one message, or None at the end of the stream; `write` is called for one at a time."""
        self.peer = peer
        self.ready = False
        self._read = read
        self._write = write
        self._package_id = package_id
        self._contract = contract
        self._limits = limits
        self._metrics = metrics
        self._now_ms = now_ms
        self._batching = Batching()
        self._outgoing: asyncio.Queue[Any] = asyncio.Queue()
        self._asked: dict[_Key, asyncio.Future[bytes]] = {}
        self._running: dict[_Key, asyncio.Task[None]] = {}
        self._draining = False
        self._drained = asyncio.Event()

    async def serve(self) -> None:
        """Register with the peer and run its transactions. Raises `StreamProtocolError` for a peer that is none."""
        writing = asyncio.create_task(self._write_all(), name=f"write to {self.peer}")
        reading = asyncio.create_task(self._read_all(), name=f"read from {self.peer}")
        drained: asyncio.Task[Any] = asyncio.create_task(self._drained.wait())
        try:
            await asyncio.wait((reading, writing, drained), return_when=asyncio.FIRST_COMPLETED)
            for task in (writing, reading):
                if task.done():
                    task.result()
        finally:
            self.ready = False
            ending = (reading, drained, *self._running.values())
            for task in ending:
                task.cancel()
            await asyncio.gather(*ending, return_exceptions=True)
            await self._end_writing(writing, flush=self._drained.is_set())

    def drain(self) -> None:
        """Take no more transactions, and end when those under way have their answers."""
        self._draining = True
        self._end_if_drained()

    @property
    def in_flight(self) -> int:
        """How many transactions of this peer run just now."""
        return len(self._running)

    async def _write_all(self) -> None:
        while (message := await self._outgoing.get()) is not None:
            await self._write(message.SerializeToString())

    async def _end_writing(self, writing: asyncio.Task[None], *, flush: bool) -> None:
        """End the writer between two messages: a call with a write under way can be given no status any more."""
        while not flush and not self._outgoing.empty():
            self._outgoing.get_nowait()
        self._outgoing.put_nowait(None)
        try:
            await asyncio.wait((writing,), timeout=self._limits.answer_s)
        finally:
            writing.cancel()

    def _send(self, message: Any) -> None:
        self._outgoing.put_nowait(message)

    @property
    def _stuck(self) -> bool:
        """Whether the peer asks for more than it takes: answers of ours lie here that it does not read."""
        return self._outgoing.qsize() > 2 * self._limits.max_in_flight + 100

    async def _read_all(self) -> None:
        try:
            async with asyncio.timeout(self._limits.handshake_s):
                if not await self._handshake():
                    return
        except TimeoutError:
            raise StreamProtocolError(f"not registered after {self._limits.handshake_s:.0f} s") from None
        self.ready = True
        batching = self._batching
        _log.info("%s is ready, batches of %d writes, %d reads", self.peer, batching.max_count, batching.max_reads)
        while (message := await self._next()) is not None:
            self._dispatch(message)
            if self._stuck:
                raise StreamProtocolError("the peer does not read what it asked for")

    async def _next(self) -> Any:
        data = await self._read()
        return None if data is None else decode(_M, data, "message of the peer", StreamProtocolError)

    async def _handshake(self) -> bool:
        """Whether the peer took the registration; False when it hung up instead."""
        identity = chaincode_pb2.ChaincodeID(name=self._package_id)
        self._send(_M(type=_M.REGISTER, payload=identity.SerializeToString()))
        for expected in (_M.REGISTERED, _M.READY):
            message = await self._next()
            while message is not None and message.type == _M.KEEPALIVE:
                self._send(message)
                message = await self._next()
            if message is None:
                _log.warning("%s hung up before it was ready; does it have a package %s?", self.peer, self._package_id)
                return False
            if message.type != expected:
                raise StreamProtocolError(
                    f"{_name(message.type)} came where {_name(expected)} should: {_quoted(message.payload)}"
                )
            if expected == _M.READY:
                self._batching = _batching(message.payload)
        return True

    def _dispatch(self, message: Any) -> None:
        kind = message.type
        if kind in {_M.RESPONSE, _M.ERROR}:
            self._answered(message)
        elif kind in {_M.TRANSACTION, _M.INIT}:
            self._begin(message)
        elif kind == _M.KEEPALIVE:
            self._send(message)
        else:
            self._metrics.unexpected.inc()
            _log.warning("%s sent %s, which this service does not know; ignored", self.peer, _name(kind))

    def _answered(self, message: Any) -> None:
        future = self._asked.get((message.channel_id, message.txid))
        if future is None or future.done():
            # An answer to a question that was given up, or to none.
            self._metrics.unexpected.inc()
            _log.debug("%s answered what nobody asks (transaction %s)", self.peer, message.txid[:64])
        elif message.type == _M.RESPONSE:
            future.set_result(message.payload)
        else:
            future.set_exception(PeerRefusedError(_quoted(message.payload)))

    def _begin(self, message: Any) -> None:
        key = (message.channel_id, message.txid)
        if key in self._running:
            # An answer would be taken for that of the first.
            self._metrics.unexpected.inc()
            _log.warning("%s sent transaction %s again while it runs; ignored", self.peer, message.txid[:64])
        elif self._draining:
            self._send(failed(message, "this contract service is stopping; another peer can endorse, or try again"))
        elif len(self._running) >= self._limits.max_in_flight:
            self._metrics.finished("", "unavailable", 0.0)
            self._send(failed(message, f"{len(self._running)} transactions are under way here; try again"))
        else:
            self._running[key] = asyncio.create_task(self._run(key, message))

    async def _run(self, key: _Key, message: Any) -> None:
        started = time.perf_counter()
        self._metrics.in_flight.inc()

        async def ask(kind: int, body: bytes) -> bytes:
            return await self._ask(key, kind, body)

        try:
            outcome = await invoke(
                message, self._contract, ask, lambda: self._asked.get(key), self._batching, self._check_time
            )
            self._send(outcome.message)
            took_s = time.perf_counter() - started
            self._metrics.finished(outcome.function, outcome.word, took_s)
            # %r: the function's name is the client's word.
            _log.debug(
                "transaction %s: %.64r %s in %.1f ms", key[1][:64], outcome.function, outcome.word, took_s * 1000
            )
        finally:
            self._metrics.in_flight.dec()
            del self._running[key]
            self._end_if_drained()

    async def _ask(self, key: _Key, kind: int, body: bytes) -> bytes:
        if asyncio.current_task() is not self._running.get(key):
            # It could come while another question is in flight, which a peer drops, or after the answer.
            raise ContractFaultError("the contract uses its stub from a task of its own")
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[bytes] = loop.create_future()
        self._asked[key] = answer
        deadline = loop.call_later(self._limits.answer_s, _give_up, answer, kind, self._limits.answer_s)
        asked = time.perf_counter()
        self._send(_M(type=kind, payload=body, channel_id=key[0], txid=key[1]))
        try:
            return await answer
        finally:
            deadline.cancel()
            del self._asked[key]
            self._metrics.asked(_name(kind), time.perf_counter() - asked)

    def _check_time(self, facts: Facts) -> None:
        """The contract judges freshness by the client's clock; no organisation has to take that on a peer's word."""
        behind_ms = self._now_ms() - facts.timestamp_ms
        if abs(behind_ms) > self._limits.time_window_s * 1000:
            where = "behind" if behind_ms > 0 else "ahead of"
            raise UnavailableError(
                f"the transaction's time is {abs(behind_ms) // 1000} s {where} this organisation's clock, more than "
                f"{self._limits.time_window_s:.0f} s; set the client's clock, or this machine's"
            )

    def _end_if_drained(self) -> None:
        if self._draining and not self._running:
            self._drained.set()


def _give_up(answer: asyncio.Future[bytes], kind: int, after_s: float) -> None:
    if not answer.done():
        answer.set_exception(PeerRefusedError(f"no answer to {_name(kind)} in {after_s:.0f} s"))


def _batching(payload: bytes) -> Batching:
    offered = decode(chaincode_pb2.ChaincodeAdditionalParams, payload, "parameters of the peer", StreamProtocolError)
    return Batching(
        max_count=(offered.max_size_write_batch or DEFAULT_BATCH_COUNT) if offered.use_write_batch else 1,
        max_reads=(offered.max_size_get_multiple_keys or DEFAULT_BATCH_COUNT) if offered.use_get_multiple_keys else 1,
    )


def _name(kind: int) -> str:
    with contextlib.suppress(ValueError):
        return str(_M.Type.Name(kind))
    return f"message type {kind}"


def _quoted(payload: bytes) -> str:
    text = payload[:MAX_QUOTED].decode(errors="replace")
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text)
