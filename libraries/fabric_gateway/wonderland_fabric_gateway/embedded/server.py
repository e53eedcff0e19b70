"""The ledger's gRPC server: gateway.Gateway and protos.Deliver over TLS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import grpc

from wonderland_fabric_gateway.addresses import bracketed, split_address
from wonderland_fabric_gateway.embedded.deliver import DeliverService
from wonderland_fabric_gateway.embedded.endorser import Endorser
from wonderland_fabric_gateway.embedded.errors import DirectoryError
from wonderland_fabric_gateway.embedded.gateway import GatewayService
from wonderland_fabric_gateway.embedded.rpc import both_streams, server_stream, unary
from wonderland_fabric_gateway.embedded.system import SystemQueries
from wonderland_fabric_gateway.embedded.watchdog import DEFAULT_LIMIT_S

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from wonderland_fabric_gateway.ca import CertificateRequest
    from wonderland_fabric_gateway.embedded.chain import Chain
    from wonderland_fabric_gateway.embedded.config_update import SigningIdentity
    from wonderland_fabric_gateway.embedded.contracts import Contract

MAX_REQUEST_BYTES: Final = 16 << 20
"""What the transport takes; proposals (4 MiB) and transactions (10 MiB) have their own limits below it."""
MAX_RESPONSE_BYTES: Final = 100 << 20
_OPTIONS: Final[tuple[tuple[str, int], ...]] = (
    ("grpc.max_receive_message_length", MAX_REQUEST_BYTES),
    ("grpc.max_send_message_length", MAX_RESPONSE_BYTES),
    ("grpc.max_concurrent_streams", 4096),
    ("grpc.so_reuseport", 0),  # two ledgers on one port: the second must fail, not share
    # Clients keep idle event streams alive by pings; without these the server hangs up on them.
    ("grpc.http2.min_recv_ping_interval_without_data_ms", 10_000),
    ("grpc.http2.max_ping_strikes", 0),
    ("grpc.keepalive_permit_without_calls", 1),
)


@dataclass(frozen=True)
class TlsFiles:
    """The server's certificate chain and key (PEM)."""

    certificate: bytes
    key: bytes


class LedgerServer:
    """Serves one chain. `address` is where it listens, known after `start`."""

    def __init__(
        self,
        chain: Chain,
        contracts: Mapping[str, Contract],
        peers: Sequence[SigningIdentity],
        tls: TlsFiles,
        refresh_revocations: Callable[[], Awaitable[int | None]] | None = None,
        execute_limit_s: float = DEFAULT_LIMIT_S,
        enrol: Callable[[str, CertificateRequest, str], Awaitable[bytes]] | None = None,
    ) -> None:
        self._chain = chain
        self._contracts = dict(contracts)
        self._peers = tuple(peers)
        self._tls = tls
        self._refresh = refresh_revocations
        self._enrol = enrol
        self._endorser = Endorser(chain.settings.channel, chain.reader, self._contracts, self._peers, execute_limit_s)
        self._server: grpc.aio.Server | None = None
        self.address = ""

    async def start(self, listen: str) -> str:
        """Listen at ``host:port`` (port 0: any free one) and serve; returns the address with the real port.

        Raises `DirectoryError` when it cannot listen there.
        """
        host, port = split_address(listen)
        server = grpc.aio.server(options=_OPTIONS)
        credentials = grpc.ssl_server_credentials([(self._tls.key, self._tls.certificate)])
        try:
            real_port = server.add_secure_port(f"{bracketed(host)}:{port}", credentials)
        except RuntimeError as cause:
            raise DirectoryError(
                f"cannot listen at {listen}: the port is taken, the address is not this machine's, or it needs rights"
            ) from cause
        self.address = f"{bracketed(host)}:{real_port}"
        system = SystemQueries(self._chain, self._contracts, self._refresh, self._enrol)
        gateway = GatewayService(self._chain, self._endorser, system, self.address)
        deliver = DeliverService(self._chain)
        server.add_generic_rpc_handlers(
            (
                grpc.method_handlers_generic_handler(
                    "gateway.Gateway",
                    {
                        "Evaluate": unary(gateway.evaluate),
                        "Endorse": unary(gateway.endorse),
                        "Submit": unary(gateway.submit),
                        "CommitStatus": unary(gateway.commit_status),
                        "ChaincodeEvents": server_stream(deliver.chaincode_events),
                    },
                ),
                grpc.method_handlers_generic_handler(
                    "protos.Deliver",
                    {
                        "Deliver": both_streams(deliver.deliver),
                        "DeliverFiltered": both_streams(deliver.deliver_filtered),
                        "DeliverWithPrivateData": both_streams(deliver.deliver_with_private_data),
                    },
                ),
            )
        )
        await server.start()
        self._server = server
        return self.address

    async def stop(self, grace_s: float = 0.5) -> None:
        """Take no new calls and end those that run. Close the chain first, so that waiting clients get an answer."""
        if self._server is not None:
            await self._server.stop(grace_s)
            self._server = None
        self._endorser.close()
