"""What a port's name may mean: a serial line, a character device that is none (HSSPI), or a line over the network.

Lines over the network are pyserial's ``socket://`` and ``rfc2217://``: anchors metres apart outrun USB, so that a small
computer beside each hands its port on (ser2net). Neither is encrypted: whoever reaches that port is the node.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import socket
import stat
import termios
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol
from urllib.parse import urlsplit

import serial

from wonderland_fira_uci.errors import UwbError

BAUD_RATE: Final = 115_200
SCHEMES: Final = ("socket", "rfc2217")
_LOOK_S: Final = 0.1
_CHUNK: Final = 4096
# A peer that is gone without a word is missed after about ten seconds.
_KEEPALIVE: Final = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 4),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 2),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
    (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
)


class PortError(UwbError):
    """The device could not be opened, or is gone; the text says why and names the path.

    ``hopeless``: waiting helps nobody, somebody has to do something.
    """

    def __init__(self, text: str, *, hopeless: bool = False) -> None:
        super().__init__(text)
        self.hopeless = hopeless


class ByteDevice(Protocol):
    """An open, non-blocking device: a serial port, a pseudo-terminal, one end of a socket pair."""

    def fileno(self) -> int:
        """The file descriptor to read and write."""

    def close(self) -> None:
        """Release the port; reading and writing fail from now on."""


Opener = Callable[[], ByteDevice]
"""Opens the device, non-blocking; raises ``PortError``."""


def url_problem(port: str) -> str:
    """What is wrong with a port that is written as a URL, or not at all; empty where nothing is, and for every path."""
    if not port:
        return "is empty; a path such as /dev/ttyACM0, socket://HOST:PORT or rfc2217://HOST:PORT is wanted"
    scheme, separator, _ = port.partition("://")
    if not separator:
        return ""
    if scheme not in SCHEMES:
        return f"{scheme}:// is not known; a path, socket://HOST:PORT or rfc2217://HOST:PORT is"
    try:
        parts = urlsplit(port)
        whole = bool(parts.hostname) and parts.port is not None and parts.port > 0
    except ValueError:
        whole = False
    return "" if whole else f"{scheme}:// needs host and port, for example {scheme}://10.0.0.7:5000"


class NetworkOpener:
    """Opens a line over the network. It blocks for seconds where nobody answers: call it in a thread."""

    def __init__(self, url: str, baud_rate: int, *, rtscts: bool) -> None:
        self._url = url
        self._baud_rate = baud_rate
        self._rtscts = rtscts

    def __call__(self) -> ByteDevice:
        """Connect. Raises PortError."""
        problem = url_problem(self._url)
        if problem:
            raise PortError(f"{self._url} cannot be opened: {problem}", hopeless=True)
        try:
            line = serial.serial_for_url(self._url, self._baud_rate, timeout=_LOOK_S, rtscts=self._rtscts)
            return _Connection(line) if self._url.startswith("socket") else _Bridge(line)
        except (OSError, ValueError) as error:
            raise PortError(f"{self._url} cannot be opened: {error}") from error


def serial_opener(path: Path | str, baud_rate: int = BAUD_RATE, *, rtscts: bool = False) -> Opener:
    """An opener of a serial device, pseudo-terminal or other character device, or of a line over the network (URL).

    8N1, for this process alone where it is of this machine; ``rtscts``: flow control by these lines (XON and XOFF are
    octets of UCI). Octets that waited from before are discarded. A second process that opens the same device gets
    ``PortError``.
    """
    name = str(path)
    if "://" in name:
        return NetworkOpener(name, baud_rate, rtscts=rtscts)

    def open_serial() -> ByteDevice:
        try:
            # pyserial sets the line to raw and the descriptor to non-blocking; its own read and write are not used.
            return serial.Serial(name, baud_rate, timeout=0, exclusive=True, rtscts=rtscts)  # type: ignore[no-any-return]
        except (OSError, ValueError, termios.error) as error:
            # Only what failed as a serial line is looked at: opening one twice may reset the board on it.
            device = _character_device(name)
            if device is None:
                why, hopeless = _why(name, error)
                raise PortError(f"{path} cannot be opened: {why}", hopeless=hopeless) from error
            return device

    return open_serial


_WHY: Final = {
    errno.ENOENT: "there is nothing of that name",
    errno.EACCES: "this user may not; serial ports often belong to a group such as dialout",
    errno.EAGAIN: "another program has it open",
    errno.EBUSY: "another program has it open",
}


def _why(name: str, error: Exception) -> tuple[str, bool]:
    """What keeps a path from being opened, in words, and whether that stays so by itself."""
    with contextlib.suppress(OSError):
        mode = Path(name).stat().st_mode
        if not stat.S_ISCHR(mode):
            return f"it is a {'directory' if stat.S_ISDIR(mode) else 'file'}, no device", True
    # Rights may come a moment after the device, when udev gives it to its group.
    return _WHY.get(getattr(error, "errno", None) or 0, str(error)), False


class _CharacterDevice:
    """A character device that is no terminal, as drivers of nodes on SPI make them."""

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def fileno(self) -> int:
        return self._fd

    def close(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)


def _character_device(name: str) -> ByteDevice | None:
    try:
        if not stat.S_ISCHR(Path(name).stat().st_mode):
            return None
        fd = os.open(name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        if os.isatty(fd):
            raise BlockingIOError
        _check_waitable(name, fd)
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        return None
    except PortError:
        os.close(fd)
        raise
    return _CharacterDevice(fd)


def _check_waitable(name: str, fd: int) -> None:
    """Epoll refuses what can never be waited for, such as /dev/null. Raises PortError."""
    with select.epoll() as waiting:
        try:
            waiting.register(fd, select.EPOLLIN)
        except PermissionError as error:
            raise PortError(
                f"{name} is no serial port, and no device that a node could be on: nothing ever comes from it",
                hopeless=True,
            ) from error


class _Connection:
    """``socket://``: read and written by its own descriptor."""

    def __init__(self, line: serial.SerialBase) -> None:
        self._line = line
        # The copy shares the connection and its options, and is closed again.
        with socket.socket(fileno=os.dup(line.fileno())) as connection:
            for level, option, value in _KEEPALIVE:
                connection.setsockopt(level, option, value)

    def fileno(self) -> int:
        return int(self._line.fileno())

    def close(self) -> None:
        threading.Thread(target=self._line.close, daemon=True).start()  # pyserial sleeps in it


class _Bridge:
    """``rfc2217://``: pyserial unpacks telnet in a thread and has no descriptor, so two more carry the octets."""

    def __init__(self, line: serial.SerialBase) -> None:
        self._line = line
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        for work in (self._inward, self._outward):
            threading.Thread(target=work, daemon=True).start()

    def fileno(self) -> int:
        return self._near.fileno()

    def close(self) -> None:
        self._near.close()

    def _inward(self) -> None:
        """Ends with the line; then the near end reads that it has hung up."""
        with contextlib.suppress(OSError):
            while True:
                data = self._line.read(1)
                if data:
                    self._far.sendall(data + self._line.read(min(self._line.in_waiting, _CHUNK)))
        with contextlib.suppress(OSError):
            self._far.shutdown(socket.SHUT_RDWR)

    def _outward(self) -> None:
        with contextlib.suppress(OSError):
            while data := self._far.recv(_CHUNK):
                self._line.write(data)
        with contextlib.suppress(OSError):
            self._far.shutdown(socket.SHUT_RDWR)
        self._line.close()
        self._far.close()
