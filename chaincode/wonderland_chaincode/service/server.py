"""The contract's gRPC server: ``protos.Chaincode/Connect``, which the peers dial."""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import grpc

from wonderland_chaincode.service.errors import SettingsError, StreamProtocolError
from wonderland_chaincode.service.metrics import Metrics
from wonderland_chaincode.service.settings import Limits
from wonderland_chaincode.service.stream import PeerStream
from wonderland_chaincode.service.tls import Tls
from wonderland_fabric_gateway.addresses import bracketed, split_address

if TYPE_CHECKING:
    from collections.abc import Callable

    from wonderland_fabric_gateway.embedded.contracts import Contract

MAX_MESSAGE_BYTES: Final = 100 << 20
"""What a peer sends and takes at most."""
_OPTIONS: Final[tuple[tuple[str, int], ...]] = (
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
    ("grpc.so_reuseport", 0),  # two services on one port: the second must fail, not share
    # A peer pings an idle stream each minute. Unless that is allowed, the server hangs up on it after three of them.
    ("grpc.http2.min_recv_ping_interval_without_data_ms", 10_000),
    ("grpc.http2.max_ping_strikes", 0),
    ("grpc.keepalive_permit_without_calls", 1),
    # And our own: a peer that vanished without a word (power, network) is noticed.
    ("grpc.keepalive_time_ms", 60_000),
    ("grpc.keepalive_timeout_ms", 20_000),
    ("grpc.http2.max_pings_without_data", 0),
)
_log: Final = logging.getLogger(__name__)


def _wall_clock_ms() -> int:
    return time.time_ns() // 1_000_000


@dataclass
class ContractServer:
    """Serves one contract, under one package id, to any number of peers."""

    contract: Contract
    package_id: str
    tls: Tls | None = None
    limits: Limits = field(default_factory=Limits)
    metrics: Metrics = field(default_factory=Metrics)
    now_ms: Callable[[], int] = _wall_clock_ms
    address: str = ""
    """Where it listens, known after `start`."""
    draining: bool = False
    _streams: set[PeerStream] = field(default_factory=set)
    _server: grpc.aio.Server | None = None

    async def start(self, listen: str) -> str:
        """Listen at ``host:port`` (port 0: any free one) and serve; returns the address with the real port.

        Raises `SettingsError` when it cannot listen there.
        """
        host, port = split_address(listen)
        server = grpc.aio.server(options=_OPTIONS)
        where = f"{bracketed(host)}:{port}"
        try:
            if self.tls is None:
                real_port = server.add_insecure_port(where)
            else:
                real_port = server.add_secure_port(where, self.tls.credentials())
        except RuntimeError as cause:
            raise SettingsError(
                f"cannot listen at {listen}: the port is taken, the address is not this machine's, or it needs rights"
            ) from cause
        handler: grpc.RpcMethodHandler[bytes, bytes] = grpc.stream_stream_rpc_method_handler(self._connect)
        server.add_generic_rpc_handlers(
            (grpc.method_handlers_generic_handler("protos.Chaincode", {"Connect": handler}),)
        )
        await server.start()
        self._server = server
        self.address = f"{bracketed(host)}:{real_port}"
        return self.address

    async def stop(self) -> None:
        """Take nothing new, let the transactions under way end (`Limits.drain_s`), then end the streams."""
        self.draining = True
        if self._server is None:
            return
        server, self._server = self._server, None
        in_flight = sum(stream.in_flight for stream in self._streams)
        if in_flight:
            _log.info("stopping when %d transactions have ended, in %.0f s at most", in_flight, self.limits.drain_s)
        for stream in tuple(self._streams):
            stream.drain()
        await server.stop(self.limits.drain_s)

    @property
    def peers(self) -> tuple[str, ...]:
        """Addresses of the peers that are ready."""
        return tuple(sorted(stream.peer for stream in self._streams if stream.ready))

    @property
    def in_flight(self) -> int:
        """How many transactions run just now, of all peers."""
        return sum(stream.in_flight for stream in self._streams)

    async def _connect(self, _: Any, context: grpc.aio.ServicerContext[bytes, bytes]) -> None:
        """One peer, from its call to its end."""
        peer = context.peer()
        if self.draining or len(self._streams) >= self.limits.max_streams:
            why = "this contract service is stopping" if self.draining else "too many streams are open"
            await context.abort(grpc.StatusCode.UNAVAILABLE, why)

        async def read() -> bytes | None:
            data: object = await context.read()
            return data if isinstance(data, bytes) else None  # grpc.aio.EOF is no bytes

        stream = PeerStream(
            peer,
            read,
            context.write,
            package_id=self.package_id,
            contract=self.contract,
            limits=self.limits,
            metrics=self.metrics,
            now_ms=self.now_ms,
        )
        self._streams.add(stream)
        self.metrics.connections.inc()
        self.metrics.streams.inc()
        _log.info("%s connected", peer)
        try:
            await stream.serve()
        except StreamProtocolError as error:
            self.metrics.protocol_errors.inc()
            _log.warning("%s: %s; its stream ends", peer, error)
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error)[:1024])
        except (grpc.RpcError, grpc.aio.BaseError, asyncio.InvalidStateError) as error:
            _log.info("%s: the stream broke off (%s)", peer, error)
        finally:
            self._streams.discard(stream)
            self.metrics.streams.dec()
            _log.info("%s left", peer)
