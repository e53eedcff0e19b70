"""A Wi-Fi interface in monitor mode, tuned to channel 6 (NAN) or the channel of the beacons.

The interface is prepared outside, once: ``iw dev wlan1 set type monitor && ip link set wlan1 up && iw dev wlan1 set
channel 6``. Hearing needs the capability CAP_NET_RAW. Packets that cannot be Remote ID are dropped in the kernel's
order of arrival without being copied around: the check is on their first bytes.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_remote_id.errors import RemoteIdError
from wonderland_remote_id.framings.wifi import MAX_PACKET_BYTES, parse_radiotap

if TYPE_CHECKING:
    from wonderland_edge_agent.receiver.sources import Sink

ALL_PROTOCOLS: Final = 0x0003
RADIOTAP_LINK_TYPE: Final = 803
AGAIN_S: Final = 2.0
MAX_AT_ONCE: Final = 64

_log = logging.getLogger(__name__)


def open_monitor(interface: str) -> socket.socket:
    """A packet socket of an interface. Raises `ReceiverError` saying what to do."""
    try:
        packets = socket.socket(socket.AF_PACKET, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.htons(ALL_PROTOCOLS))
    except PermissionError as cause:
        raise ReceiverError(
            f"remote_id.wifi: {interface}: this process may not hear packets; give it the capability CAP_NET_RAW"
        ) from cause
    try:
        packets.bind((interface, 0))
        hardware = packets.getsockname()[3]
    except OSError as cause:
        packets.close()
        raise ReceiverError(f"remote_id.wifi: {interface}: {cause.strerror or cause}") from cause
    if hardware != RADIOTAP_LINK_TYPE:
        packets.close()
        raise ReceiverError(
            f"remote_id.wifi: {interface} is not in monitor mode; set it: iw dev {interface} set type monitor"
        )
    return packets


class WifiMonitorSource:
    """Reads packets with a radiotap header; ``opener`` gives the socket (for tests, one end of a pair)."""

    def __init__(self, interface: str, opener: Callable[[str], socket.socket] = open_monitor) -> None:
        self._interface = interface
        self._opener = opener
        self._socket: socket.socket | None = None
        self._sink: Sink | None = None
        self._again: asyncio.TimerHandle | None = None

    async def start(self, sink: Sink) -> None:
        """Begin to hear. Raises `ReceiverError` when the interface cannot be had."""
        self._sink = sink
        self._open()

    async def close(self) -> None:
        """Close the socket; the interface stays in monitor mode."""
        if self._again is not None:
            self._again.cancel()
        self._drop()

    def _open(self) -> None:
        self._socket = self._opener(self._interface)
        asyncio.get_running_loop().add_reader(self._socket.fileno(), self._readable)

    def _drop(self) -> None:
        if self._socket is not None:
            asyncio.get_running_loop().remove_reader(self._socket.fileno())
            self._socket.close()
            self._socket = None

    def _reopen(self) -> None:
        try:
            self._open()
        except ReceiverError:
            self._again = asyncio.get_running_loop().call_later(AGAIN_S, self._reopen)
        else:
            _log.info("Remote ID: %s is there again", self._interface)

    def _readable(self) -> None:
        assert self._sink is not None
        for _ in range(MAX_AT_ONCE):
            if self._socket is None:
                return
            try:
                packet = self._socket.recv(MAX_PACKET_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                _log.warning("Remote ID: %s is gone (%s); waiting for its return", self._interface, error)
                self._drop()
                self._again = asyncio.get_running_loop().call_later(AGAIN_S, self._reopen)
                return
            try:
                found = parse_radiotap(packet)
            except RemoteIdError:
                self._sink.take_bad()
                continue
            for one in found:
                self._sink.take_framed(one, f"wifi:{self._interface}")
