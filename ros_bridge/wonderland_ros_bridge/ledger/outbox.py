"""What was received and is not on the ledger yet: a file that survives kills and power cuts.

A message leaves it when the ledger has it, or when it is moved to the rejected, with the reason. The batch that a
message goes with is written down before it is sent: what is sent again is the same batch, so the ledger can tell.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import sqlite3
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from wonderland_ros_bridge.errors import SpoolError
from wonderland_ros_bridge.ledger import envelope
from wonderland_ros_bridge.ledger.envelope import Batch, Encoding, Message, characters

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")
APPLICATION_ID: Final = 0x57_52_42_31
"""``WRB1``."""
VERSION: Final = 1
_TABLES: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value ANY NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE topics (topic TEXT PRIMARY KEY, received INTEGER NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE messages (
  id INTEGER PRIMARY KEY AUTOINCREMENT, topic TEXT NOT NULL, encoding TEXT NOT NULL, type TEXT NOT NULL,
  type_hash TEXT NOT NULL, seq INTEGER NOT NULL, t_ms INTEGER NOT NULL, data BLOB, sha256 TEXT, size INTEGER,
  batch INTEGER
) STRICT;
CREATE INDEX messages_by_topic ON messages (topic, id);
CREATE TABLE definitions (
  type TEXT NOT NULL, type_hash TEXT NOT NULL, definition TEXT NOT NULL, stored INTEGER NOT NULL,
  PRIMARY KEY (type, type_hash)
) STRICT, WITHOUT ROWID;
CREATE TABLE rejected (
  id INTEGER PRIMARY KEY AUTOINCREMENT, topic TEXT NOT NULL, asset_id TEXT NOT NULL, t_ms INTEGER NOT NULL,
  code TEXT NOT NULL, reason TEXT NOT NULL, value TEXT NOT NULL
) STRICT;
CREATE TABLE seen (source TEXT PRIMARY KEY, batch INTEGER NOT NULL) STRICT, WITHOUT ROWID;
"""


@dataclass(frozen=True, slots=True)
class Received:
    """A message that a wire brought, on its way into the outbox."""

    topic: str
    encoding: Encoding
    type: str
    type_hash: str
    message: Message


