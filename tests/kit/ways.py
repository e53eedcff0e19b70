"""The two ways by which an agent's uplink reaches a server, each with a small server of the test's at its end."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Protocol

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from kit.bus import Organisations
from wonderland_bus.backend import Doorway, Listener
from wonderland_bus.channel import Channel
from wonderland_bus.settings import Member
from wonderland_edge_agent.uplink import Transport, WebSocketTransport
from wonderland_edge_agent.uplink.zenoh import ZenohTransport
from wonderland_fabric_gateway.ca.local import Kind
from wonderland_fabric_gateway.connection import ClientTls

NAME = "agents.example"
WAYS = ("websocket", "zenoh")


class Spoken(Protocol):
    """A connection, from the server's side."""

    async def send(self, text: str) -> None: ...
    async def receive(self) -> str | bytes: ...
    async def close(self, code: int = 1000, reason: str = "") -> None: ...
    def abort(self) -> None:
        """Break it off without a word."""


Handle = Callable[[Spoken], Awaitable[None]]


class Stand(Protocol):
    """A server that comes and goes, and the way to it."""

    def way(self) -> Transport: ...
    def serve(self, handle: Handle) -> contextlib.AbstractAsyncContextManager[None]: ...


class _Socket:
    def __init__(self, socket: ServerConnection) -> None:
        self._socket = socket

    async def send(self, text: str) -> None:
        await self._socket.send(text)

    async def receive(self) -> str | bytes:
        try:
            return await self._socket.recv()
        except ConnectionClosed as cause:
            raise ConnectionResetError(str(cause)) from cause

    async def close(self, code: int = 1000, reason: str = "") -> None:
        await self._socket.close(code, reason)

    def abort(self) -> None:
        self._socket.transport.abort()


def as_spoken(socket: ServerConnection) -> Spoken:
    """A WebSocket's."""
    return _Socket(socket)


class WebSocketStand:
    """On a port that stays the same."""

    def __init__(self, port: int) -> None:
        self.port = port

    def way(self) -> Transport:
        return WebSocketTransport(f"ws://127.0.0.1:{self.port}/ingest")

    @contextlib.asynccontextmanager
    async def serve(self, handle: Handle) -> AsyncIterator[None]:
        async with serve(lambda socket: handle(as_spoken(socket)), "127.0.0.1", self.port, compression=None):
            yield


class _OnTheBus:
    def __init__(self, channel: Channel) -> None:
        self._channel = channel

    async def send(self, text: str) -> None:
        await self._channel.send(text)

    async def receive(self) -> str | bytes:
        return await self._channel.receive()

    async def close(self, code: int = 1000, reason: str = "") -> None:
        await self._channel.close(code, reason)

    def abort(self) -> None:
        self._channel.end("broken off")


class ZenohStand:
    """At a router that is there already."""

    def __init__(self, organisations: Organisations, port: int, *, agent: str = "pad-1", ping_s: float = 0.3) -> None:
        self._organisations = organisations
        self._port = port
        self._agent = agent
        self._ping_s = ping_s

    def way(self, msp_id: str = "PadMSP") -> ZenohTransport:
        tls = self._organisations.tls(msp_id, self._agent)
        return ZenohTransport(
            f"zenoh+tls://localhost:{self._port}/{NAME}",
            tls.ca,
            ClientTls(tls.certificate, tls.key),
            open_timeout_s=1.0,
            ping_s=self._ping_s,
        )

    def listener(self, handle: Handle, name: str = "backend-1") -> Listener:
        own = self._organisations.tls("AuthorityMSP", name, kind=Kind.TLS, hosts=[NAME])
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(own.certificate, own.key)
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_verify_locations(self._organisations.ca)
        doorway = Doorway(
            member=Member(routers=[f"tls/localhost:{self._port}"], tls=own, patience_ms=1_000),
            context=context,
            max_channels=100,
            max_frame_bytes=256 * 1024,
            ping_s=self._ping_s,
        )
        return Listener(doorway, lambda channel, _shown: handle(_OnTheBus(channel)))

    @contextlib.asynccontextmanager
    async def serve(self, handle: Handle) -> AsyncIterator[None]:
        listener = self.listener(handle)
        running = asyncio.create_task(listener.run())
        try:
            await listener.listening.wait()
            yield
        finally:
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
