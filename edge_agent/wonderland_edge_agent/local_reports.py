"""What the pad's agent reports, for other programs of this machine: datagrams on a Unix socket, told and forgotten.

The same records that go to the backend (`wonderland.telemetry`), one in a datagram, as JSON. Whoever owns the socket's
file hears them; nothing comes back, and a reader that is slow or away costs the agent nothing.
"""

from __future__ import annotations

import contextlib
import socket
from pathlib import Path

from wonderland import telemetry
from wonderland.telemetry import Body


class LocalReports:
    """Sends to ``path``, where another program listens, or does not."""

    def __init__(self, path: Path) -> None:
        self._path = str(path)
        self._seq = 0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def tell(self, t_ms: int, body: Body) -> None:
        """One record; it is lost where nobody reads."""
        self._seq += 1
        with contextlib.suppress(OSError):
            self._socket.sendto(telemetry.canonical(telemetry.record_of(self._seq, t_ms, body)), self._path)

    def close(self) -> None:
        """Tell nobody any more."""
        self._socket.close()
