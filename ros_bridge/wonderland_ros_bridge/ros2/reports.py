"""What a pad's agent tells on this machine: datagrams of telemetry on a Unix socket."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Final

import msgspec

from wonderland import telemetry
from wonderland.telemetry import Body, TelemetryError
from wonderland_ros_bridge.errors import BridgeError

_log = logging.getLogger(__name__)
_UNIX: Final = socket.AF_UNIX


@contextlib.asynccontextmanager
async def listening(path: Path, take: Callable[[int, Body], None]) -> AsyncIterator[None]:
    """``take`` gets time (ms) and body of each report. The socket is this user's alone. Raises BridgeError."""
    loop = asyncio.get_running_loop()
    before = os.umask(0o177)
    try:
        _remove(path)
        transport, _ = await loop.create_datagram_endpoint(lambda: _Reports(take), local_addr=str(path), family=_UNIX)
    except (OSError, ValueError) as cause:
        raise BridgeError(f"pad.reports: cannot listen on {path} ({cause}); is its directory there?") from cause
    finally:
        os.umask(before)
    try:
        yield
    finally:
        transport.close()
        with contextlib.suppress(OSError):
            _remove(path)


def _remove(path: Path) -> None:
    """A socket that nobody listens on any more; nothing else is taken away."""
    if path.is_socket():
        path.unlink()


class _Reports(asyncio.DatagramProtocol):
    def __init__(self, take: Callable[[int, Body], None]) -> None:
        self._take = take
        self._bad = 0

    def datagram_received(self, data: bytes, addr: object) -> None:
        del addr
        try:
            record = telemetry.decode_record(msgspec.Raw(data))
            body = telemetry.decode_body(record)
        except TelemetryError as error:
            self._bad += 1
            if self._bad == 1:
                _log.warning("a report is none, and is left out: %s", error)
            return
        self._take(record.t_ms, body)
