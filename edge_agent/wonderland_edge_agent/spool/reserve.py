"""Space put aside for the moment when the disk is full, so that evidence of a running session still finds room."""

from __future__ import annotations

import contextlib
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


class DiskReserve:
    """A file that does nothing but occupy its size; releasing it is what makes it useful. Size 0: no reserve."""

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        self._size = size
        self.held = path.exists()
        """Whether the space is put aside: also by an earlier process; always with a size of 0, until a release."""

    def restore(self) -> bool:
        """Put the space aside; False when the disk has not as much."""
        if self._size == 0:
            self.held = True
            return True
        try:
            handle = os.open(self._path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except OSError:
            self.held = False
            return False
        try:
            os.posix_fallocate(handle, 0, self._size)
            self.held = True
        except OSError:
            self.held = False
        finally:
            os.close(handle)
        if not self.held:
            self._remove()
        return self.held

    def release(self) -> bool:
        """Give the space to whoever writes next; False when it had been given before."""
        held, self.held = self.held, False
        self._remove()
        return held

    def _remove(self) -> None:
        with contextlib.suppress(OSError):
            self._path.unlink()
