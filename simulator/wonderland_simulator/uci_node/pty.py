"""A pseudo-terminal in front of a virtual node: a real serial device to whoever opens its path."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import tty
from collections.abc import Callable, Iterator, Sequence
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
        self.hangs = False
        """The device is there, and nothing answers any more; until it is plugged in anew."""
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
        self.hangs = False
        master, slave, self._master, self._slave = self._master, self._slave, -1, -1
        self._waiting.clear()
        self.node.power_off()
        self.path.unlink(missing_ok=True)
        os.close(slave)
        os.close(master)

    def hang(self) -> None:
        """The node stops in the middle of whatever it does; who opens its device finds it mute."""
        if self.is_plugged:
            self.hangs = True
            self.node.power_off()

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
        if self.hangs:
            return
        self.node.receive(data)
        if self.node.desynchronised:
            self._line_timer = asyncio.get_running_loop().call_later(LINE_TIMEOUT_S, self.node.resynchronise)

    def _write(self, data: bytes) -> None:
        if not self.is_plugged or self.hangs:
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


@contextlib.contextmanager
def plugged(ports: Sequence[PtyPort]) -> Iterator[None]:
    """All of them are there; afterwards they are gone, and so are the directories that were made for them.

    Raises OSError; FileExistsError where a path is somebody else's. A link that leads nowhere is nobody's.
    """
    for port in ports:
        if port.path.exists():
            raise FileExistsError(
                errno.EEXIST, "is there already: another run's port, or a file of yours", str(port.path)
            )
    made: list[Path] = []
    try:
        for port in ports:
            missing = [each for each in (port.path.parent, *port.path.parent.parents) if not each.exists()]
            made += reversed(missing)
            port.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            port.plug()
        yield
    finally:
        for port in ports:
            port.close()
        for directory in reversed(made):
            with contextlib.suppress(OSError):  # somebody put something there
                directory.rmdir()
