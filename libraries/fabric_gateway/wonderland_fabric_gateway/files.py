"""Durable, private files: written whole or not at all, and readable by their owner only unless said otherwise."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import Final

from wonderland_fabric_gateway.errors import FileWriteError, LedgerError

PRIVATE: Final = 0o600
PUBLIC: Final = 0o644
MAX_FILE_BYTES: Final = 1 << 20


def write_atomic(path: Path, data: bytes, mode: int = PRIVATE) -> None:
    """Replace `path` by `data`: temporary file in the same directory, fsync, rename, fsync of the directory.

    A reader sees the old content or the new, never a part, also after a power cut. The file has `mode` from its
    first moment, so that a key is at no time readable by others. Raises `FileWriteError`.
    """
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                os.fchmod(file.fileno(), mode)
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                Path(temporary).unlink()
            raise
        sync_directory(path.parent)
    except OSError as cause:
        raise FileWriteError(
            f"{path}: not written ({cause.strerror or cause}); what was there before is untouched"
        ) from cause


def sync_directory(directory: Path) -> None:
    """Make renames and new names in `directory` survive a power cut. Raises OSError."""
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_bounded(path: Path, error: type[LedgerError], what: str, limit: int = MAX_FILE_BYTES) -> bytes:
    """The bytes of a small file; `error` when it is missing, unreadable or larger than `limit`."""
    try:
        with path.open("rb") as file:
            data = file.read(limit + 1)
    except OSError as cause:
        raise error(f"{what}: cannot read {path} ({cause.strerror or cause})") from cause
    if len(data) > limit:
        raise error(f"{what}: {path} is larger than {limit} bytes; is it the right file?")
    return data
