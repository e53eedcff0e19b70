"""One process for a spool: an advisory lock that the kernel takes back when the process dies, however it dies."""

from __future__ import annotations

import fcntl
import os
import time
from typing import TYPE_CHECKING, Final

from wonderland_edge_agent.spool.errors import SpoolError, SpoolLockedError

if TYPE_CHECKING:
    from pathlib import Path

LOCK_NAME: Final = "spool.lock"
TRIES: Final = 5
PAUSE_S: Final = 0.05


def holder_of(path: Path) -> str | None:
    """The process that holds this lock ("" where it could not write its number); None where nobody does.

    Raises `SpoolError` where the file is there and cannot be opened.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    except OSError as cause:
        raise SpoolError(f"{path}: cannot be opened ({cause.strerror or cause})") from cause
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _holder(handle)
    finally:
        os.close(handle)
    return None


def _holder(handle: int) -> str:
    return os.pread(handle, 20, 0).decode("ascii", "replace").strip()


class ProcessLock:
    """Holds the lock from its making to ``release``. Raises `SpoolLockedError` when another process has it."""

    def __init__(self, path: Path) -> None:
        try:
            self._handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except OSError as cause:
            raise SpoolError(f"{path}: cannot be opened ({cause.strerror or cause})") from cause
        try:
            self._take()
        except OSError as cause:
            holder = _holder(self._handle)
            os.close(self._handle)
            raise SpoolLockedError(
                f"{path.parent}: another agent{f' (process {holder})' if holder else ''} uses this spool; "
                "stop it, or give this pad a spool directory of its own"
            ) from cause
        try:
            os.ftruncate(self._handle, 0)
            os.pwrite(self._handle, f"{os.getpid()}\n".encode(), 0)
        except OSError:
            pass  # the disk is full: the lock holds, only its holder's number is not written

    def _take(self) -> None:
        """Tried for a moment: who only asks whether it is held (`holder_of`) has it for an instant."""
        for left in reversed(range(TRIES)):
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if not left:
                    raise
                time.sleep(PAUSE_S)
            else:
                return

    def release(self) -> None:
        """Let another process have the spool. The file stays: removing it would let two processes lock two files."""
        os.close(self._handle)
