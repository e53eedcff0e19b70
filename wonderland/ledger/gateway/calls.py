"""The Gateway's remote calls: deadlines on each, and every failure as a `GatewayError`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.gateway import gateway_pb2

from wonderland.ledger.gateway.errors import (
    CommitStatusError,
    EndorseError,
    EvaluateError,
    GatewayError,
    MalformedError,
    SubmitError,
    UnsignedError,
    from_rpc,
)
from wonderland.ledger.protobuf import decode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from wonderland.ledger.identity import Identity
    from wonderland.ledger.signing import Signer


@dataclass(frozen=True, slots=True)
class Deadlines:
    """How long each call may take, in seconds. The defaults are those that Fabric's documentation recommends."""

    evaluate_s: float = 5.0
    endorse_s: float = 15.0
    submit_s: float = 5.0
    commit_status_s: float = 60.0
    locate_s: float = 5.0
    """For finding the transaction or block at which a stream is to continue."""

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

    def sign(self, message: bytes, tx_id: str) -> bytes:
        """A signature over `message`. Raises `UnsignedError` when this gateway has no signer."""
        if self.signer is None:
            raise UnsignedError("this gateway has no signer; sign offline and pass the signature on", tx_id=tx_id)
        return self.signer(message)


class Calls:
    """The methods of a Gateway and a peer on a channel that the caller owns.

    Answers are taken as bytes and parsed here: gRPC's own way with an answer that it cannot parse is a line in the
    log and None.
    """

    def __init__(self, channel: grpc.aio.Channel, deadlines: Deadlines) -> None:
        self.deadlines: Final = deadlines

        def unary(name: str) -> grpc.aio.UnaryUnaryMultiCallable[Any, bytes]:
            return channel.unary_unary(f"/gateway.Gateway/{name}", _to_bytes)

        def both_streams(name: str) -> grpc.aio.StreamStreamMultiCallable[Any, bytes]:
            return channel.stream_stream(f"/protos.Deliver/{name}", _to_bytes)

        events: grpc.aio.UnaryStreamMultiCallable[Any, bytes] = channel.unary_stream(
            "/gateway.Gateway/ChaincodeEvents", _to_bytes
        )
        self.open_chaincode_events: Final = events
        self.open_deliver: Final = both_streams("Deliver")
        self.open_deliver_filtered: Final = both_streams("DeliverFiltered")
        self._evaluate = unary("Evaluate")
        self._endorse = unary("Endorse")
        self._submit = unary("Submit")
        self._commit_status = unary("CommitStatus")

    async def evaluate(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Evaluate: run the contract on one peer, record nothing. Raises `EvaluateError`."""
        limit_s = self.deadlines.evaluate_s if timeout_s is None else timeout_s
        data = await _call(self._evaluate, request, limit_s, EvaluateError, tx_id)
        return decode(gateway_pb2.EvaluateResponse, data, "the gateway's answer", MalformedError)

    async def endorse(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Endorse: gather the signatures that the policy demands. Raises `EndorseError`."""
        limit_s = self.deadlines.endorse_s if timeout_s is None else timeout_s
        data = await _call(self._endorse, request, limit_s, EndorseError, tx_id)
        return decode(gateway_pb2.EndorseResponse, data, "the gateway's answer", MalformedError)

    async def submit(self, request: Any, tx_id: str, timeout_s: float | None) -> None:
        """Submit: hand the transaction to the orderer. Raises `SubmitError`."""
        limit_s = self.deadlines.submit_s if timeout_s is None else timeout_s
        await _call(self._submit, request, limit_s, SubmitError, tx_id)

    async def commit_status(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """CommitStatus: wait for the block. Raises `CommitStatusError`."""
        limit_s = self.deadlines.commit_status_s if timeout_s is None else timeout_s
        data = await _call(self._commit_status, request, limit_s, CommitStatusError, tx_id)
        return decode(gateway_pb2.CommitStatusResponse, data, "the gateway's answer", MalformedError)


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