class Outbox:
    """One file for one bridge. Raises SpoolError.

    A disk takes its time: once a loop runs, call it by ``run``, which uses one thread, so that all comes in order.
    """

    def __init__(self, path: Path, *, bridge: str, random_bytes: Callable[[int], bytes] = os.urandom) -> None:
        self._what = f"spool {path}"
        self._thread = ThreadPoolExecutor(1, "outbox")
        self._lock = _locked(path)
        self._connection: sqlite3.Connection | None = None
        try:
            with self._errors():
                self._connection = sqlite3.connect(path, isolation_level=None, timeout=5, check_same_thread=False)
                path.chmod(0o600)
                self._open(bridge, random_bytes)
        except SpoolError:
            self.close()
            raise
        self.bridge: Final = bridge
        self.epoch: Final = str(self._meta("epoch"))
        (total,) = self._one("SELECT COALESCE(SUM(LENGTH(data)), 0) + 200 * COUNT(*) FROM messages")
        self.pending_bytes: int = total
        """Of what waits, about: what the bound is for."""

    async def run(self, work: Callable[_Given, _Result], *args: _Given.args, **kwargs: _Given.kwargs) -> _Result:
        """Call one of this outbox's methods without holding the loop up."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, lambda: work(*args, **kwargs))

    def close(self) -> None:
        """Give the file back; all that is in it stays."""
        self._thread.shutdown()
        if self._connection is not None:
            self._connection.close()
        os.close(self._lock)

    def received(self, topic: str) -> int:
        """How many messages of a topic were ever received."""
        found = self._query("SELECT received FROM topics WHERE topic = ?", topic)
        return int(found[0][0]) if found else 0

    def put(
        self, messages: Sequence[Received], counts: dict[str, int], definitions: Sequence[tuple[str, str, str]]
    ) -> None:
        """Keep messages, what was received of each topic, and definitions (type, hash, text): all or nothing."""
        with self._transaction() as database:
            database.executemany(
                _INSERT,
                [_row(each, each.message) for each in messages],
            )
            database.executemany("INSERT OR REPLACE INTO topics VALUES (?, ?)", list(counts.items()))
            database.executemany("INSERT OR IGNORE INTO definitions VALUES (?, ?, ?, 0)", list(definitions))
        self.pending_bytes += sum(200 + len(each.message.data or b"") for each in messages)

    def waiting(self) -> list[str]:
        """Topics of which something waits."""
        return [topic for (topic,) in self._query("SELECT DISTINCT topic FROM messages ORDER BY topic")]

    def pending(self) -> int:
        """How many messages wait."""
        return int(self._one("SELECT COUNT(*) FROM messages")[0])

    def next_batch(self, topic: str, *, max_messages: int, max_characters: int) -> tuple[Batch, bool] | None:
        """The batch to send next, and whether it may have been sent before; None when nothing waits."""
        begun = self._query(
            "SELECT batch FROM messages WHERE topic = ? AND batch IS NOT NULL ORDER BY id LIMIT 1", topic
        )
        if begun:
            rows = self._query(_OF_BATCH, topic, begun[0][0])
            return self._batch(topic, int(begun[0][0]), rows), True
        rows = self._query(_OLDEST, topic, max_messages)
        if not rows:
            return None
        chosen: list[Any] = []
        taken = 0
        for row in rows:
            taken += characters(_message(row))
            if chosen and (taken > max_characters or row[1:4] != chosen[0][1:4]):
                break
            chosen.append(row)
        with self._transaction() as database:
            number = int(self._meta("last_batch")) + 1
            database.execute("UPDATE meta SET value = ? WHERE name = 'last_batch'", (number,))
            database.execute(
                "UPDATE messages SET batch = ? WHERE topic = ? AND id BETWEEN ? AND ?",
                (number, topic, chosen[0][0], chosen[-1][0]),
            )
        return self._batch(topic, number, chosen), False

    def settle(self, batch: Batch) -> None:
        """The ledger has this batch."""
        with self._transaction() as database:
            database.execute("DELETE FROM messages WHERE topic = ? AND batch = ?", (batch.topic, batch.batch))
        self._less(batch)

    def reject(self, batch: Batch, asset_id: str, t_ms: int, code: str, reason: str) -> None:
        """The ledger refuses this batch for good: it is kept with the reason."""
        with self._transaction() as database:
            database.execute(
                "INSERT INTO rejected (topic, asset_id, t_ms, code, reason, value) VALUES (?, ?, ?, ?, ?, ?)",
                (batch.topic, asset_id, t_ms, code, reason, batch.value()),
            )
            database.execute("DELETE FROM messages WHERE topic = ? AND batch = ?", (batch.topic, batch.batch))
        self._less(batch)

    def send_again(self) -> int:
        """Put all that was refused back, behind what waits; returns how many messages that is."""
        count = 0
        with self._transaction() as database:
            for number, value in database.execute("SELECT id, value FROM rejected ORDER BY id").fetchall():
                batch = envelope.parse(value)
                database.executemany(_INSERT, [_row(batch, each) for each in batch.messages])
                database.execute("DELETE FROM rejected WHERE id = ?", (number,))
                count += len(batch.messages)
        return count

    def forget(self, number: int) -> int:
        """Remove one refused batch for good; returns how many batches that is."""
        with self._transaction() as database:
            return database.execute("DELETE FROM rejected WHERE id = ?", (number,)).rowcount

    def definition(self, kind: str, type_hash: str) -> tuple[str, bool] | None:
        """A type's definition, and whether the ledger has it."""
        found = self._query(
            "SELECT definition, stored FROM definitions WHERE type = ? AND type_hash = ?", kind, type_hash
        )
        return (str(found[0][0]), bool(found[0][1])) if found else None

    def definition_stored(self, kind: str, type_hash: str) -> None:
        """The ledger has it."""
        with self._transaction() as database:
            database.execute("UPDATE definitions SET stored = 1 WHERE type = ? AND type_hash = ?", (kind, type_hash))

    def place(self) -> int | None:
        """The block from which the ledger is to be read; None at the first start."""
        found = self._query("SELECT value FROM meta WHERE name = 'next_block'")
        return int(found[0][0]) if found else None

    def keep_place(self, next_block: int, seen: dict[str, int]) -> None:
        """All before this block is dealt with, and these sources' batches up to these numbers."""
        with self._transaction() as database:
            database.execute("INSERT OR REPLACE INTO meta VALUES ('next_block', ?)", (next_block,))
            database.executemany("INSERT OR REPLACE INTO seen VALUES (?, ?)", list(seen.items()))

    def last_seen(self, source: str) -> int:
        """The last batch of a source that was dealt with; 0 for none."""
        found = self._query("SELECT batch FROM seen WHERE source = ?", source)
        return int(found[0][0]) if found else 0

    def _open(self, bridge: str, random_bytes: Callable[[int], bytes]) -> None:
        database = self._database
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA synchronous = FULL")
        database.execute("PRAGMA journal_size_limit = 4194304")
        application, version = self._one("PRAGMA application_id")[0], self._one("PRAGMA user_version")[0]
        if not self._one("SELECT COUNT(*) FROM sqlite_schema")[0] and not version:
            database.executescript(
                f"BEGIN IMMEDIATE; {_TABLES} PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION};"
            )
            database.executemany(
                "INSERT INTO meta VALUES (?, ?)",
                [("bridge", bridge), ("epoch", random_bytes(8).hex()), ("last_batch", 0)],
            )
            database.execute("COMMIT")
        elif application != APPLICATION_ID:
            raise SpoolError(f"{self._what}: an SQLite file of something else; choose another spool")
        elif version != VERSION:
            raise SpoolError(f"{self._what}: written by another version (format {version}, this one reads {VERSION})")
        if (owner := self._meta("bridge")) != bridge:
            raise SpoolError(
                f"{self._what}: belongs to bridge {owner!r}, not {bridge!r}; each needs a spool of its own"
            )

    def _batch(self, topic: str, number: int, rows: list[Any]) -> Batch:
        _, encoding, kind, type_hash, *_rest = rows[0]
        return Batch(
            bridge=self.bridge,
            epoch=self.epoch,
            batch=number,
            topic=topic,
            encoding=encoding,
            type=kind,
            type_hash=type_hash,
            messages=tuple(map(_message, rows)),
        )

    def _less(self, batch: Batch) -> None:
        self.pending_bytes -= sum(200 + len(each.data or b"") for each in batch.messages)

    @property
    def _database(self) -> sqlite3.Connection:
        assert self._connection is not None
        return self._connection

    def _meta(self, name: str) -> Any:
        return self._one("SELECT value FROM meta WHERE name = ?", name)[0]

    def _one(self, statement: str, *values: Any) -> Any:
        return self._query(statement, *values)[0]

    def _query(self, statement: str, *values: Any) -> list[Any]:
        with self._errors():
            return self._database.execute(statement, values).fetchall()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        database = self._database
        with self._errors():
            try:
                database.execute("BEGIN IMMEDIATE")
                yield database
                database.execute("COMMIT")
            finally:
                if database.in_transaction:
                    with contextlib.suppress(sqlite3.Error):
                        database.execute("ROLLBACK")

    @contextlib.contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as cause:
            raise SpoolError(f"{self._what}: {cause}") from cause
        except OSError as cause:
            raise SpoolError(f"{self._what}: {cause.strerror or cause}") from cause


