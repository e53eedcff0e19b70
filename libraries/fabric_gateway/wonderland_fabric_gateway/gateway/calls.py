"""The Gateway's remote calls: deadlines on each, and every failure as a `GatewayError`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.gateway import gateway_pb2

from wonderland_fabric_gateway.gateway.errors import (
    CommitStatusError,
    EndorseError,
    EvaluateError,
    GatewayError,
    MalformedError,
    SubmitError,
    UnsignedError,
    from_rpc,
)
from wonderland_fabric_gateway.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterator

    from wonderland_fabric_gateway.gateways import Gateways
    from wonderland_fabric_gateway.identity import Identity
    from wonderland_fabric_gateway.signing import Signer


_ASK_ELSEWHERE: Final = frozenset(
    {
        grpc.StatusCode.UNAVAILABLE,
        grpc.StatusCode.DEADLINE_EXCEEDED,
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.INTERNAL,
    }
)


@dataclass(frozen=True, slots=True)
class Deadlines:
    """How long each call may take, in seconds. The defaults are those that Fabric's documentation recommends."""

    evaluate_s: float = 5.0
    endorse_s: float = 15.0
    submit_s: float = 5.0
    commit_status_s: float = 60.0
    locate_s: float = 5.0
    """For finding the transaction or block at which a stream is to continue."""
    resubmit_s: float = 3.0
    """Without an outcome for so long, the same transaction is submitted again; it takes effect once at most."""
    catch_up_s: float = 15.0
    """How long a chain that is shorter than a checkpoint may stand still before it counts as another one."""
    gossip_s: float = 10.0
    """How long peers may need to find the endorsers that the policy demands, after a start or a failure."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}; a deadline is a positive number of seconds")


@dataclass(frozen=True, slots=True)
class Environment:
    """What every stage shares. `now_ns` and `random_bytes` come from outside, so that a test can repeat a run."""

    calls: Calls
    identity: Identity
    signer: Signer | None
    now_ns: Callable[[], int]
    random_bytes: Callable[[int], bytes]
    tls_certificate_sha256: bytes

    def pinned(self) -> Environment:
        """The same with one Gateway."""
        return replace(self, calls=self.calls.pinned())

    def at(self, index: int) -> Environment:
        """The same with that Gateway."""
        return replace(self, calls=self.calls.at(index))

    def sign(self, message: bytes, tx_id: str) -> bytes:
        """A signature over `message`. Raises `UnsignedError` when this gateway has no signer."""
        if self.signer is None:
            raise UnsignedError("this gateway has no signer; sign offline and pass the signature on", tx_id=tx_id)
        return self.signer(message)


class Calls:
    """The methods of Gateways and peers on channels that the caller owns.

    A Gateway that cannot be reached or does not answer is passed over for the next one; none of these calls does
    anything twice by that (a transaction that arrives twice is refused by its id the second time).

    Answers are taken as bytes and parsed here: gRPC's own way with an answer that it cannot parse is a line in the
    log and None.
    """

    def __init__(self, gateways: Gateways, deadlines: Deadlines, only: int | None = None) -> None:
        self.deadlines: Final = deadlines
        self._gateways = gateways
        self._only = only
        self._methods: dict[tuple[int, str], grpc.aio.UnaryUnaryMultiCallable[Any, bytes]] = {}

    @property
    def count(self) -> int:
        """How many Gateways there are to ask."""
        return len(self._gateways) if self._only is None else 1

    def pinned(self) -> Calls:
        """The same by one Gateway, the best one now: what belongs together is asked of one and the same ledger."""
        return self if self._only is not None else Calls(self._gateways, self.deadlines, self._gateways.order()[0])

    def at(self, index: int) -> Calls:
        """The same by that Gateway."""
        return Calls(self._gateways, self.deadlines, index)

    @property
    def others(self) -> list[int]:
        """The Gateways that a pinned one is not."""
        return [index for index in range(len(self._gateways)) if index != self._only]

    def compare_by(self, is_level: Callable[[int, int], Awaitable[bool]]) -> None:
        """Have Gateways that come back be compared with the others by that, unless somebody does already."""
        if len(self._gateways) > 1 and self._gateways.is_level is None:
            self._gateways.is_level = is_level

    async def leave_if_behind(self) -> None:
        """Ask another Gateway first from now on, if the present one's peer has fewer blocks than that one's."""
        is_level, order = self._gateways.is_level, self._gateways.order()
        if self._only is not None or is_level is None or len(order) == 1:
            return
        with contextlib.suppress(GatewayError):
            if not await is_level(order[0], order[1]):
                self._gateways.failed(order[0])

    def pass_over(self, *, behind: bool = False) -> None:
        """The Gateway of a pinned one ended a stream, or is behind: others are better now."""
        if self._only is not None:
            (self._gateways.behind if behind else self._gateways.failed)(self._only)

    def open_chaincode_events(self, request: Any) -> Any:
        """ChaincodeEvents, of one Gateway."""
        return self._channel().unary_stream("/gateway.Gateway/ChaincodeEvents", _to_bytes)(request)

    def open_deliver(self, timeout: float | None = None) -> Any:
        """Deliver, of one peer."""
        return self._channel().stream_stream("/protos.Deliver/Deliver", _to_bytes)(timeout=timeout)

    def open_deliver_filtered(self, timeout: float | None = None) -> Any:
        """DeliverFiltered, of one peer."""
        return self._channel().stream_stream("/protos.Deliver/DeliverFiltered", _to_bytes)(timeout=timeout)

    async def evaluate(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Evaluate: run the contract on one peer, record nothing. Raises `EvaluateError`."""
        limit_s = self.deadlines.evaluate_s if timeout_s is None else timeout_s
        data = await self._anywhere("Evaluate", request, limit_s, EvaluateError, tx_id)
        return decode(gateway_pb2.EvaluateResponse, data, "the gateway's answer", MalformedError)

    async def endorse(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Endorse: gather the signatures that the policy demands. Raises `EndorseError`."""
        limit_s = self.deadlines.endorse_s if timeout_s is None else timeout_s
        data = await self._anywhere("Endorse", request, limit_s, EndorseError, tx_id)
        return decode(gateway_pb2.EndorseResponse, data, "the gateway's answer", MalformedError)

    async def submit(self, request: Any, tx_id: str, timeout_s: float | None) -> None:
        """Submit: hand the transaction to the orderer. Raises `SubmitError`."""
        limit_s = self.deadlines.submit_s if timeout_s is None else timeout_s
        await self._anywhere("Submit", request, limit_s, SubmitError, tx_id)

    async def commit_status(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """CommitStatus: wait for the block. Raises `CommitStatusError`."""
        limit_s = self.deadlines.commit_status_s if timeout_s is None else timeout_s
        # Silence is no failure here: the block may just not have come.
        data = await self._anywhere("CommitStatus", request, limit_s, CommitStatusError, tx_id, patient=True)
        return decode(gateway_pb2.CommitStatusResponse, data, "the gateway's answer", MalformedError)

    async def _anywhere(
        self,
        method: str,
        request: Any,
        limit_s: float,
        error: type[GatewayError],
        tx_id: str,
        *,
        patient: bool = False,
    ) -> bytes:
        """The first answer of a Gateway that can be reached; each has an equal share of the time that is left."""
        order = self._gateways.order() if self._only is None else [self._only]
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + limit_s
        for left, index in zip(range(len(order), 0, -1), order, strict=True):
            share_s = limit_s if len(order) == 1 else max(0.001, (deadline_s - loop.time()) / left)
            try:
                answer = await _call(self._method(index, method), request, share_s, error, tx_id)
            except GatewayError as failure:
                if failure.is_unreached and not (patient and failure.status_code is grpc.StatusCode.DEADLINE_EXCEEDED):
                    self._gateways.failed(index)
                if left == 1 or failure.status_code not in _ASK_ELSEWHERE:
                    raise
            else:
                self._gateways.answered(index)
                return answer
        raise AssertionError("unreachable: the last Gateway answers or fails")

    def _method(self, index: int, name: str) -> grpc.aio.UnaryUnaryMultiCallable[Any, bytes]:
        found = self._methods.get((index, name))
        if found is None:
            found = self._gateways.channel(index).unary_unary(f"/gateway.Gateway/{name}", _to_bytes)
            self._methods[index, name] = found
        return found

    def _channel(self) -> grpc.aio.Channel:
        return self._gateways.channel(self._gateways.order()[0] if self._only is None else self._only)


async def _call(
    method: grpc.aio.UnaryUnaryMultiCallable[Any, bytes],
    request: Any,
    timeout_s: float,
    error: type[GatewayError],
    tx_id: str,
) -> bytes:
    try:
        with unusable_channel_is_an_error(error, tx_id):
            return await method(request, timeout=timeout_s)
    except grpc.aio.AioRpcError as cause:
        raise from_rpc(cause, error, tx_id) from cause
    except asyncio.CancelledError as cause:
        if cancelled_from_outside():
            raise
        # gRPC says the same when the channel is closed under a call; the caller's task goes on.
        raise error("the channel was closed", tx_id=tx_id, status_code=grpc.StatusCode.CANCELLED) from cause


def _to_bytes(message: Any) -> bytes:
    return bytes(message.SerializeToString())


@contextlib.contextmanager
def unusable_channel_is_an_error(error: type[GatewayError], tx_id: str = "") -> Iterator[None]:
    """A channel that its owner closed, or that belongs to another event loop, as a typed error."""
    try:
        yield
    except grpc.aio.UsageError as cause:
        raise error(f"the channel cannot be used: {cause}", tx_id=tx_id) from cause


def cancelled_from_outside() -> bool:
    """Whether the running task itself is being cancelled."""
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


def system_now_ns() -> int:
    """Nanoseconds since the Unix epoch by this machine's clock."""
    return time.time_ns()
