"""What the drone's Remote ID module says it sends, by UDP: each datagram a message as it is broadcast, or MAVLink.

A bare message is the 25 octets of ASTM F3411 / EN 4709-002, or a message pack: to the octet what goes on the air. What
is said here the drone signs for. So it listens on the loopback interface, and leaves out what another drone broadcasts
and what is dated otherwise than by the drone's own clock: such a time would be judged where the drone was not.
"""

from __future__ import annotations

import asyncio
import logging
from types import TracebackType
from typing import Any, Final, Self

from wonderland.clock import Clock
from wonderland_remote_id import Location, Pack, RemoteIdError, decode
from wonderland_uav_agent.broadcasts.positions import OwnPositions, serials
from wonderland_uav_agent.broadcasts.source import BroadcastError

_log = logging.getLogger(__name__)

_MAVLINK: Final = 0xFD


class RemoteIdModule(OwnPositions):
    """The last positions that the module sent. Use as an asynchronous context manager."""

    def __init__(self, listen: tuple[str, int], uav_id: str, clock: Clock) -> None:
        super().__init__(uav_id, clock)
        self._listen = listen
        self._transport: asyncio.DatagramTransport | None = None
        self.datagrams = 0

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(self), local_addr=self._listen)
        except OSError as cause:
            host, port = self._listen
            raise BroadcastError(
                f"cannot listen for the Remote ID module on UDP {host}:{port} ({cause.strerror or cause})"
            ) from cause
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await asyncio.sleep(0)

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens. Raises BroadcastError when it does not."""
        if self._transport is None:
            raise BroadcastError("the Remote ID module's source is not open")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    def take_datagram(self, datagram: bytes) -> None:
        """One datagram; what is no message of this drone is counted and left out."""
        self.datagrams += 1
        for frame in self._frames(datagram):
            try:
                decoded = decode(frame)
            except RemoteIdError as error:
                self._count_bad(error)
                continue
            messages = decoded.messages if isinstance(decoded, Pack) else (decoded,)
            named = serials(messages)
            for message in messages:
                if isinstance(message, Location):
                    self._position(message, named)

    def _frames(self, datagram: bytes) -> list[bytes]:
        if not datagram or datagram[0] != _MAVLINK:
            return [datagram]
        # Few drones have such a module; the others need not carry its messages.
        from wonderland_remote_id.framings.mavlink import parse_datagram  # noqa: PLC0415

        frames = []
        for one in parse_datagram(datagram):
            if isinstance(one, RemoteIdError):
                self._count_bad(one)
            else:
                frames.append(one.frame)
        return frames

    def _position(self, location: Location, named: set[str]) -> None:
        if named and self._uav_id not in named:
            self.foreign += 1
            if self.foreign == 1:
                _log.warning("the Remote ID module broadcasts %s, not this drone’s %s", min(named), self._uav_id)
            return
        now_ms = self._clock()
        found = self._dated(location, now_ms)
        if found is not None:
            self._sent.append((now_ms, found[1]))


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, module: RemoteIdModule) -> None:
        self._module = module

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        del addr
        self._module.take_datagram(data)
