"""The spool's file as its parts use it: transactions, the reserve for a full disk, errors of this package only."""

from __future__ import annotations

import contextlib
import sqlite3
from typing import TYPE_CHECKING, TypeVar

from wonderland_edge_agent.spool.errors import SpoolFull
from wonderland_edge_agent.spool.reserve import DiskReserve
from wonderland_edge_agent.spool.schema import open_database, translated

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

_Result = TypeVar("_Result")


class SpoolDatabase:
    """One SQLite connection, used by one thread at a time. Raises `SpoolError`."""

    def __init__(self, path: Path, *, owner: str, max_bytes: int, reserve_bytes: int) -> None:
        self.what = f"spool {path}"
        self._reserve = DiskReserve(path.with_suffix(".reserve"), reserve_bytes)
        self._disk_full = False
        try:
            self.connection = open_database(path, owner=owner, max_bytes=max_bytes)
        except SpoolFull:
            # Even to read takes a little space; the agent must be able to start and end what was interrupted.
            if not self.use_reserve():
                raise
            self.connection = open_database(path, owner=owner, max_bytes=max_bytes)
        self._reserve.restore()

    def close(self) -> None:
        """Give the file back; everything stored stays."""
        with contextlib.suppress(sqlite3.Error):
            self.connection.close()

    @property
    def degraded(self) -> bool:
        """Whether the disk was full, and `maintain` has not found yet that it no longer is."""
        return self._disk_full or not self._reserve.held

    def use_reserve(self) -> bool:
        """Note that the disk is full, and release the reserve; False when that was done before."""
        self._disk_full = True
        return self._reserve.release()

    def note_full(self) -> None:
        """Note that the disk is full, and keep the reserve for what matters more."""
        self._disk_full = True

    def with_reserve(self, work: Callable[[], _Result]) -> _Result:
        """Do what a running session needs, in the reserve's space when there is no other."""
        try:
            return work()
        except SpoolFull:
            if not self.use_reserve():
                raise
        return work()

    def maintain(self) -> None:
        """Try to leave the emergency: move the log into the file, take the reserve again, write something."""
        if not self.degraded:
            return
        self.checkpoint()
        if not self._reserve.restore():
            return
        with contextlib.suppress(SpoolFull), self.transaction():
            self.connection.execute("UPDATE meta SET value = value WHERE name = 'dropped'")
            self._disk_full = False

    def checkpoint(self) -> None:
        """Move the log into the file and cut it to nothing; best effort."""
        with contextlib.suppress(sqlite3.Error):
            self.connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    @contextlib.contextmanager
    def transaction(self, *, durable: bool = True) -> Iterator[None]:
        """All or nothing; on the disk when it ends, or with a later one where ``durable`` is not asked for."""
        with self.reading():
            if not durable:
                self.connection.execute("PRAGMA synchronous = NORMAL")
            try:
                self.connection.execute("BEGIN IMMEDIATE")
                yield
                self.connection.execute("COMMIT")
            finally:
                if self.connection.in_transaction:
                    with contextlib.suppress(sqlite3.Error):
                        self.connection.execute("ROLLBACK")
                if not durable:
                    self.connection.execute("PRAGMA synchronous = FULL")

    @contextlib.contextmanager
    def reading(self) -> Iterator[None]:
        """SQLite's errors become this package's."""
        try:
            yield
        except sqlite3.Error as cause:
            raise translated(cause, self.what) from cause
