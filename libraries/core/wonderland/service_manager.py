"""Tells the service manager that a service is ready, alive and stopping (sd_notify(3)); nothing where none asks."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
from collections.abc import AsyncIterator, Iterator, Mapping
from typing import Final

_US_PER_S: Final = 1_000_000


@contextlib.contextmanager
def held(signals: set[signal.Signals]) -> Iterator[None]:
    """Inside, these signals wait for `signal.sigwait`, in threads begun there too: none of them is ended by one.

    Who is told to stop a second time while stopping has been told already.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        while signal.sigtimedwait(signals, 0):
            pass
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class ServiceManager:
    """By NOTIFY_SOCKET and WATCHDOG_USEC of the environment, as systemd sets them."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._path = environment.get("NOTIFY_SOCKET", "")
        microseconds = environment.get("WATCHDOG_USEC", "")
        mine = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self._period_s = int(microseconds) / _US_PER_S / 2 if mine and microseconds.isdecimal() else None

    def tell(self, state: str) -> None:
        """Send a state such as ``READY=1``. A manager that does not hear it decides by itself."""
        if not self._path:
            return
        address = f"\0{self._path[1:]}" if self._path.startswith("@") else self._path
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(state.encode(), address)

    @contextlib.asynccontextmanager
    async def alive(self) -> AsyncIterator[None]:
        """Inside, it is told that the event loop still turns; at the end, that the service stops."""
        beating = asyncio.create_task(self._beat(self._period_s)) if self._period_s else None
        try:
            yield
        finally:
            self.tell("STOPPING=1")
            if beating is not None:
                beating.cancel()
                await asyncio.gather(beating, return_exceptions=True)

    async def _beat(self, period_s: float) -> None:
        while True:
            self.tell("WATCHDOG=1")
            await asyncio.sleep(period_s)
