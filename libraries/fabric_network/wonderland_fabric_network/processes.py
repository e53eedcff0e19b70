"""Processes that outlive the command which started them, found again and stopped by their own id.

Each process inherits a lock on ``run/<name>``, into which it has written its id. The lock ends with the process, so
that an id which the system has given to somebody else meanwhile is never taken for ours, and a crash at any moment
leaves nothing that would have to be cleaned up.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import re
import shutil
import signal
import socket
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network.errors import ComponentError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MAX_LOG_BYTES: Final = 64 << 20
"""A log that is longer is put aside; see `ProcessTable.shorten_logs`."""
STOP_S: Final = 15.0
READY_S: Final = 60.0
_POLL_S: Final = 0.01
_TAIL_BYTES: Final = 32_768
_TAIL_LINES: Final = 15
_GAVE_UP: Final = re.compile(r"^panic: |\bPANI\b|\bFATA\b|^fatal error: ")
_LOCK_HANDLE: Final = 9
# The shell writes the id of the process that it then becomes.
_BECOME: Final = f'echo $$ >&{_LOCK_HANDLE}; exec "$@"'
_PASSED_ON: Final = ("PATH", "HOME", "TMPDIR", "LANG", "LC_ALL", "TZ", "VIRTUAL_ENV")


@dataclass(frozen=True)
class Launch:
    """How a component is started. `environment` comes on top of PATH, HOME and the like."""

    name: str
    arguments: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    listens: tuple[tuple[str, int], ...] = ()
    """Host and port of each place that it listens on once it is ready."""


class ProcessTable:
    """The processes of one network. One command at a time may start and stop; anybody may look."""

    def __init__(self, run: Path, logs: Path) -> None:
        self._run = run
        self._logs = logs
        self._begun: dict[str, int] = {}

    def pid(self, name: str) -> int | None:
        """The id of a process that runs, or None."""
        handle = _open(self._run / name, os.O_RDONLY)
        if handle is None:
            return None
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            text = os.read(handle, 32).strip()
            pid = int(text) if text.isdigit() else None
            return None if pid is None or _is_reaped(pid) else pid
        finally:
            os.close(handle)
        return None

    def names(self) -> tuple[str, ...]:
        """All that were ever started here."""
        try:
            return tuple(sorted(each.name for each in self._run.iterdir() if not each.name.startswith(".")))
        except FileNotFoundError:
            return ()

    def start(self, launch: Launch) -> int:
        """Start a process that goes on when this one ends; its id. Raises `ComponentError`."""
        handle = _open(self._run / launch.name, os.O_RDWR | os.O_CREAT)
        if handle is None:
            raise ComponentError(launch.name, f"its lock cannot be made in {self._run}")
        try:
            self._take(handle, launch.name)
            os.truncate(handle, 0)
            self._shorten(launch.name)
            log = str(self.log(launch.name))
            self._begun[launch.name] = _size(self.log(launch.name))
            environment = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
            pid = os.posix_spawn(
                "/bin/sh",
                ["/bin/sh", "-c", _BECOME, "sh", *launch.arguments],
                {**environment, **launch.environment},
                file_actions=[
                    (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                    (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600),
                    (os.POSIX_SPAWN_DUP2, 1, 2),
                    (os.POSIX_SPAWN_DUP2, handle, _LOCK_HANDLE),
                ],
                setsid=True,  # Ctrl-C at the terminal is not for them
            )
            # The same text at the same place as the shell writes it, so that nobody sees a lock without an id.
            os.pwrite(handle, f"{pid}\n".encode(), 0)
        except OSError as cause:
            raise ComponentError(launch.name, f"cannot be started ({cause.strerror})") from cause
        finally:
            os.close(handle)
        return pid

    async def wait_ready(self, launch: Launch, *, timeout_s: float = READY_S) -> None:
        """Wait until a process listens everywhere. Raises `ComponentError` when it ends or takes too long."""
        deadline = time.monotonic() + timeout_s
        for host, port in launch.listens:
            while not await listens(host, port):
                if self.pid(launch.name) is None:
                    raise self.failure(launch.name, "ended while it was starting")
                if time.monotonic() > deadline:
                    raise self.failure(launch.name, f"did not listen on {host}:{port} within {timeout_s:g} s")
                await asyncio.sleep(_POLL_S)

    async def stop(self, name: str, *, patience_s: float = STOP_S) -> bool:
        """Ask a process to end, then insist; False when it did not run. Raises `ComponentError` when it stays."""
        if self.pid(name) is None:
            return False
        for request, wait_s in ((signal.SIGTERM, patience_s), (signal.SIGKILL, 5.0)):
            deadline = time.monotonic() + wait_s
            with contextlib.suppress(ProcessLookupError):
                if (pid := self.pid(name)) is not None:
                    os.kill(pid, request)
            while time.monotonic() < deadline:
                if self.pid(name) is None:
                    return True
                await asyncio.sleep(_POLL_S)
        raise ComponentError(name, f"process {self.pid(name)} cannot be stopped")

    def log(self, name: str) -> Path:
        """Where a component writes what it has to say."""
        return self._logs / f"{name}.log"

    def tail(self, name: str, lines: int = _TAIL_LINES) -> str:
        """The end of a component's log."""
        return "\n".join(self._written(name)[-lines:])

    def failure(self, name: str, reason: str) -> ComponentError:
        """An error with the last words of the component, as it ran last, and the remedy where they show it."""
        written = self._written(name, self._begun.get(name, 0))
        tail = "\n".join(_last_words(written))
        return ComponentError(
            name, reason, log_tail=tail, remedy=_remedy("\n".join(written)) or f"see {self.log(name)}"
        )

    def _written(self, name: str, since: int = 0) -> list[str]:
        try:
            with self.log(name).open("rb") as file:
                file.seek(0, os.SEEK_END)
                end = file.tell()
                file.seek(max(since if since <= end else 0, end - _TAIL_BYTES))
                return file.read().decode(errors="replace").splitlines()
        except OSError:
            return []

    def shorten_logs(self, limit: int = MAX_LOG_BYTES) -> list[str]:
        """Put aside the logs that are longer, in the place of those put aside before; whose they are.

        Whoever writes goes on; what it writes between the copy and the cut is lost. Raises `ComponentError`.
        """
        return [name for name in self.names() if self._shorten(name, limit)]

    def _shorten(self, name: str, limit: int = MAX_LOG_BYTES) -> bool:
        log = self.log(name)
        try:
            if not log.exists() or log.stat().st_size <= limit:
                return False
            aside = log.with_name(f"{log.name}.1")
            aside.touch(mode=0o600)
            shutil.copyfile(log, aside)
            os.truncate(log, 0)
        except OSError as cause:
            raise ComponentError(name, f"its log {log} cannot be put aside ({cause.strerror})") from cause
        return True

    def _take(self, handle: int, name: str) -> None:
        # Somebody who just looks holds the lock for a moment, too.
        for _ in range(100):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                time.sleep(_POLL_S)
            else:
                return
        raise ComponentError(name, "runs already")


