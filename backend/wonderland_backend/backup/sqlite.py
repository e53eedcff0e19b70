"""SQLite's own online copy: one state of the file, also while others write to it; all of it or nothing."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from wonderland_backend.errors import DatabaseError

BUSY_TIMEOUT_S: Final = 30


def copy(source: Path, to: Path) -> None:
    """Make `to`, readable by its owner only, what `source` is now. Raises `DatabaseError`; then `to` is as it was."""
    os.close(os.open(to, os.O_CREAT | os.O_CLOEXEC, 0o600))
    try:
        with (
            contextlib.closing(sqlite3.connect(source, timeout=BUSY_TIMEOUT_S)) as old,
            contextlib.closing(sqlite3.connect(to, timeout=BUSY_TIMEOUT_S)) as new,
        ):
            old.backup(new)
            new.execute("PRAGMA journal_mode=DELETE")
            (said,) = new.execute("PRAGMA integrity_check(1)").fetchone()
    except sqlite3.Error as error:
        raise DatabaseError(f"{source} was not copied to {to}: {error}") from error
    if said != "ok":
        raise DatabaseError(f"{source} is damaged: {said}")


def is_empty(path: Path) -> bool:
    """Whether there are no tables. Raises `DatabaseError` where it is no database."""
    if not path.exists():
        return True
    try:
        with contextlib.closing(sqlite3.connect(path, timeout=BUSY_TIMEOUT_S)) as database:
            return bool(database.execute("SELECT count(*) = 0 FROM sqlite_master").fetchone()[0])
    except sqlite3.Error as error:
        raise DatabaseError(f"{path}: {error}") from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path | None]:
    """What was there comes back where what is done meanwhile fails; killed, it is beside it as ….replaced.

    Gives where it is meanwhile; None where nothing was there.
    """
    kept = path.with_name(f"{path.name}.replaced")
    if kept.exists():
        raise DatabaseError(f"{kept} is left of a restore that was cut off: move it back or away first")
    was_empty = is_empty(path)
    if not was_empty:
        copy(path, kept)
    try:
        yield None if was_empty else kept
    except BaseException:
        if was_empty:
            path.unlink(missing_ok=True)
        else:
            copy(kept, path)
            kept.unlink()
        raise
    kept.unlink(missing_ok=True)
