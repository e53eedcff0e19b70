"""Positions by UDP: one JSON object in a datagram, as an autopilot's bridge sends it.

``{"lat_e7", "lon_e7", "height_mm", "accuracy_mm", "height_accuracy_mm", "t_ms"}``: WGS-84, height above the ellipsoid,
accuracies at 95 %, time of the fix in milliseconds since the Unix epoch.
"""

from __future__ import annotations

import asyncio
import logging
from types import TracebackType
from typing import Any, Final, Self

from wonderland.clock import Clock
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.source import PositionError

_log = logging.getLogger(__name__)

MAX_DATAGRAM_BYTES: Final = 1_024
MAX_AGE_MS: Final = 1_000
"""An older fix is no position of a flying drone."""


class AutopilotPosition:
    """The last fix that arrived, while it is fresh. Use as an asynchronous context manager."""

    def __init__(self, listen: tuple[str, int], clock: Clock, *, max_age_ms: int = MAX_AGE_MS) -> None:
        self._listen = listen
        self._clock = clock
        self._max_age_ms = max_age_ms
        self._transport: asyncio.DatagramTransport | None = None
        self._last: Claim | None = None
        self._heard_ms = 0
        self._fresh = asyncio.Event()
        self.datagrams = 0
        self.bad = 0

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(self), local_addr=self._listen)
        except OSError as cause:
            host, port = self._listen
            raise PositionError(
                f"cannot listen for positions on UDP {host}:{port} ({cause.strerror or cause})"
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
        """Where it listens. Raises PositionError when it does not."""
        if self._transport is None:
            raise PositionError("the position source is not open")
        host, port = self._transport.get_extra_info("sockname")[:2]
        return str(host), int(port)

    def claim(self, now_ms: int) -> Claim | None:
        """The last fix; None when it came longer than a second ago."""
        return self._last if self._last is not None and now_ms - self._heard_ms <= self._max_age_ms else None

    def why_not(self, now_ms: int) -> str:
        """Why there is no position now; empty where there is one."""
        if self.claim(now_ms) is not None:
            return ""
        if self._last is None:
            return "no datagram with a position has come"
        return f"the last datagram came {(now_ms - self._heard_ms) / 1_000:.1f} s ago"

    async def wait(self, timeout_s: float) -> None:
        """Until there is a fix. Raises PositionError."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._fresh.wait()
        except TimeoutError:
            host, port = self.address
            raise PositionError(f"no position arrived on UDP {host}:{port} within {timeout_s:g} s") from None

    def take_datagram(self, datagram: bytes) -> None:
        """One datagram; what is no position is counted and left out."""
        self.datagrams += 1
        try:
            self._last = Claim.decode(datagram, max_bytes=MAX_DATAGRAM_BYTES)
        except ProofError as error:
            self.bad += 1
            if self.bad == 1:
                _log.warning("a datagram is no position: %s", error)
            return
        self._heard_ms = self._clock()
        self._fresh.set()


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, source: AutopilotPosition) -> None:
        self._source = source

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        del addr
        self._source.take_datagram(data)
