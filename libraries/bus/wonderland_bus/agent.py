"""The agent's end of the bus: one session and one channel for each connection."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Final

from wonderland_bus import keys
from wonderland_bus.channel import Channel
from wonderland_bus.errors import BusUnreachableError
from wonderland_bus.secure import SecureStream
from wonderland_bus.settings import Member
from wonderland_bus.wire import Wire

AGAIN_S: Final = 0.5
BACKEND_GONE: Final = "the backend is gone"
ROUTER_LOST: Final = "the router is gone, or cannot be reached any more"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialled:
    """To whom an agent connects, and how."""

    member: Member
    server_name: str
    """Which name the backend's certificate must have; its authority is among those of `context`."""
    context: ssl.SSLContext
    """With the same certificate as `member.tls`: the backend compares."""
    ping_s: float = 10.0
    open_timeout_s: float = 10.0
    max_frame_bytes: int = 64 * 1024


@contextlib.asynccontextmanager
async def connect(to: Dialled) -> AsyncIterator[Channel]:
    """A channel to whichever backend serves agents now. Raises `BusError`."""
    async with Wire.open(to.member) as wire:
        me = to.member.tls.peer()
        connection = secrets.token_hex(keys.CONNECTION_BYTES)
        first = keys.opening(me, connection)
        up, stream = (
            keys.up(me, connection),
            SecureStream(to.context, server_name=to.server_name, max_frame_bytes=to.max_frame_bytes),
        )

        async def transmit(message: bytes) -> None:
            await wire.put(up if channel.server else first, message)

        channel = Channel(stream, transmit, server=0, ping_s=to.ping_s)
        watching = asyncio.create_task(_watch(wire, channel))
        try:
            await wire.subscribe(keys.down(me, connection), lambda _key, message: channel.arrived(message))
            try:
                async with asyncio.timeout(to.open_timeout_s):
                    await _open(channel)
            except TimeoutError:
                raise BusUnreachableError(
                    f"the router let {me.name} in, but no backend answers: none is connected to it, the "
                    f"backend’s name is not among the router’s backends, or {me.name} is not among its agents"
                ) from None
            await wire.when_gone(keys.serving(channel.server), lambda: channel.end(BACKEND_GONE))
            yield channel
        finally:
            await channel.close()
            watching.cancel()


async def _open(channel: Channel) -> None:
    while True:
        channel.open()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(AGAIN_S):
                await channel.ready()
                return


async def _watch(wire: Wire, channel: Channel) -> None:
    await wire.lost.wait()
    channel.end(ROUTER_LOST)
