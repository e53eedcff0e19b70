"""A pseudo-terminal in front of a virtual node: a real serial device to whoever opens its path."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol

READ_OCTETS: Final = 65_536
MAX_WAITING_OCTETS: Final = 16_384
LINE_TIMEOUT_S: Final = 0.2


class PortDevice(Protocol):
    """The device side of a serial line, without I/O of its own."""

    transmit: Callable[[bytes], None]
    """Where it sends octets; the port sets it."""

    @property
    def desynchronised(self) -> bool:
        """Whether it waits for octets that may never come; a pause on the line then ends that."""
        ...

    def power_on(self) -> None:
        """It is plugged in."""

    def power_off(self) -> None:
        """It is unplugged and loses everything."""

    def receive(self, data: bytes) -> None:
        """Octets of the host."""

    def resynchronise(self) -> None:
        """The line was quiet."""


class PtyPort:
    """Connects ``node`` to a pseudo-terminal, reachable at ``path`` (a symbolic link) while it is plugged in."""

    def __init__(self, node: PortDevice, path: Path) -> None:
        self.node = node
        self.path = path
        self.octets_dropped = 0
        """Octets that nobody read in time; a serial line without flow control loses them as well."""
        self._master = -1
        self._slave = -1
        self._waiting = bytearray()
        self._line_timer: asyncio.TimerHandle | None = None
        node.transmit = self._write

    @property
    def is_plugged(self) -> bool:
        """Whether the path leads to a device."""
        return self._master >= 0

    def plug(self) -> None:
        """Powers the node and makes its device appear."""
        if self.is_plugged:
            return
        # The node keeps its own descriptor of the far end: so the line stays raw and up while nobody has it open.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        asyncio.get_running_loop().add_reader(self._master, self._readable)
        self.node.power_on()
        fresh = self.path.with_name(f".{self.path.name}.new")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.ttyname(self._slave))
        fresh.replace(self.path)

    def unplug(self) -> None:
        """Takes the device away under whoever has it open; the node loses everything."""
        if not self.is_plugged:
            return
        loop = asyncio.get_running_loop()
        loop.remove_reader(self._master)
        loop.remove_writer(self._master)
        if self._line_timer is not None:
            self._line_timer.cancel()
            self._line_timer = None
        master, slave, self._master, self._slave = self._master, self._slave, -1, -1
        self._waiting.clear()
        self.node.power_off()
        self.path.unlink(missing_ok=True)
        os.close(slave)
        os.close(master)

    def close(self) -> None:
        """Close both ends; the device's path is gone."""
        self.unplug()

    def _readable(self) -> None:
        try:
            data = os.read(self._master, READ_OCTETS)
        except BlockingIOError:
            return
        if self._line_timer is not None:
            self._line_timer.cancel()
            self._line_timer = None
        self.node.receive(data)
        if self.node.desynchronised:
            self._line_timer = asyncio.get_running_loop().call_later(LINE_TIMEOUT_S, self.node.resynchronise)

    def _write(self, data: bytes) -> None:
        if not self.is_plugged:
            return
        if self._waiting:
            if len(self._waiting) + len(data) > MAX_WAITING_OCTETS:
                self.octets_dropped += len(data)
            else:
                self._waiting += data
            return
        written = 0
        with contextlib.suppress(BlockingIOError):
            written = os.write(self._master, data)
        if written < len(data):
            self._waiting += data[written:]
            asyncio.get_running_loop().add_writer(self._master, self._drain)

    def _drain(self) -> None:
        with contextlib.suppress(BlockingIOError):
            del self._waiting[: os.write(self._master, self._waiting)]
        if not self._waiting:
            asyncio.get_running_loop().remove_writer(self._master)