_INSERT: Final = (
    "INSERT INTO messages (topic, encoding, type, type_hash, seq, t_ms, data, sha256, size) "
    "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
)
_ALL: Final = "SELECT id, encoding, type, type_hash, seq, t_ms, data, sha256, size FROM messages"
_OLDEST: Final = f"{_ALL} WHERE topic = ? ORDER BY id LIMIT ?"
_OF_BATCH: Final = f"{_ALL} WHERE topic = ? AND batch = ? ORDER BY id"


def _row(of: Received | Batch, message: Message) -> tuple[Any, ...]:
    kind = of.topic, of.encoding, of.type, of.type_hash
    return (*kind, message.seq, message.t_ms, message.data, message.sha256, message.size)


def _message(row: Any) -> Message:
    *_, seq, t_ms, data, sha256, size = row
    return Message(seq=seq, t_ms=t_ms, data=data, sha256=sha256, size=size)


def _locked(path: Path) -> int:
    """A lock that the kernel takes back when the process ends, however it ends."""
    lock = path.with_name(f"{path.name}.lock")
    try:
        handle = os.open(lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
    except OSError as cause:
        raise SpoolError(f"{lock}: cannot be opened ({cause.strerror or cause}); does its directory exist?") from cause
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as cause:
        os.close(handle)
        raise SpoolError(f"{path}: another bridge uses this spool; stop it, or give this one its own") from cause
    return handle
