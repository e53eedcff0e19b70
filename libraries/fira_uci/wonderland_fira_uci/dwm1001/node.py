"""One DWM1001 on one serial port, asynchronous."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from wonderland_fira_uci.dwm1001.device import Dwm1001Device, Mode
from wonderland_fira_uci.dwm1001.reports import Generation, Report, Version
from wonderland_fira_uci.dwm1001.talk import BoardLost, BoardReady, Timings
from wonderland_fira_uci.errors import NodeClosedError, NodeUnavailableError
from wonderland_fira_uci.node import monotonic_ms
from wonderland_fira_uci.serial_port import Opener, PortTimings, ReconnectingPort, serial_opener

MAX_QUEUED_REPORTS: Final = 1024

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class TimedReport:
    """A report and when it arrived, on the node's clock (ms)."""

    t_ms: int
    report: Report


class Dwm1001Node:
    """Use as an asynchronous context manager; the board is connected, and connected again, as long as it is open.

    ``port``: path of the serial device (a stable link as under /dev/serial/by-id is best), or an ``Opener``. ``clock``:
    milliseconds for ``t_ms`` of reports. ``name``: for messages and logs (default: the path). ``as_anchor``: whether it
    must be one; otherwise a tag.
    """

    def __init__(
        self,
        port: Path | str | Opener,
        *,
        mode: Mode = Mode.TLV,
        name: str = "",
        clock: Callable[[], int] = monotonic_ms,
        timings: Timings | None = None,
        port_timings: PortTimings | None = None,
        as_anchor: bool = False,
    ) -> None:
        self.name = name or (str(port) if isinstance(port, (str, Path)) else "DWM1001")
        self.device = Dwm1001Device(mode, timings, as_anchor=as_anchor)
        self.detail = "not started"
        """Why the board does not report; empty while it does."""
        self.version: Version | None = None
        self.generation: Generation | None = None
        self.reports_dropped = 0
        """Reports lost because nobody read them (1024 are kept, the oldest go first)."""
        opener = serial_opener(port) if isinstance(port, (str, Path)) else port
        self._port = ReconnectingPort(opener, self, timings=port_timings, not_opened=self._set_detail)
        self._clock = clock
        self._queue: deque[TimedReport] = deque(maxlen=MAX_QUEUED_REPORTS)
        self._wake = asyncio.Event()
        self._changed = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        self._closed = False

    async def __aenter__(self) -> Self:
        self.detail = "looking for the port"
        self._port.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_ready(self) -> bool:
        """Whether the board reports."""
        return not self.detail

    @property
    def firmware(self) -> str | None:
        """Generation and version for people, where the board told them."""
        parts = (self.generation.value if self.generation else "", self.version.text if self.version else "")
        return " ".join(part for part in parts if part) or None

    async def wait_ready(self, timeout_s: float = 5.0) -> None:
        """Until the board reports; raises NodeUnavailableError with the reason, NodeClosedError."""
        try:
            async with asyncio.timeout(timeout_s):
                while not self.is_ready:
                    if self._closed:
                        raise NodeClosedError(f"{self.name} is closed")
                    if self._port.hopeless:
                        raise NodeUnavailableError(f"{self.name}: {self.detail}")
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError as error:
            raise NodeUnavailableError(f"{self.name}: not ready within {timeout_s:g} s: {self.detail}") from error

    async def reports(self) -> AsyncIterator[TimedReport]:
        """Every report in order; one reader. Ends after ``close``."""
        while True:
            while self._queue:
                yield self._queue.popleft()
            if self._closed:
                return
            self._wake.clear()
            await self._wake.wait()

    def close(self) -> None:
        """Give the port up. Never raises."""
        self._closed = True
        self._port.close()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self.detail = "closed"
        self._wake.set()
        self._changed.set()

    # Called by the port

    def port_up(self) -> None:
        """Begin with the board that appeared."""
        self._set_detail("asking the board")
        self.device.port_up(monotonic_ms())
        self._after_input()

    def port_down(self, detail: str) -> None:
        """The board is away."""
        self.device.port_down(detail)
        self._after_input()

    def data_received(self, data: bytes) -> None:
        """Feed the state machine."""
        self.device.receive_data(data, monotonic_ms())
        self._after_input()

    def _after_input(self) -> None:
        out = self.device.data_to_send()
        if out:
            self._port.write(out)
        for event in self.device.events():
            if isinstance(event, BoardReady):
                self.version, self.generation = event.version, event.generation
                self._set_detail("")
            elif isinstance(event, BoardLost):
                self._set_detail(event.detail)
            else:
                self.reports_dropped += len(self._queue) == MAX_QUEUED_REPORTS
                self._queue.append(TimedReport(self._clock(), event.report))
                self._wake.set()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        due_ms = self.device.next_timeout_ms()
        if due_ms is not None and not self._closed:
            delay_s = max(due_ms - monotonic_ms(), 0) / 1000
            self._timer = asyncio.get_running_loop().call_later(delay_s, self._timeout)

    def _timeout(self) -> None:
        self._timer = None
        self.device.advance(monotonic_ms())
        self._after_input()

    def _set_detail(self, detail: str) -> None:
        if detail != self.detail:
            if self.is_ready != (not detail):
                _log.info("%s: %s", self.name, detail or "ready")
            self.detail = detail
            self._changed.set()
