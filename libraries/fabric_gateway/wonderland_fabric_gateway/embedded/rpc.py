"""Answers over gRPC: one error type with Fabric's details, and handlers that turn every failure into an answer."""

from __future__ import annotations

import contextlib
import logging
import secrets
from typing import TYPE_CHECKING, Any, Final

import grpc
from fabric_protos.gateway import gateway_pb2
from google.protobuf import any_pb2
from google.rpc import status_pb2

from wonderland_fabric_gateway.embedded.errors import (
    AccessDeniedError,
    LedgerCorruptedError,
    LedgerOverloadedError,
    LedgerUnavailableError,
    MalformedRequestError,
    ProposalRefusedError,
)
from wonderland_fabric_gateway.errors import LedgerError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Sequence

DETAILS_KEY: Final = "grpc-status-details-bin"
MAX_MESSAGE_BYTES: Final = 1024
MAX_DETAIL_BYTES: Final = 2048
"""Error texts travel in HTTP/2 trailers, for which clients accept 8 KiB in all."""
_log: Final = logging.getLogger(__name__)


class RpcError(LedgerError):
    """An answer that is a gRPC status. `details` are (address, MSP id, text), as Fabric attaches them."""

    def __init__(self, code: grpc.StatusCode, message: str, details: Sequence[tuple[str, str, str]] = ()) -> None:
        super().__init__(message)
        self.code = code
        self.message = _shorten(message, MAX_MESSAGE_BYTES)
        self.details = tuple(details)

    def trailers(self) -> tuple[tuple[str, bytes], ...]:
        """The trailing metadata that carries the details."""
        if not self.details:
            return ()
        status = status_pb2.Status(code=self.code.value[0], message=self.message)
        for address, msp_id, text in self.details:
            detail = gateway_pb2.ErrorDetail(
                address=address, msp_id=msp_id, message=_shorten(text, MAX_DETAIL_BYTES // len(self.details))
            )
            # Packed by hand: Any.Pack of the pure protobuf API checks types that the generated stubs do not have.
            status.details.append(
                any_pb2.Any(type_url="type.googleapis.com/gateway.ErrorDetail", value=detail.SerializeToString())
            )
        return ((DETAILS_KEY, status.SerializeToString()),)


def unary(method: Callable[[bytes], Awaitable[bytes]]) -> grpc.RpcMethodHandler[bytes, bytes]:
    """A handler for one request and one response, both as bytes."""

    async def handle(request: bytes, context: grpc.aio.ServicerContext[bytes, bytes]) -> bytes:
        try:
            return await method(request)
        except Exception as error:
            await _abort(context, as_rpc_error(error))
            raise  # not reached: abort raises

    return grpc.unary_unary_rpc_method_handler(handle)


def server_stream(method: Callable[[bytes], AsyncIterator[bytes]]) -> grpc.RpcMethodHandler[bytes, bytes]:
    """A handler for one request and a stream of responses. The headers are sent when the stream is ready.

    The method's first item is not a response but marks that readiness; it must be empty.
    """

    async def handle(request: bytes, context: grpc.aio.ServicerContext[bytes, bytes]) -> AsyncIterator[bytes]:
        try:
            async with contextlib.aclosing(method(request)) as items:  # type: ignore[type-var]
                await anext(items)
                await context.send_initial_metadata(())
                async for item in items:
                    yield item
        except Exception as error:  # noqa: BLE001 - every failure is an answer
            await _abort(context, as_rpc_error(error))

    return grpc.unary_stream_rpc_method_handler(handle)


def both_streams(
    method: Callable[[AsyncIterator[bytes]], AsyncIterator[bytes]],
) -> grpc.RpcMethodHandler[bytes, bytes]:
    """A handler for a stream of requests and a stream of responses."""

    async def handle(
        requests: AsyncIterator[bytes], context: grpc.aio.ServicerContext[bytes, bytes]
    ) -> AsyncIterator[bytes]:
        try:
            async with contextlib.aclosing(method(requests)) as items:  # type: ignore[type-var]
                async for item in items:
                    yield item
        except Exception as error:  # noqa: BLE001 - every failure is an answer
            await _abort(context, as_rpc_error(error))

    return grpc.stream_stream_rpc_method_handler(handle)


def as_rpc_error(error: Exception) -> RpcError:
    """The gRPC status for an error. What nobody foresaw goes to the log and leaves as a reference number."""
    if isinstance(error, RpcError):
        return error
    for kind, code in _CODES:
        if isinstance(error, kind):
            return RpcError(code, str(error))
    reference = secrets.token_hex(4)
    _log.error("request failed (reference %s)", reference, exc_info=error)
    return RpcError(grpc.StatusCode.INTERNAL, f"the ledger failed (reference {reference}); its log says why")


_CODES: Final[tuple[tuple[type[Exception], grpc.StatusCode], ...]] = (
    (MalformedRequestError, grpc.StatusCode.INVALID_ARGUMENT),
    (AccessDeniedError, grpc.StatusCode.PERMISSION_DENIED),
    (ProposalRefusedError, grpc.StatusCode.FAILED_PRECONDITION),
    (LedgerOverloadedError, grpc.StatusCode.RESOURCE_EXHAUSTED),
    (LedgerCorruptedError, grpc.StatusCode.UNAVAILABLE),
    (LedgerUnavailableError, grpc.StatusCode.UNAVAILABLE),
)


async def _abort(context: grpc.aio.ServicerContext[Any, Any], error: RpcError) -> None:
    await context.abort(error.code, error.message, error.trailers())


def _shorten(text: str, limit_bytes: int) -> str:
    data = text.encode(errors="replace")
    if len(data) <= limit_bytes:
        return data.decode()
    return data[: limit_bytes - 3].decode(errors="ignore") + "…"
