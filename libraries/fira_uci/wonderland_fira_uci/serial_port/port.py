"""The port: opens, reads, writes, notices that the device is gone, and opens it again when it returns."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import termios
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from wonderland_fira_uci.serial_port.devices import ByteDevice, NetworkOpener, Opener, PortError

READ_OCTETS: Final = 65_536
MAX_WAITING_OCTETS: Final = 65_536

_log = logging.getLogger(__name__)


class PortObserver(Protocol):
    """Who is told what happens on a port. Called in the event loop, never re-entrantly from ``write``."""

    def port_up(self) -> None:
        """The device is open."""

    def port_down(self, detail: str) -> None:
        """The device is gone; it is being looked for again."""

    def data_received(self, data: bytes) -> None:
        """Octets came, in pieces of any size."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PortTimings:
    """Seconds: pause before reopening, doubling to its maximum; how long the device may refuse to take octets."""

    backoff_s: float = 0.05
    backoff_max_s: float = 2.0
    stable_s: float = 1.0
    write_timeout_s: float = 2.0


class ReconnectingPort:
    """A port that comes back. Single event loop, no threads; all methods are for that loop.

    ``not_opened`` hears why the device cannot be opened, whenever that is something else than before.
    """

    def __init__(
        self,
        opener: Opener,
        observer: PortObserver,
        *,
        timings: PortTimings | None = None,
        not_opened: Callable[[str], None] | None = None,
    ) -> None:
        self._tell_not_opened = not_opened
        self._opener = opener
        self._observer = observer
        self._timings = timings or PortTimings()
        self._backoff_s = self._timings.backoff_s
        self._device: ByteDevice | None = None
        self._fd = -1
        self._failing = False
        self._opened_s = 0.0
        self._waiting = bytearray()
        self._write_timer: asyncio.TimerHandle | None = None
        self._open_timer: asyncio.TimerHandle | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self.last_error = ""
        self.hopeless = False
        """Whether the device could not be opened for a reason that waiting does not mend; it is tried all the same."""

    @property
    def is_up(self) -> bool:
        """Whether the device is open."""
        return self._device is not None

    def start(self) -> None:
        """Begins to look for the device; the first attempt is at once."""
        self._loop = asyncio.get_running_loop()
        self._open()

    def close(self) -> None:
        """Gives the device up for good, without a word to the observer."""
        for timer in (self._open_timer, self._write_timer):
            if timer is not None:
                timer.cancel()
        self._open_timer = self._write_timer = None
        self._release()
        self._loop = None

    def write(self, data: bytes) -> None:
        """Queues octets; without an open device they are dropped, as a node that is away hears nothing."""
        if self._device is None or self._failing or not data:
            return
        if self._waiting:
            if len(self._waiting) + len(data) > MAX_WAITING_OCTETS:
                self._down_soon("it takes no data")
            else:
                self._waiting += data
            return
        written = self._write_now(data)
        if written is not None and written < len(data):
            self._waiting += data[written:]
            assert self._loop is not None
            self._loop.add_writer(self._fd, self._drain)
            self._write_timer = self._loop.call_later(self._timings.write_timeout_s, self._write_timeout)

    def _write_now(self, data: bytes | bytearray) -> int | None:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._down_soon(str(error))
            return None

    def _drain(self) -> None:
        written = self._write_now(self._waiting)
        if written is None:
            return
        del self._waiting[:written]
        assert self._loop is not None
        if self._write_timer is not None and (written or not self._waiting):
            self._write_timer.cancel()
            self._write_timer = None
        if not self._waiting:
            self._loop.remove_writer(self._fd)
        elif self._write_timer is None:
            self._write_timer = self._loop.call_later(self._timings.write_timeout_s, self._write_timeout)

    def _write_timeout(self) -> None:
        self._write_timer = None
        self._down(f"it took no data for {self._timings.write_timeout_s:g} s")

    def _open(self) -> None:
        self._open_timer = None
        assert self._loop is not None
        if isinstance(self._opener, NetworkOpener):
            self._loop.run_in_executor(None, self._opener).add_done_callback(self._opened_elsewhere)
            return
        try:
            device = self._opener()
        except PortError as error:
            self._not_opened(error)
        else:
            self._use(device)

    def _opened_elsewhere(self, outcome: asyncio.Future[ByteDevice]) -> None:
        """In the loop again; the port may have been given up meanwhile."""
        if outcome.cancelled():
            return
        error = outcome.exception()
        if error is not None and not isinstance(error, PortError):
            raise error
        if self._loop is None:
            if error is None:
                outcome.result().close()
        elif error is not None:
            self._not_opened(error)
        else:
            self._use(outcome.result())

    def _not_opened(self, error: PortError) -> None:
        detail, self.hopeless = str(error), error.hopeless
        if detail != self.last_error:
            _log.info("%s; trying again", detail)
            if self._tell_not_opened is not None:
                self._tell_not_opened(detail)
        self.last_error = detail
        self._open_later()

    def _use(self, device: ByteDevice) -> None:
        assert self._loop is not None
        fd = device.fileno()
        try:
            self._loop.add_reader(fd, self._readable)
        except OSError as error:  # epoll refuses what can never be waited for, such as a file
            device.close()
            self._not_opened(PortError(f"the device cannot be waited for: {error}"))
            return
        self._device, self._fd = device, fd
        self._opened_s = self._loop.time()
        self.last_error, self.hopeless = "", False
        self._observer.port_up()

    def _open_later(self) -> None:
        if self._loop is not None and self._open_timer is None:
            self._open_timer = self._loop.call_later(self._backoff_s, self._open)
            self._backoff_s = min(2 * self._backoff_s, self._timings.backoff_max_s)

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, READ_OCTETS)
        except BlockingIOError:
            return
        except OSError as error:
            self._down(str(error))
            return
        if data:
            self._observer.data_received(data)
        else:
            self._down("the device has hung up")

    def _down_soon(self, detail: str) -> None:
        """Never tells the observer from within its own call of ``write``."""
        if self._loop is not None and not self._failing:
            self._failing = True
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            device = self._device
            self._loop.call_soon(lambda: self._down(detail) if self._device is device else None)

    def _down(self, detail: str) -> None:
        if self._device is None or self._loop is None:
            return
        if self._loop.time() - self._opened_s >= self._timings.stable_s:
            self._backoff_s = self._timings.backoff_s
        self._release()
        self.last_error = detail
        self._open_later()
        self._observer.port_down(detail)

    def _release(self) -> None:
        if self._write_timer is not None:
            self._write_timer.cancel()
            self._write_timer = None
        self._waiting.clear()
        self._failing = False
        device, self._device = self._device, None
        if device is None:
            return
        if self._loop is not None:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
        self._fd = -1
        with contextlib.suppress(OSError, termios.error):
            device.close()
