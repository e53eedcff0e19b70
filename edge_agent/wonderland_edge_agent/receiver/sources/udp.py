"""Datagrams: bare frames, MAVLink or JSON, told apart by their first byte, which no two of them share."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any, Final

from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_remote_id import RemoteIdError
from wonderland_remote_id.framings.framed import Framed

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.sources import Sink
    from wonderland_remote_id.framings.mavlink_senders import Senders

MAVLINK: Final = 0xFD
JSON: Final = frozenset(b"{[")

_log = logging.getLogger(__name__)


class UdpSource:
    """Listens on (host, port); port 0 is one that the system chooses (`address` says which)."""

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._transport: asyncio.DatagramTransport | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens. Raises `ReceiverError` when it does not."""
        if self._transport is None:
            raise ReceiverError("the Remote ID receiver does not listen for datagrams")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    async def start(self, sink: Sink) -> None:
        """Begin to listen. Raises `ReceiverError` when the address cannot be had."""
        loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await loop.create_datagram_endpoint(
                lambda: _Datagrams(sink), local_addr=(self._host, self._port)
            )
        except OSError as cause:
            raise ReceiverError(
                f"Remote ID: cannot listen on UDP {self._host}:{self._port} ({cause.strerror or cause}); "
                "is another agent running, or the address not this machine's?"
            ) from cause

    async def close(self) -> None:
        """Close the port."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None
            await asyncio.sleep(0)  # the transport closes its socket in the next turn of the loop


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._senders: Senders | None = None

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        source = f"udp:{addr[0]}:{addr[1]}"
        if data and data[0] == MAVLINK:
            # Few pads have such a bridge; the others need not carry its messages.
            from wonderland_remote_id.framings.mavlink import parse_datagram  # noqa: PLC0415
            from wonderland_remote_id.framings.mavlink_senders import Senders  # noqa: PLC0415

            self._senders = self._senders or Senders()
            deliver(self._sink, parse_datagram(data, self._senders, source), source)
        elif data and data[0] in JSON:
            deliver_json(self._sink, data, source)
        else:
            self._sink.take_frame(data, source=source, transport="udp")

    def error_received(self, exc: Exception) -> None:
        _log.debug("Remote ID socket: %s", exc)


def deliver(sink: Sink, found: list[Framed | RemoteIdError], source: str) -> None:
    """Hand frames and faults to the sink."""
    for one in found:
        if isinstance(one, RemoteIdError):
            sink.take_bad()
        else:
            sink.take_framed(one, source)


def deliver_json(sink: Sink, text: bytes, source: str) -> None:
    """Hand what a receiver wrote as JSON to the sink."""
    from wonderland_remote_id.framings.json_feed import parse_documents  # noqa: PLC0415 - as above

    try:
        found = parse_documents(text)
    except RemoteIdError:
        sink.take_bad()
        return
    for one in found:
        sink.take_framed(one, source)
