"""What the drone's Remote ID module says it sends, by UDP: each datagram a message as it is broadcast, or MAVLink.

A bare message is the 25 octets of ASTM F3411 / EN 4709-002, or a message pack: to the octet what goes on the air. What
is said here the drone signs for. So it listens on the loopback interface, and leaves out what another drone broadcasts
and what is dated otherwise than by the drone's own clock: such a time would be judged where the drone was not.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from types import TracebackType
from typing import Any, Final, Self

from wonderland.attested import attested_position
from wonderland.clock import Clock
from wonderland_remote_id import BasicId, IdType, Location, Pack, RemoteIdError, decode
from wonderland_uav_agent.broadcasts.source import BroadcastError

_log = logging.getLogger(__name__)

OLDEST_MS: Final = 1_200
"""A position may be so old when it is sent: no older than an honest drone is excused for (600 ms at 95 %, twice)."""
EARLIEST_MS: Final = -200
"""And its time so far ahead of the agent's clock."""
MAX_SENT: Final = 256
_MAVLINK: Final = 0xFD


class RemoteIdModule:
    """The last positions that the module sent. Use as an asynchronous context manager."""

    def __init__(self, listen: tuple[str, int], uav_id: str, clock: Clock) -> None:
        self._listen = listen
        self._uav_id = uav_id
        self._clock = clock
        self._transport: asyncio.DatagramTransport | None = None
        self._sent: deque[tuple[int, bytes]] = deque(maxlen=MAX_SENT)
        self.datagrams = 0
        self.bad = 0
        """Datagrams that hold no Remote ID message."""
        self.foreign = 0
        """Positions of other drones."""
        self.undated = 0
        """Positions without a time, or with one that is not the agent's."""

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

    def sent(self, since_ms: int) -> tuple[bytes, ...]:
        """Digests of the positions sent since then, oldest first, each once."""
        return tuple(dict.fromkeys(digest for sent_ms, digest in self._sent if sent_ms >= since_ms))

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
            serials = {
                message.uas_id.rstrip(" ")
                for message in messages
                if isinstance(message, BasicId) and message.id_type is IdType.SERIAL_NUMBER
            }
            for message in messages:
                if isinstance(message, Location):
                    self._position(message, serials)

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

    def _position(self, location: Location, serials: set[str]) -> None:
        if serials and self._uav_id not in serials:
            self.foreign += 1
            if self.foreign == 1:
                _log.warning("the Remote ID module broadcasts %s, not this drone's %s", min(serials), self._uav_id)
            return
        now_ms = self._clock()
        found = attested_position(location, now_ms)
        if found is None or not EARLIEST_MS <= now_ms - found[0] <= OLDEST_MS:
            self.undated += 1
            if self.undated == 1:
                _log.warning("a broadcast is dated otherwise than by this drone's clock, and not signed for")
            return
        self._sent.append((now_ms, found[1]))

    def _count_bad(self, error: RemoteIdError) -> None:
        self.bad += 1
        if self.bad == 1:
            _log.warning("a datagram of the Remote ID module is no message: %s", error)


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, module: RemoteIdModule) -> None:
        self._module = module

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        del addr
        self._module.take_datagram(data)
