"""The uplink's way by WebSocket."""

from __future__ import annotations

import contextlib
import ipaddress
import ssl
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from wonderland.telemetry import end_point_seen, tls_of
from wonderland_edge_agent.uplink.errors import UplinkConfigurationError, UplinkConnectionError
from wonderland_edge_agent.uplink.protocol import MAX_SERVER_FRAME_BYTES
from wonderland_edge_agent.uplink.transport import Connected

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection


class WebSocketTransport:
    """To ``url``: ``ws://`` only to this machine, or with ``allow_plaintext``."""

    def __init__(
        self,
        url: str,
        *,
        ssl_context: ssl.SSLContext | None = None,
        allow_plaintext: bool = False,
        open_timeout_s: float = 10.0,
        ping_s: float = 10.0,
    ) -> None:
        """Without a context the machine's trusted authorities decide. Raises `UplinkConfigurationError`."""
        self._loopback = _check_url(url, allow_plaintext=allow_plaintext)
        self.address = url
        self._ssl = (ssl_context or tls_of(None, None)) if urlsplit(url).scheme == "wss" else None
        self._open_timeout_s = open_timeout_s
        self._ping_s = ping_s

    @contextlib.asynccontextmanager
    async def connect(self) -> AsyncIterator[Connected]:
        """One connection. Raises `UplinkConnectionError`."""
        opening = connect(
            self.address,
            ssl=self._ssl,
            proxy=None if self._loopback else True,
            compression=None,
            user_agent_header=None,
            open_timeout=self._open_timeout_s,
            close_timeout=2,
            ping_interval=self._ping_s,
            ping_timeout=self._ping_s,
            max_size=MAX_SERVER_FRAME_BYTES,
            max_queue=16,
        )
        try:
            socket = await opening
        except InvalidStatus as cause:
            status = cause.response.status_code
            raise UplinkConnectionError(f"the server answered HTTP {status} instead of a WebSocket") from cause
        except (OSError, WebSocketException) as cause:  # a TimeoutError is an OSError
            why = str(cause) or type(cause).__name__
            raise UplinkConnectionError(f"no connection to {self.address} ({why})") from cause
        async with socket:
            yield Connected(_WebSocket(socket), end_point_seen(socket.transport.get_extra_info("ssl_object")))


class _WebSocket:
    """A WebSocket as a channel."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket

    async def receive(self) -> str | bytes:
        try:
            return await self._socket.recv()
        except ConnectionClosed as cause:
            raise ConnectionResetError(str(cause)) from cause

    async def send(self, text: str) -> None:
        try:
            await self._socket.send(text)
        except ConnectionClosed as cause:
            raise ConnectionResetError(str(cause)) from cause

    async def close(self, code: int = 1000, reason: str = "") -> None:
        await self._socket.close(code, reason)


def _check_url(url: str, *, allow_plaintext: bool) -> bool:
    """Whether the server is on this machine. Raises `UplinkConfigurationError`."""
    try:
        parts = urlsplit(url)
        host = parts.hostname or ""
        _ = parts.port
    except ValueError as cause:
        raise UplinkConfigurationError(f"the server's address {url!r} cannot be read ({cause})") from cause
    if parts.scheme not in {"ws", "wss"} or not host:
        raise UplinkConfigurationError(f"the server's address {url!r} must begin with wss:// (or ws://) and a host")
    if parts.username or parts.password:
        raise UplinkConfigurationError(
            "the server's address must hold no password: the agent signs with its ledger key"
        )
    loopback = host == "localhost"
    with contextlib.suppress(ValueError):
        loopback = loopback or ipaddress.ip_address(host).is_loopback
    if parts.scheme == "ws" and not loopback and not allow_plaintext:
        raise UplinkConfigurationError(
            f"{url!r} is not encrypted: use wss://, or say plaintext = true where a tunnel protects it"
        )
    return loopback
