"""The backend's end of the bus: it takes agents' connections in, as a listening socket does."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import ssl
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from cryptography import x509

from wonderland_bus import keys
from wonderland_bus.agent import ROUTER_LOST
from wonderland_bus.channel import Channel
from wonderland_bus.errors import BusError, BusSettingsError, ChannelClosedError
from wonderland_bus.identity import Peer
from wonderland_bus.secure import SecureStream
from wonderland_bus.segments import Kind, SegmentError, parse
from wonderland_bus.settings import Member
from wonderland_bus.wire import Wire

_log = logging.getLogger(__name__)

HANDSHAKE_S: Final = 10.0
MAX_HANDSHAKES: Final = 500
"""Connections that have not shown who they are; of each name on the router `MAX_HANDSHAKES_EACH`. The oldest goes."""
MAX_HANDSHAKES_EACH: Final = 4
MAX_WAITING: Final = 1_000
"""Openings that asyncio has yet to see; those beyond are dropped, and come again."""
RETRY_S: Final = 0.25

Serve = Callable[[Channel, bytes], Awaitable[None]]
"""Serves a connection, to its end; with the certificate (DER) that the agent showed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doorway:
    """How a backend takes agents in."""

    member: Member
    context: ssl.SSLContext
    """Of a server that demands certificates of agents."""
    max_channels: int
    max_frame_bytes: int
    ping_s: float = 10.0


class Listener:
    """Takes agents in for as long as `run` runs."""

    def __init__(self, doorway: Doorway, serve: Serve) -> None:
        self._doorway = doorway
        self._serve = serve
        self._server = 1 + secrets.randbelow((1 << 64) - 1)
        self._channels: dict[str, Channel] = {}
        self._shaking: dict[str, Peer] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._lock = threading.Lock()
        self._waiting = 0
        self.listening = asyncio.Event()
        """A router is there, and agents can come."""

    async def run(self) -> None:
        """Until it is cancelled. A router that is away is tried again."""
        said = ""
        while True:
            try:
                async with Wire.open(self._doorway.member) as wire:
                    said = ""
                    await self._listen(wire)
                    _log.warning("bus: %s; its agents come anew", ROUTER_LOST)
            except BusError as cause:
                if str(cause) != said:
                    said = str(cause)
                    _log.warning("bus: %s; trying again", said)
            await asyncio.sleep(RETRY_S)

    async def _listen(self, wire: Wire) -> None:
        loop = asyncio.get_running_loop()

        def heard(key: str, message: bytes) -> None:
            with self._lock:
                if self._waiting >= MAX_WAITING:
                    return
                self._waiting += 1
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._began, wire, key, message)

        try:
            await wire.serve_as(keys.serving(self._server))
            await wire.subscribe(keys.ALL_OPENINGS, heard)
            self.listening.set()
            _log.info("bus: agents are taken in")
            await wire.lost.wait()
        finally:
            self.listening.clear()
            for channel in list(self._channels.values()):
                channel.end(ROUTER_LOST)
            for task in list(self._tasks):
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def _began(self, wire: Wire, key: str, message: bytes) -> None:
        """A connection's first word, or the same again."""
        with self._lock:
            self._waiting -= 1
        named = keys.parse_opening(key)
        if named is None or key in self._channels:
            return
        with contextlib.suppress(SegmentError):
            segment = parse(message)
            full = len(self._channels) >= self._doorway.max_channels + MAX_HANDSHAKES
            if segment.kind is Kind.DATA and not segment.seq and not segment.server and not full:
                self._open(wire, key, *named, message)

    def _open(self, wire: Wire, key: str, peer: Peer, connection: str, message: bytes) -> None:
        doorway = self._doorway
        self._make_room(peer)
        channel = Channel(
            SecureStream(doorway.context, server_name=None, max_frame_bytes=doorway.max_frame_bytes),
            partial(wire.put, keys.down(peer, connection)),
            server=self._server,
            ping_s=doorway.ping_s,
            on_closed=partial(self._closed, key),
        )
        self._channels[key] = channel
        self._shaking[key] = peer
        self._start(self._serve_at(wire, keys.up(peer, connection), key, peer, channel, message))

    def _make_room(self, peer: Peer) -> None:
        same = [key for key, other in self._shaking.items() if other.name == peer.name]
        for key in same[:1] if len(same) >= MAX_HANDSHAKES_EACH else list(self._shaking)[:1]:
            if len(same) >= MAX_HANDSHAKES_EACH or len(self._shaking) >= MAX_HANDSHAKES:
                self._shaking.pop(key)
                self._channels[key].end("too many connections that do not say who they are")

    async def _serve_at(self, wire: Wire, place: str, key: str, peer: Peer, channel: Channel, first: bytes) -> None:
        """Hear this connection alone: what is put at others, that there are not, the router drops."""

        def take(key: str, message: bytes) -> None:
            if key == place:  # one can put at `up/*` as well, and so without knowing a connection
                channel.arrived(message)

        try:
            heard = await wire.subscribe(place, take)
        except BusError as cause:
            channel.end(str(cause))
            return
        try:
            channel.arrived(first)
            await self._answer(key, peer, channel)
        finally:
            with contextlib.suppress(BusError):
                await wire.undeclare(heard)

    async def _answer(self, key: str, peer: Peer, channel: Channel) -> None:
        try:
            async with asyncio.timeout(HANDSHAKE_S):
                tls = await channel.ready()
            shown = tls.getpeercert(binary_form=True) or b""
            _require_same(peer, shown)
        except (TimeoutError, ChannelClosedError, BusSettingsError) as cause:
            _log.info("bus: an agent at the name %s was not taken in: %s", peer.name, str(cause) or "no handshake")
            await channel.close(1008, str(cause))
            return
        finally:
            self._shaking.pop(key, None)
        try:
            await self._serve(channel, shown)
        finally:
            await channel.close()

    def _closed(self, key: str) -> None:
        self._channels.pop(key, None)
        self._shaking.pop(key, None)

    def _start(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (cause := task.exception()) is not None and not isinstance(cause, BusError):
            _log.error("bus: a connection ended by a mistake", exc_info=cause)


def _require_same(peer: Peer, shown: bytes) -> None:
    """Raise `BusSettingsError` unless the certificate is the one by which the router let it put here."""
    certificate = Peer.of(x509.load_der_x509_certificate(shown))
    if certificate != peer:
        raise BusSettingsError(f"{certificate.name} speaks at the place of {peer.name}, or of another authority's")
