"""At which pad the drone is held, in a file: an agent that starts again, after a power cut too, takes it up."""

from __future__ import annotations

import contextlib
import json
import logging
from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import sync_directory, write_atomic

_log = logging.getLogger(__name__)

LATEST_MS: Final = 3_600_000
"""No battery holds a drone for longer."""
MAX_BYTES: Final = 4_096
_UNKNOWN: Final = "?"
"""What the file says is not what this agent wrote; no pad is called so."""


class HeldMemory:
    """One file, replaced whole. Without a path nothing is remembered; a file that cannot be written is said once."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._written: str | None = None

    def held_at(self, now_ms: int) -> str | None:
        """The pad at which it was held when this was written last; None where it was not, or long ago."""
        if self._path is None:
            return None
        self._written = _UNKNOWN
        try:
            with self._path.open("rb") as file:
                found = json.loads(file.read(MAX_BYTES))
            pad_id, t_ms = found["pad_id"], found["t_ms"]
        except FileNotFoundError:
            self._written = None
            return None
        except (OSError, ValueError, TypeError, KeyError) as error:
            _log.warning("%s: not readable, so that no held drone is taken up (%s)", self._path, error)
            return None
        fresh = isinstance(t_ms, int) and 0 <= now_ms - t_ms <= LATEST_MS
        return pad_id if fresh and isinstance(pad_id, str) else None

    def note(self, pad_id: str | None, now_ms: int) -> None:
        """Held at that pad, or not any more; written when it changes."""
        if self._path is None or pad_id == self._written:
            return
        self._written = pad_id
        try:
            if pad_id is not None:
                write_atomic(self._path, json.dumps({"pad_id": pad_id, "t_ms": now_ms}).encode())
                return
            with contextlib.suppress(FileNotFoundError):
                self._path.unlink()
                sync_directory(self._path.parent)
        except (OSError, FileWriteError) as error:
            _log.warning("%s: cannot be written; a restart will not take up a held drone (%s)", self._path, error)