_REMEDIES: Final[Sequence[tuple[str, str]]] = (
    ("address already in use", "another program has its port; stop that program, then `wonderland network up` again"),
    ("no space left on device", "its disk is full; make room, then `wonderland network up` again"),
    ("permission denied", "a file in the network's directory belongs to another user; run as that user"),
    ("certificate has expired", "a certificate expired; run `wonderland network renew`"),
    ("too many open files", "raise the limit of open files (ulimit -n), then `wonderland network up` again"),
)


def _last_words(written: list[str]) -> list[str]:
    """The end of a log; of a Go program that gave up, the reason and what led to it, without the stacks."""
    found = [index for index, line in enumerate(written) if _GAVE_UP.search(line)]
    if not found:
        return written[-_TAIL_LINES:]
    return written[: found[-1] + 1][-_TAIL_LINES:]


def _remedy(log: str) -> str:
    low = log.lower()
    return next((remedy for sign, remedy in _REMEDIES if sign in low), "")


def _open(path: Path, flags: int) -> int | None:
    try:
        return os.open(path, flags | os.O_CLOEXEC, 0o600)
    except OSError:
        return None


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _is_reaped(pid: int) -> bool:
    """Whether a child of our own has ended; a dead child keeps its lock until somebody asks for its exit code."""
    try:
        return os.waitpid(pid, os.WNOHANG) != (0, 0)
    except ChildProcessError:
        return False


async def listens(host: str, port: int) -> bool:
    """Whether somebody accepts connections there; within a second, or not."""
    loop = asyncio.get_running_loop()
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            async with asyncio.timeout(1.0):
                await loop.sock_connect(probe, (host, port))
        except (OSError, TimeoutError):
            return False
    return True
