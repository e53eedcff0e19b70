"""Positions from an autopilot that speaks MAVLink, by UDP, TCP or a serial line."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self

from wonderland.clock import Clock
from wonderland.geoid import Geoid
from wonderland.proofs.records.sessions import Claim
from wonderland_fira_uci.serial_port import ReconnectingPort, serial_opener
from wonderland_uav_agent.position.mavlink.address import SerialAddress, TcpAddress, UdpAddress
from wonderland_uav_agent.position.mavlink.attitude import Vector
from wonderland_uav_agent.position.mavlink.messages import Message, Outgoing, Sender
from wonderland_uav_agent.position.mavlink.navigator import Navigator
from wonderland_uav_agent.position.mavlink.signing import Signing
from wonderland_uav_agent.position.mavlink.wire import Wire, dialect
from wonderland_uav_agent.position.source import PositionError

_log = logging.getLogger(__name__)

TICK_S: Final = 0.04
"""25 times a second, as a landing target is wanted."""
MAX_DATAGRAM_BYTES: Final = 4_096


class Crew(Protocol):
    """Who else hears the autopilot that is followed, and speaks to it."""

    def take(self, message: Message, now_ms: int) -> None:
        """A message of the autopilot's."""
        ...

    def outgoing(self, now_ms: int) -> list[Outgoing]:
        """What to send to it now; asked 25 times a second while there is one."""
        ...


class Listener(Protocol):
    """Wants what others than the autopilot say, too."""

    def hear(self, message: Message, sender: Sender, followed: Sender | None, now_ms: int) -> None:
        """A message on the link; ``followed`` is the autopilot."""
        ...


class MavlinkPosition:
    """Follows one autopilot. Use as an asynchronous context manager."""

    def __init__(
        self,
        where: UdpAddress | TcpAddress | SerialAddress,
        clock: Clock,
        geoid: Geoid | None = None,
        *,
        key: bytes | None = None,
        antenna_m: Vector = (0.0, 0.0, 0.0),
    ) -> None:
        """``key``: of MAVLink 2 signing; nothing else is heard then. ``antenna_m``: see ``Navigator``."""
        self._where = where
        self._signing = None if key is None else Signing(key, clock, dialect())
        self._clock = clock
        self._fresh = asyncio.Event()
        self._ticking: asyncio.Task[None] | None = None
        self._link: _UdpLink | _PortLink | None = None
        self._crew: list[Crew] = []
        self._listener: Listener | None = None
        self.navigator = Navigator(_warn, geoid, antenna_m)

    def board(self, crew: Crew) -> None:
        """Let it hear the autopilot and speak to it; before the source is opened."""
        self._crew.append(crew)
        self.navigator.flown = True

    def join(self, crew: Crew) -> None:
        """The same for one who does not fly it."""
        self._crew.append(crew)

    def tell_of_remote_id(self, listener: Listener) -> None:
        """Let it hear whatever comes on this link, and from whom."""
        self._listener = listener

    async def __aenter__(self) -> Self:
        self._link = (
            _UdpLink(self, self._where) if isinstance(self._where, UdpAddress) else _PortLink(self, self._where)
        )
        await self._link.open()
        self._ticking = asyncio.create_task(self._tick())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._ticking is not None:
            self._ticking.cancel()
            await asyncio.gather(self._ticking, return_exceptions=True)
        if self._link is not None:
            self._link.close()
            self._link = None
            await asyncio.sleep(0)

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens, by UDP. Raises PositionError when it does not."""
        if not isinstance(self._link, _UdpLink):
            raise PositionError("the position source does not listen")
        return self._link.address

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        reason = self.navigator.why_not(now_ms)
        if reason and self._signing is not None and self._signing.refused:
            reason += f"; {self._signing.refused} messages were not signed with this key, or long ago"
        problem = self._link.problem if self._link is not None else "it is not open"
        return f"{reason} ({problem})" if reason and problem else reason

    def claim(self, now_ms: int) -> Claim | None:
        """The position by the autopilot's last word; None where that is incomplete, or older than a second."""
        return self.navigator.claim(now_ms)

    async def wait(self, timeout_s: float) -> None:
        """Until there is a position. Raises PositionError, which says what was missing."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._fresh.wait()
        except TimeoutError:
            raise PositionError(
                f"no position from {self._where} within {timeout_s:g} s: {self.why_not(self._clock())}"
            ) from None

    def new_wire(self) -> Wire:
        """For the link, or a sender there."""
        return Wire(self._signing)

    def take(self, messages: list[tuple[Message, Sender]]) -> None:
        """What the link has read."""
        now_ms = self._clock()
        for message, sender in messages:
            self.navigator.take(message, sender, now_ms)
            if sender == self.navigator.sender:
                for each in self._crew:
                    each.take(message, now_ms)
            if self._listener is not None:
                self._listener.hear(message, sender, self.navigator.sender, now_ms)
        if not self._fresh.is_set() and self.navigator.claim(now_ms) is not None:
            self._fresh.set()

    async def _tick(self) -> None:
        while True:
            now_ms = self._clock()
            out = self.navigator.outgoing(now_ms)
            if self.navigator.sender is not None:
                out += [order for each in self._crew for order in each.outgoing(now_ms)]
            if self._link is not None:
                for order in out:
                    self._link.send(self._link.wire.write(order))
            await asyncio.sleep(TICK_S)


def _warn(text: str) -> None:
    _log.warning("%s", text)


class _UdpLink(asyncio.DatagramProtocol):
    """Listens, and answers the address of the autopilot that is followed."""

    def __init__(self, source: MavlinkPosition, where: UdpAddress) -> None:
        self._source = source
        self._where = where
        self._transport: asyncio.DatagramTransport | None = None
        self.wire = source.new_wire()
        self.problem = ""

    async def open(self) -> None:
        """Raises PositionError."""
        host, port = self._where.host, self._where.port
        try:
            loop = asyncio.get_running_loop()
            self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=(host, port))
        except OSError as cause:
            raise PositionError(f"cannot listen on {self._where} ({cause.strerror or cause})") from cause

    @property
    def address(self) -> tuple[str, int]:
        if self._transport is None:
            raise PositionError("the position source is not open")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        if len(data) > MAX_DATAGRAM_BYTES:
            return
        followed = self._source.navigator.sender
        # A stranger's half message must not swallow the beginning of the autopilot's.
        wire = self.wire if followed is not None and followed.peer == addr else self._source.new_wire()
        self._source.take(wire.read(data, addr))

    def error_received(self, exc: Exception) -> None:
        """An autopilot that is gone: its silence is seen elsewhere."""
        del exc

    def send(self, data: bytes) -> None:
        followed = self._source.navigator.sender
        if self._transport is not None and followed is not None:
            self._transport.sendto(data, followed.peer)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._transport = None


class _PortLink:
    """A serial line, or a connection that is made anew like one."""

    def __init__(self, source: MavlinkPosition, where: TcpAddress | SerialAddress) -> None:
        self._source = source
        self.wire = source.new_wire()
        self.problem = "not connected"
        if isinstance(where, TcpAddress):
            opener = serial_opener(where.url)
        else:
            opener = serial_opener(Path(where.device), where.baud_rate)
        self._port = ReconnectingPort(opener, self, not_opened=self.port_down)

    async def open(self) -> None:
        """It is looked for until it is there."""
        self._port.start()

    def port_up(self) -> None:
        self.wire.restart()
        self.problem = ""

    def port_down(self, detail: str) -> None:
        self.problem = detail

    def data_received(self, data: bytes) -> None:
        self._source.take(self.wire.read(data))

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def close(self) -> None:
        self._port.close()
