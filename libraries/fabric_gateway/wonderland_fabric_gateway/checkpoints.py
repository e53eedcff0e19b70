"""Where a reader of events or blocks continues after a restart.

A checkpoint is saved after its event has been dealt with. Dealing with the event and saving in one database
transaction (`SqliteCheckpointer`) makes it exactly once; with a file it is at least once.
"""

from __future__ import annotations

import json
import re
import sqlite3
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

from wonderland_fabric_gateway.errors import CheckpointError, FileWriteError
from wonderland_fabric_gateway.files import read_bounded, write_atomic

if TYPE_CHECKING:
    from pathlib import Path

MAX_BLOCK_NUMBER: Final = (1 << 63) - 1
_TX_ID: Final = re.compile(r"[0-9A-Za-z._-]{0,128}")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Continue in block `block_number`, after the transaction `tx_id` in it; "" is the block's beginning."""

    block_number: int
    tx_id: str = ""

    def __post_init__(self) -> None:
        _check(self.block_number, self.tx_id)

    @classmethod
    def after_block(cls, block_number: int) -> Checkpoint:
        """All of that block is dealt with."""
        return cls(block_number + 1)


def _check(number: object, tx_id: object) -> None:
    """What was stored may be anything."""
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number <= MAX_BLOCK_NUMBER:
        raise CheckpointError(f"checkpoint: {number!r} is no block number")
    if not isinstance(tx_id, str) or not _TX_ID.fullmatch(tx_id):
        raise CheckpointError(f"checkpoint: {tx_id!r} is no transaction id")


class Checkpointer(Protocol):
    """Keeps one checkpoint."""

    def load(self) -> Checkpoint | None:
        """The checkpoint; None when none was ever saved. Raises `CheckpointError` when it cannot be read."""
        ...

    def save(self, checkpoint: Checkpoint) -> None:
        """Keep it, durably. Raises `CheckpointError`; then the former one still stands."""
        ...


class MemoryCheckpointer:
    """Forgets at the end of the process: for readers that reconnect but need not survive a restart."""

    def __init__(self) -> None:
        self._checkpoint: Checkpoint | None = None

    def load(self) -> Checkpoint | None:
        """The last one saved."""
        return self._checkpoint

    def save(self, checkpoint: Checkpoint) -> None:
        """Keep it in memory."""
        self._checkpoint = checkpoint


class FileCheckpointer:
    """A small JSON file, replaced atomically and synced. A damaged one raises: starting over would repeat events."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> Checkpoint | None:
        """The file's checkpoint; None when there is no file. Raises `CheckpointError`."""
        if not self._path.exists():
            return None
        data = read_bounded(self._path, CheckpointError, "checkpoint", limit=4096)
        try:
            document = json.loads(data.decode())
            fields = (document["block_number"], document["transaction_id"])
        except (ValueError, KeyError, TypeError, RecursionError) as cause:
            raise CheckpointError(
                f"{self._path} holds no checkpoint ({cause}); restore it, or remove it to begin anew"
            ) from cause
        return Checkpoint(*fields)

    def save(self, checkpoint: Checkpoint) -> None:
        """Replace the file: temporary file, fsync, rename, fsync of the directory."""
        document = {"block_number": checkpoint.block_number, "transaction_id": checkpoint.tx_id}
        try:
            write_atomic(self._path, json.dumps(document).encode() + b"\n")
        except FileWriteError as cause:
            raise CheckpointError(str(cause)) from cause


class SqliteCheckpointer:
    """A row in the caller's SQLite database, within the caller's transaction: rows and checkpoint commit together.

    It never commits. `name` tells several readers of one database apart.
    """

    def __init__(self, database: sqlite3.Connection, name: str) -> None:
        self._database = database
        self._name = name

    def create_table(self) -> None:
        """Make the table ``ledger_checkpoints`` if it is not there. Raises `CheckpointError`."""
        self._execute(
            "CREATE TABLE IF NOT EXISTS ledger_checkpoints"
            " (name TEXT PRIMARY KEY, block_number INTEGER NOT NULL, transaction_id TEXT NOT NULL)"
        )

    def load(self) -> Checkpoint | None:
        """The row; None when there is none. Raises `CheckpointError`."""
        rows = self._execute("SELECT block_number, transaction_id FROM ledger_checkpoints WHERE name = ?", self._name)
        return Checkpoint(*rows[0]) if rows else None

    def save(self, checkpoint: Checkpoint) -> None:
        """Insert or replace the row, not yet committed. Raises `CheckpointError`."""
        self._execute(
            "INSERT OR REPLACE INTO ledger_checkpoints (name, block_number, transaction_id) VALUES (?, ?, ?)",
            self._name,
            checkpoint.block_number,
            checkpoint.tx_id,
        )

    def _execute(self, statement: str, *values: str | int) -> list[tuple[int, str]]:
        try:
            return self._database.execute(statement, values).fetchall()
        except sqlite3.Error as cause:
            raise CheckpointError(f"checkpoint {self._name}: {cause}") from cause
