"""One process for a spool: an advisory lock that the kernel takes back when the process dies, however it dies."""

from __future__ import annotations

import fcntl
import os
from typing import TYPE_CHECKING

from wonderland_edge_agent.spool.errors import SpoolError, SpoolLockedError

if TYPE_CHECKING:
    from pathlib import Path


class ProcessLock:
    """Holds the lock from its making to ``release``. Raises `SpoolLockedError` when another process has it."""

    def __init__(self, path: Path) -> None:
        try:
            self._handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except OSError as cause:
            raise SpoolError(f"{path}: cannot be opened ({cause.strerror or cause})") from cause
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as cause:
            holder = os.pread(self._handle, 20, 0).decode("ascii", "replace").strip()
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

    def release(self) -> None:
        """Let another process have the spool. The file stays: removing it would let two processes lock two files."""
        os.close(self._handle)
