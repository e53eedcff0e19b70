"""Cursor-on-Target to a TAK server or group: `pytak` connects and writes, `cot` says what."""

from __future__ import annotations

import asyncio
import logging
import warnings
from collections.abc import Callable, Coroutine
from typing import Any, Final

from wonderland_backend.live.hub import Hub
from wonderland_backend.outputs import cot, feed
from wonderland_backend.outputs.items import Gate
from wonderland_backend.settings.outputs import TakSettings

with warnings.catch_warnings():
    warnings.simplefilter("ignore", UserWarning)  # it asks for aiohttp, which only enrolment needs
    import pytak

logger = logging.getLogger(__name__)

LONGEST_PAUSE_S: Final = 30.0
CONNECT_S: Final = 10.0
SEND_S: Final = 10.0
READ_BYTES: Final = 65_536


class TakOutput:
    """Sends until it is cancelled, and again whenever the server has gone away."""

    def __init__(self, settings: TakSettings, hub: Hub, clock: Callable[[], int]) -> None:
        self._settings = settings
        self._hub = hub
        self._clock = clock
        self._gate = Gate(settings.tell, settings.period_ms)
        self.sent = 0

    async def run(self) -> None:
        """Send while the server runs."""
        pause_s = 1.0
        while True:
            try:
                async with asyncio.timeout(CONNECT_S):
                    reader, writer = await pytak.protocol_factory(self._configuration())
                logger.info("TAK: sending to %s", self._settings.url)
                pause_s = 1.0
                try:
                    await _first(self._send(writer), _until_gone(reader))
                    return
                finally:
                    writer.close()
            except (OSError, TimeoutError, SyntaxError) as error:
                logger.warning("TAK: %s is away (%s); trying again in %.0f s", self._settings.url, error, pause_s)
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    def _configuration(self) -> dict[str, Any]:
        settings = self._settings
        # "+wo": pytak would else listen for what others of a group send, too.
        configuration = {"COT_URL": settings.url.replace("udp://", "udp+wo://", 1), "TAK_PROTO": "0"}
        files = {
            "PYTAK_TLS_CLIENT_CERT": settings.tls_certificate,
            "PYTAK_TLS_CLIENT_KEY": settings.tls_key,
            "PYTAK_TLS_CLIENT_CAFILE": settings.tls_ca,
        }
        return configuration | {name: str(file) for name, file in files.items() if file is not None}

    async def _send(self, writer: Any) -> None:
        worker = pytak.TXWorker(asyncio.Queue(), self._configuration(), writer)
        async for item in feed.items(self._hub, self._gate):
            event = cot.event(item, self._clock())
            if event is not None:
                async with asyncio.timeout(SEND_S):
                    await worker.send_data(event)
                self.sent += 1
            self._gate.note_told(item)


async def _until_gone(reader: asyncio.StreamReader | None) -> None:
    """Read off what a server says; raises `ConnectionError` when it goes.

    What is written to a connection that its other end has closed is lost without an error.
    """
    if reader is None:  # a datagram's receiver does not go
        await asyncio.Event().wait()
        return
    while await reader.read(READ_BYTES):
        pass
    raise ConnectionResetError("it closed the connection")


async def _first(*works: Coroutine[Any, Any, None]) -> None:
    """All of these until the first one ends, or raises."""
    tasks = [asyncio.ensure_future(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
