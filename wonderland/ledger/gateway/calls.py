"""The Gateway's remote calls: deadlines on each, and every failure as a `GatewayError`."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.gateway import gateway_pb2_grpc
from fabric_protos.peer import events_pb2_grpc
from google.protobuf.message import DecodeError

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
    """Stubs on a channel that the caller owns."""

    def __init__(self, channel: grpc.aio.Channel, deadlines: Deadlines) -> None:
        gateway = gateway_pb2_grpc.GatewayStub(channel)
        deliver = events_pb2_grpc.DeliverStub(channel)
        self.deadlines: Final = deadlines
        self.open_chaincode_events: Final = gateway.ChaincodeEvents
        self.open_deliver: Final = deliver.Deliver
        self.open_deliver_filtered: Final = deliver.DeliverFiltered
        self._evaluate = gateway.Evaluate
        self._endorse = gateway.Endorse
        self._submit = gateway.Submit
        self._commit_status = gateway.CommitStatus

    async def evaluate(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Evaluate: run the contract on one peer, record nothing. Raises `EvaluateError`."""
        return await _call(self._evaluate, request, timeout_s or self.deadlines.evaluate_s, EvaluateError, tx_id)

    async def endorse(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Endorse: gather the signatures that the policy demands. Raises `EndorseError`."""
        return await _call(self._endorse, request, timeout_s or self.deadlines.endorse_s, EndorseError, tx_id)

    async def submit(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """Submit: hand the transaction to the orderer. Raises `SubmitError`."""
        return await _call(self._submit, request, timeout_s or self.deadlines.submit_s, SubmitError, tx_id)

    async def commit_status(self, request: Any, tx_id: str, timeout_s: float | None) -> Any:
        """CommitStatus: wait for the block. Raises `CommitStatusError`."""
        limit = timeout_s or self.deadlines.commit_status_s
        return await _call(self._commit_status, request, limit, CommitStatusError, tx_id)


async def _call(
    method: Callable[..., Any],
    request: Any,
    timeout_s: float,
    error: type[GatewayError],
    tx_id: str,
) -> Any:
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
    except DecodeError as cause:
        raise MalformedError(f"the gateway's answer cannot be read ({cause})", tx_id=tx_id) from cause


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
