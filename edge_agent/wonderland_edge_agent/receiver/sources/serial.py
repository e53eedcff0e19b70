"""Serial receivers: lines of hexadecimal digits or JSON, or a stream of MAVLink; reopened when they come back."""

from __future__ import annotations

import abc
import logging
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.receiver.sources.udp import deliver, deliver_json
from wonderland_fira_uci.serial_port import ReconnectingPort, serial_opener
from wonderland_remote_id import FramingError
from wonderland_remote_id.framings.framed import Framed
from wonderland_remote_id.framings.hex_lines import MAX_LINE_CHARS, parse_line

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.sources import Sink
    from wonderland_fira_uci.serial_port import Opener
    from wonderland_remote_id.framings.mavlink import MavlinkStream

BAUD_RATE: Final = 115_200
MAX_JSON_LINE: Final = 16_384

_log = logging.getLogger(__name__)


class _SerialSource(abc.ABC):
    """A port and what is made of its bytes."""

    def __init__(self, name: str, port: str | Opener, baud_rate: int = BAUD_RATE) -> None:
        self._name = name
        self._opener = serial_opener(port, baud_rate) if isinstance(port, str) else port
        self._port: ReconnectingPort | None = None
        self._sink: Sink | None = None

    async def start(self, sink: Sink) -> None:
        """Begin to look for the device, now and whenever it is gone."""
        self._sink = sink
        self._port = ReconnectingPort(self._opener, self)
        self._port.start()

    async def close(self) -> None:
        """Give the device back."""
        if self._port is not None:
            self._port.close()

    def port_up(self) -> None:
        """The device is open."""
        self.reset()
        _log.info("Remote ID receiver on %s is there", self._name)

    def port_down(self, detail: str) -> None:
        """The device is gone."""
        _log.warning("Remote ID receiver on %s is gone (%s); waiting for its return", self._name, detail)

    @abc.abstractmethod
    def reset(self) -> None:
        """Forget what was half read."""

    @abc.abstractmethod
    def data_received(self, data: bytes) -> None:
        """Octets came."""


class SerialLines(_SerialSource):
    """Cuts a stream into lines; what is longer than any line can be is dropped up to the next line's end."""

    def __init__(self, name: str, port: str | Opener, baud_rate: int = BAUD_RATE) -> None:
        super().__init__(name, port, baud_rate)
        self._buffer = bytearray()
        self._skipping = False

    def reset(self) -> None:
        """Forget what was half read: the first line after opening may have begun before, and is counted as bad."""
        self._buffer.clear()
        self._skipping = False

    def data_received(self, data: bytes) -> None:
        """Octets came."""
        self._buffer += data
        *lines, rest = self._buffer.replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            if self._skipping:
                self._skipping = False
            elif line.strip():
                self._take(bytes(line))
        if len(rest) > (MAX_JSON_LINE if bytes(rest[:1]) in {b"{", b"["} else MAX_LINE_CHARS):
            if not self._skipping:
                self._take(bytes(rest))
            self._skipping = True
            rest = bytearray()
        self._buffer = rest

    def _take(self, line: bytes) -> None:
        assert self._sink is not None
        if line.lstrip()[:1] in {b"{", b"["}:
            deliver_json(self._sink, line, self._name)
            return
        try:
            parsed = parse_line(line)
        except FramingError:
            self._sink.take_bad()
            return
        self._sink.take_framed(
            Framed(parsed.frame, "serial", address=parsed.address, rssi_dbm=parsed.rssi_dbm), self._name
        )


class SerialMavlink(_SerialSource):
    """A receiver that speaks MAVLink 2, such as DroneScout Bridge."""

    def __init__(self, name: str, port: str | Opener, baud_rate: int = BAUD_RATE) -> None:
        super().__init__(name, port, baud_rate)
        self._stream: MavlinkStream | None = None

    def reset(self) -> None:
        """Begin a new stream."""
        from wonderland_remote_id.framings.mavlink import MavlinkStream  # noqa: PLC0415 - only where it is spoken

        self._stream = MavlinkStream()

    def data_received(self, data: bytes) -> None:
        """Octets came."""
        assert self._sink is not None
        assert self._stream is not None
        deliver(self._sink, list(self._stream.feed(data)), self._name)
