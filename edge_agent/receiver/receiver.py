"""The receiver's shell: UDP datagrams and serial lines of hexadecimal digits, into the assembler."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from edge_agent.receiver.assembler import Assembler
from wonderland.remote_id import FramingError
from wonderland.remote_id.framings.hex_lines import MAX_LINE_CHARS, parse_line
from wonderland.uwb.serial_port import ReconnectingPort, serial_opener

if TYPE_CHECKING:
    from collections.abc import Sequence

    from edge_agent.receiver.heard import Heard, ReceiverCounts
    from edge_agent.receiver.limits import ReceiverLimits
    from wonderland.proofs.records.sessions import BroadcastClaim
    from wonderland.uwb.serial_port import Opener

OnHeard = Callable[["Heard"], None]
ClockMs = Callable[[], int]

BAUD_RATE: Final = 115_200

_log = logging.getLogger(__name__)


class ReceiverError(Exception):
    """The receiver cannot listen where it was told to; the text names the address."""


def system_clock_ms() -> int:
    """Unix time of this machine."""
    return time.time_ns() // 1_000_000


class RemoteIdReceiver:
    """Hears Remote ID and tells ``on_heard`` of each position that has a drone's name.

    ``listen`` is (host, port) of the UDP socket, port 0 for one that the system chooses (`address` says which);
    ``serial_ports`` are device paths or openers, each read as lines of hexadecimal digits and reopened when it comes
    back after having been unplugged.

    >>> receiver = RemoteIdReceiver(listen=("127.0.0.1", 0), on_heard=lambda heard: spool.offer(...))
    >>> await receiver.start(); receiver.address
    >>> receiver.recent("1581F5FKD229400A1234", since_ms)
    """

    def __init__(
        self,
        *,
        listen: tuple[str, int] | None = None,
        serial_ports: Sequence[str | Opener] = (),
        on_heard: OnHeard | None = None,
        clock_ms: ClockMs = system_clock_ms,
        limits: ReceiverLimits | None = None,
    ) -> None:
        self._listen = listen
        self._clock_ms = clock_ms
        self._on_heard = on_heard
        self._assembler = Assembler(clock_ms(), limits)
        self._transport: asyncio.DatagramTransport | None = None
        self._ports = [
            _SerialLines(self, f"serial:{index}", serial_opener(port, BAUD_RATE) if isinstance(port, str) else port)
            for index, port in enumerate(serial_ports)
        ]

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens for datagrams. Raises `ReceiverError` when it does not."""
        if self._transport is None:
            raise ReceiverError("the Remote ID receiver does not listen for datagrams")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    @property
    def counts(self) -> ReceiverCounts:
        """What became of the frames so far."""
        return self._assembler.counts

    async def start(self) -> None:
        """Begin to listen. Raises `ReceiverError` when the address cannot be had."""
        if self._listen is not None:
            host, port = self._listen
            loop = asyncio.get_running_loop()
            try:
                transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(self), local_addr=(host, port))
            except OSError as cause:
                raise ReceiverError(
                    f"Remote ID: cannot listen on UDP {host}:{port} ({cause.strerror or cause}); "
                    "is another agent running, or the address not this machine's?"
                ) from cause
            self._transport = transport
        for port_reader in self._ports:
            port_reader.port.start()

    async def close(self) -> None:
        """Stop listening; what was heard stays readable."""
        for port_reader in self._ports:
            port_reader.port.close()
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await asyncio.sleep(0)  # the transport closes its socket in the next turn of the loop

    def recent(self, uav_id: str, since_ms: int) -> tuple[BroadcastClaim, ...]:
        """What was heard of a drone from ``since_ms`` (the pad's clock) on: for a session's evidence, at most 200."""
        return self._assembler.recent(uav_id, since_ms)

    def watch(self, uav_id: str) -> None:
        """Keep this drone's history whatever flood comes: call it when a session begins."""
        self._assembler.watch(uav_id)

    def unwatch(self, uav_id: str) -> None:
        """End what `watch` began."""
        self._assembler.unwatch(uav_id)

    def take(self, frame: bytes, *, source: str, transport: str, rssi_dbm: int | None = None) -> None:
        """Take a bare frame from any other transport; ``source`` tells transmitters apart."""
        heard = self._assembler.feed(
            frame, source=source, transport=transport, now_ms=self._clock_ms(), rssi_dbm=rssi_dbm
        )
        if heard is not None and self._on_heard is not None:
            self._on_heard(heard)

    def take_line(self, line: bytes, source: str) -> None:
        """Take a line of hexadecimal digits."""
        try:
            parsed = parse_line(line)
        except FramingError:
            self._assembler.count_bad()
            return
        self.take(
            parsed.frame,
            source=f"{source}:{parsed.address}" if parsed.address else source,
            transport="serial",
            rssi_dbm=parsed.rssi_dbm,
        )


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, receiver: RemoteIdReceiver) -> None:
        self._receiver = receiver

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        self._receiver.take(data, source=f"udp:{addr[0]}:{addr[1]}", transport="udp")

    def error_received(self, exc: Exception) -> None:
        _log.debug("Remote ID socket: %s", exc)


class _SerialLines:
    """Cuts a serial stream into lines; what is longer than any line can be is dropped up to the next line's end."""

    def __init__(self, receiver: RemoteIdReceiver, name: str, opener: Opener) -> None:
        self._receiver = receiver
        self._name = name
        self._buffer = bytearray()
        self._skipping = False
        self.port = ReconnectingPort(opener, self)

    def port_up(self) -> None:
        self._buffer.clear()
        # The first line after opening may have begun before: its rest is no frame, and is counted as bad.
        self._skipping = False
        _log.info("Remote ID receiver on %s is there", self._name)

    def port_down(self, detail: str) -> None:
        _log.warning("Remote ID receiver on %s is gone (%s); waiting for its return", self._name, detail)

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        *lines, rest = self._buffer.replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            if self._skipping:
                self._skipping = False
            elif line.strip():
                self._receiver.take_line(bytes(line), self._name)
        if len(rest) > MAX_LINE_CHARS:
            if not self._skipping:
                self._receiver.take_line(bytes(rest), self._name)
            self._skipping = True
            rest = bytearray()
        self._buffer = rest
