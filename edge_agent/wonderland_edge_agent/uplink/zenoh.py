"""The uplink's way over a bus of Zenoh (docs/decisions/0044): ``zenoh+tls://router.example:7447/backend.example``.

The router is reached with this pad's certificate; the backend proves itself, by the name after the slash, within.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from wonderland.telemetry import end_point_seen, tls_of
from wonderland_bus.agent import Dialled, connect
from wonderland_bus.errors import BusError, BusSettingsError, ChannelClosedError
from wonderland_bus.settings import Member, Tls
from wonderland_edge_agent.uplink.errors import UplinkConfigurationError, UplinkConnectionError
from wonderland_edge_agent.uplink.protocol import MAX_SERVER_FRAME_BYTES
from wonderland_edge_agent.uplink.transport import Connected
from wonderland_fabric_gateway.connection import ClientTls

_ADDRESS: Final = re.compile(r"zenoh\+tls://([^/?#@\s]+)(?:/([A-Za-z0-9.-]*))?")
PORT: Final = 7447


class ZenohTransport:
    """To whichever backend serves agents on that bus."""

    def __init__(
        self, url: str, ca: Path, client: ClientTls, *, open_timeout_s: float = 10.0, ping_s: float = 10.0
    ) -> None:
        """`ca`: who vouches for router and backend. Raises `UplinkConfigurationError`."""
        found = _ADDRESS.fullmatch(url)
        if found is None:
            raise UplinkConfigurationError(
                f"{url!r} is no address of a bus, for example zenoh+tls://router.example:{PORT}/backend.example"
            )
        routers = [each if re.search(r":\d+$", each) else f"{each}:{PORT}" for each in found[1].split(",")]
        self.address = url
        self._server_name = found[2] or routers[0].rpartition(":")[0].strip("[]")
        self._client = client
        self._open_timeout_s = open_timeout_s
        self._ping_s = ping_s
        tls = Tls(ca=ca, certificate=client.certificate, key=client.key)
        self._member = Member(routers=[f"tls/{each}" for each in routers], tls=tls)
        try:
            self._member.check_addresses()
        except BusSettingsError as cause:
            raise UplinkConfigurationError(str(cause)) from cause

    @contextlib.asynccontextmanager
    async def connect(self) -> AsyncIterator[Connected]:
        """One connection; its files are read anew. Raises `UplinkConnectionError`."""
        async with contextlib.AsyncExitStack() as stack:
            try:
                to = Dialled(
                    member=self._member,
                    server_name=self._server_name,
                    context=tls_of(self._member.tls.ca, self._client),
                    ping_s=self._ping_s,
                    open_timeout_s=self._open_timeout_s,
                    max_frame_bytes=MAX_SERVER_FRAME_BYTES,
                )
                channel = await stack.enter_async_context(connect(to))
                tls = await channel.ready()
            except (ChannelClosedError, BusError, OSError) as cause:
                raise UplinkConnectionError(f"no connection to {self.address} ({cause})") from cause
            yield Connected(channel, end_point_seen(tls))
