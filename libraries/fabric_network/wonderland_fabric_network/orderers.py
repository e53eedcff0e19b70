"""Orderers: joining them to a channel, asking how they do, and sending them changes of its configuration.

Sources: Fabric "Channel participation API" (REST with client certificates), ``orderer.AtomicBroadcast``.
"""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Self

import grpc
import httpx
from fabric_protos.common import common_pb2
from fabric_protos.orderer import ab_pb2

from wonderland_fabric_gateway.connection import CHANNEL_OPTIONS, ClientTls
from wonderland_fabric_gateway.protobuf import decode
from wonderland_fabric_network.errors import DirectoryStateError, RefusedError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from wonderland_fabric_network.layout import IdentityPaths

TIMEOUT_S: Final = 20.0
_MAX_ANSWER_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class OrdererStatus:
    """An orderer's part in a channel. `relation` is consenter, follower or other."""

    height: int
    status: str
    relation: str


class OrdererAdmin:
    """One orderer's channel participation API. Use as an asynchronous context.

    `client` is a TLS certificate that the orderer takes for an administrator's.
    """

    def __init__(self, component: str, address: str, tls_root: Path, client: IdentityPaths) -> None:
        self.component: Final = component
        try:
            context = ssl.create_default_context(cafile=str(tls_root))
            context.load_cert_chain(client.certificate, client.key)
        except (OSError, ssl.SSLError) as cause:
            raise DirectoryStateError(f"{component}: TLS files {tls_root}, {client.certificate}: {cause}") from cause
        self._http = httpx.AsyncClient(
            base_url=f"https://{address}", verify=context, trust_env=False, timeout=TIMEOUT_S
        )

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._http.aclose()

    async def status(self, channel: str) -> OrdererStatus | None:
        """Its part in a channel; None when it has not joined it. Raises `UnreachableError`, `RefusedError`."""
        response = await self._send(self._http.build_request("GET", f"/participation/v1/channels/{channel}"))
        if response.status_code == httpx.codes.NOT_FOUND:
            return None
        answer = self._json(response, httpx.codes.OK)
        return OrdererStatus(
            int(answer.get("height", 0)), str(answer.get("status", "")), str(answer.get("consensusRelation", ""))
        )

    async def join(self, block: bytes) -> None:
        """Join the channel whose configuration block this is. Raises `UnreachableError`, `RefusedError`."""
        files = {"config-block": ("config.block", block)}
        response = await self._send(self._http.build_request("POST", "/participation/v1/channels", files=files))
        if response.status_code == httpx.codes.METHOD_NOT_ALLOWED:  # its way to say: joined already
            return
        self._json(response, httpx.codes.CREATED)

    async def _send(self, request: httpx.Request) -> httpx.Response:
        try:
            return await self._http.send(request)
        except httpx.HTTPError as cause:
            raise UnreachableError(f"{self.component}: no answer ({str(cause) or type(cause).__name__})") from cause

    def _json(self, response: httpx.Response, expected: int) -> dict[str, Any]:
        try:
            answer = response.json() if len(response.content) <= _MAX_ANSWER_BYTES else None
        except (ValueError, RecursionError):
            answer = None
        if response.status_code != expected or not isinstance(answer, dict):
            text = answer.get("error") if isinstance(answer, dict) else response.text[:300]
            raise RefusedError(f"{self.component}: {response.status_code} {text}", response.status_code)
        return answer


class Broadcast:
    """An orderer's Broadcast service. Use as an asynchronous context. `client` is a TLS certificate that it takes."""

    def __init__(self, component: str, address: str, tls_root: bytes, client: IdentityPaths) -> None:
        self.component: Final = component
        shown = ClientTls(client.certificate, client.key)
        credentials = grpc.ssl_channel_credentials(tls_root, shown.key_pem(), shown.certificate_pem())
        self._channel = grpc.aio.secure_channel(address, credentials, options=list(CHANNEL_OPTIONS))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._channel.close()

    async def send(self, envelope: bytes, *, timeout_s: float = TIMEOUT_S) -> None:
        """Hand an envelope over for ordering. Raises `RefusedError` with the orderer's reason, `UnreachableError`."""
        method: grpc.aio.StreamStreamMultiCallable[bytes, bytes] = self._channel.stream_stream(
            "/orderer.AtomicBroadcast/Broadcast"
        )

        async def once() -> AsyncIterator[bytes]:
            yield envelope

        try:
            call = method(once(), timeout=timeout_s)
            async for data in call:
                answer = decode(ab_pb2.BroadcastResponse, data, f"{self.component}: answer", UnreachableError)
                call.cancel()
                if answer.status != common_pb2.SUCCESS:
                    raise RefusedError(f"{self.component}: {_status(answer.status)}: {answer.info}", answer.status)
                return
        except grpc.aio.AioRpcError as cause:
            raise UnreachableError(f"{self.component}: {cause.code().name}: {cause.details()}") from cause
        raise UnreachableError(f"{self.component}: the connection ended without an answer")


def _status(number: int) -> str:
    try:
        return str(common_pb2.Status.Name(number))
    except ValueError:
        return f"status {number}"
