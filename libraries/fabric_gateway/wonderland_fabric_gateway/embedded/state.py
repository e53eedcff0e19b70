"""The ledger's storage: blocks, transaction index, current state and history in one SQLite file.

Everything that a block changes is written in one SQLite transaction, with the write-ahead log synced before it
returns (``synchronous=FULL``): a block is there whole or not at all, also after kill −9 and a power cut, and a
restart replays nothing. One `StateWriter` belongs to the committing thread; `StateReader` belongs to the thread that
answers clients, and sees the last committed block.

Keys are stored as UTF-8 bytes, so that they sort as Fabric sorts them.
"""

from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.embedded.errors import DirectoryError, LedgerCorruptedError, StorageError
from wonderland_fabric_gateway.embedded.seal import SEAL, TABLES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from wonderland_fabric_gateway.embedded.known_rows import KnownRows
    from wonderland_fabric_gateway.embedded.range_reads import Version
    from wonderland_fabric_gateway.embedded.rwset import KeyPolicy, Write
    from wonderland_fabric_gateway.embedded.seal import Row, Seal

APPLICATION_ID: Final = 0x574C4447  # "WLDG", in the SQLite header: tells this file from any other database
SCHEMA_VERSION: Final = 3
RANGE_PAGE: Final = 256
LAST_CONFIG: Final = "last_config"
"""The row of `meta` with the number of the block whose configuration is in force."""
LOWEST_KEY: Final = b"\x01"
"""Where an open range starts: composite keys begin with U+0000 and are only found by asking for them, as in Fabric."""

SCHEMA: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value BLOB NOT NULL) WITHOUT ROWID, STRICT;
CREATE TABLE block (number INTEGER PRIMARY KEY, header_hash BLOB NOT NULL UNIQUE, raw BLOB NOT NULL) STRICT;
CREATE TABLE tx (
  tx_id TEXT PRIMARY KEY, block INTEGER NOT NULL, position INTEGER NOT NULL, code INTEGER NOT NULL
) WITHOUT ROWID, STRICT;
CREATE TABLE state (
  namespace TEXT NOT NULL, key BLOB NOT NULL, value BLOB NOT NULL, block INTEGER NOT NULL, position INTEGER NOT NULL,
  policy BLOB,
  PRIMARY KEY (namespace, key)
) WITHOUT ROWID, STRICT;
CREATE TABLE history (
  namespace TEXT NOT NULL, key BLOB NOT NULL, block INTEGER NOT NULL, position INTEGER NOT NULL,
  tx_id TEXT NOT NULL, timestamp_ms INTEGER NOT NULL, value BLOB,
  PRIMARY KEY (namespace, key, block, position)
) WITHOUT ROWID, STRICT;
"""
_UPGRADES: Final = {1: "ALTER TABLE state ADD COLUMN policy BLOB;", 2: ""}
"""What makes the schema of one version into that of the next. With 3 came the seal, which an older one would break."""


@dataclass(frozen=True, slots=True)
class TxLocation:
    """Where a transaction is: block, position in it, and the validation code it got (0 is VALID)."""

    block: int
    position: int
    code: int


@dataclass(frozen=True, slots=True)
class Modification:
    """One change of a key. A deletion has an empty value and `is_delete`."""

    tx_id: str
    timestamp_ms: int
    value: bytes
    is_delete: bool


@dataclass(frozen=True, slots=True)
class CommittedTx:
    """What a block stores about one of its transactions; `writes` and `policies` are empty unless it is VALID."""

    tx_id: str
    code: int
    timestamp_ms: int
    writes: Sequence[Write]
    policies: Sequence[KeyPolicy] = ()


@dataclass(frozen=True, slots=True)
class Tip:
    """The last block: number and header hash. An empty ledger has number −1 and an empty hash."""

    number: int
    header_hash: bytes


def create(path: Path) -> None:
    """Make an empty store unless there is one. Raises `DirectoryError` if the file is something else."""
    with contextlib.closing(_connect(path)) as db:
        _check_or_create_schema(db, path)


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what SQLite says of a damaged file into `LedgerCorruptedError`."""
    try:
        yield
    except sqlite3.DatabaseError as cause:
        raise LedgerCorruptedError(f"{path} is damaged ({cause}); restore it from a copy") from cause


class StateReader:
    """Read access to the committed state. Not shared between threads."""

    def __init__(self, path: Path, rows: KnownRows | None = None) -> None:
        """With `rows`, state and history that are not theirs are refused: `TableCorruptedError`."""
        self._rows = rows
        self._db = _connect(path)
        self._db.execute("PRAGMA query_only=ON")

    def close(self) -> None:
        """Give the file back; the reader is of no use afterwards."""
        self._db.close()

    @contextlib.contextmanager
    def snapshot(self) -> Iterator[None]:
        """Within it, all reads see the same block, whatever is committed meanwhile."""
        self._db.execute("BEGIN")
        try:
            yield
        finally:
            self._db.execute("COMMIT")

    def get(self, namespace: str, key: str) -> tuple[bytes, Version] | None:
        """Value and version of a key, or None."""
        row = _state_row(self._db, self._rows, namespace, key)
        return None if row is None else (row[2], (row[3], row[4]))

    def range(self, namespace: str, start: str, end: str) -> Iterator[tuple[str, bytes, Version]]:
        """Keys from `start` (included) to `end` (excluded), ascending; "" leaves a side open (see `LOWEST_KEY`)."""
        first = start.encode() or LOWEST_KEY
        rows = self._pages(namespace, first, end.encode())
        for _, key, value, block, position, _ in (
            rows if self._rows is None else self._rows.checked_range(namespace, first, end.encode(), rows)
        ):
            yield key.decode(), value, (block, position)

    def require_sound(self) -> None:
        """Raise `TableCorruptedError` once a row was read that is not this ledger's."""
        if self._rows is not None:
            self._rows.require_sound()

    def _pages(self, namespace: str, after: bytes, end: bytes) -> Iterator[Any]:
        including = True
        while True:
            rows = self._db.execute(
                "SELECT * FROM state WHERE namespace=? AND "  # noqa: S608 - fixed texts only
                f"key {'>=' if including else '>'} ? {'AND key < ?' if end else ''} ORDER BY key LIMIT {RANGE_PAGE}",
                (namespace, after, end) if end else (namespace, after),
            ).fetchall()
            yield from rows
            if len(rows) < RANGE_PAGE:
                return
            after, including = rows[-1][1], False

    def history(self, namespace: str, key: str) -> Iterator[Modification]:
        """Every committed change of a key, newest first."""
        if self._rows is not None:
            place = namespace, key.encode()
            every = self._db.execute("SELECT * FROM history WHERE namespace=? AND key=?", place).fetchall()
            self._rows.check_history(place, every)
        before: tuple[int, int] = (1 << 62, 0)
        while True:
            rows = self._db.execute(
                "SELECT tx_id, timestamp_ms, value, block, position FROM history "
                "WHERE namespace=? AND key=? AND (block, position) < (?, ?) "
                "ORDER BY block DESC, position DESC LIMIT ?",
                (namespace, key.encode(), *before, RANGE_PAGE),
            ).fetchall()
            for tx_id, timestamp_ms, value, _, _ in rows:
                yield Modification(tx_id, timestamp_ms, value or b"", is_delete=value is None)
            if len(rows) < RANGE_PAGE:
                return
            before = rows[-1][3], rows[-1][4]

    def transaction(self, tx_id: str) -> TxLocation | None:
        """Where the first transaction with this id is, or None."""
        row = self._db.execute("SELECT block, position, code FROM tx WHERE tx_id=?", (tx_id,)).fetchone()
        return None if row is None else TxLocation(*row)

    def block(self, number: int) -> bytes | None:
        """A block's bytes (``common.Block``), or None."""
        row = self._db.execute("SELECT raw FROM block WHERE number=?", (number,)).fetchone()
        return None if row is None else bytes(row[0])

    def block_number(self, header_hash: bytes) -> int | None:
        """The number of the block with this header hash, or None."""
        row = self._db.execute("SELECT number FROM block WHERE header_hash=?", (header_hash,)).fetchone()
        return None if row is None else int(row[0])

    def tip(self) -> Tip:
        """The last committed block."""
        row = self._db.execute("SELECT number, header_hash FROM block ORDER BY number DESC LIMIT 1").fetchone()
        return Tip(-1, b"") if row is None else Tip(*row)

    def block_count(self) -> int:
        """How many blocks are stored; the tip's number plus one unless some are missing."""
        return int(self._db.execute("SELECT count(*) FROM block").fetchone()[0])

    def meta(self, name: str) -> bytes | None:
        """A named value of the store itself, or None."""
        row = self._db.execute("SELECT value FROM meta WHERE name=?", (name,)).fetchone()
        return None if row is None else bytes(row[0])

    def sealed_rows(self) -> Iterator[tuple[str, Row]]:
        """Every row that is under the seal, with its table's name."""
        for table in TABLES:
            but = " WHERE name != ?" if table == "meta" else ""
            for row in self._db.execute(f"SELECT * FROM {table}{but}", (SEAL,) if but else ()):  # noqa: S608
                yield table, row


class StateWriter:
    """Write access; one per store, owned by the committing thread. With a `seal` each block is sealed."""

    def __init__(self, path: Path | None, *, max_pages: int | None = None, seal: Seal | None = None) -> None:
        self._db = _connect(path)
        self._seal = seal
        self._rows = None if seal is None else seal.rows
        if max_pages is not None:
            self.limit_pages(max_pages)

    def limit_pages(self, max_pages: int) -> None:
        """Bound the file to so many pages of 4 KiB; a block that does not fit fails with `StorageError`."""
        self._db.execute(f"PRAGMA max_page_count={max_pages:d}")

    def close(self) -> None:
        """Give the file back; the last one to do so folds the write-ahead log into it."""
        self._db.close()

    def version(self, namespace: str, key: str) -> Version | None:
        """The committed version of a key, or None."""
        row = self._state_row(namespace, key)
        return None if row is None else (row[3], row[4])

    def policy(self, namespace: str, key: str) -> bytes | None:
        """Who must endorse a change of the key (``common.SignaturePolicyEnvelope``); None: the contract's policy."""
        row = self._state_row(namespace, key)
        return None if row is None else row[5]

    def versions(
        self, namespace: str, start: str, end: str, *, end_included: bool = False
    ) -> Iterator[tuple[str, Version]]:
        """Keys of a range with their committed versions, ascending; "" leaves a side open."""
        condition = f"AND key {'<=' if end_included else '<'} ?" if end else ""
        first, last = start.encode() or LOWEST_KEY, end.encode()
        rows: Iterator[Any] = self._db.execute(
            f"SELECT * FROM state WHERE namespace=? AND key >= ? {condition} ORDER BY key",  # noqa: S608
            (namespace, first, *((last,) if last else ())),
        )
        if self._rows is not None:
            rows = self._rows.checked_range(namespace, first, last, rows, end_included=end_included)
        for _, key, _, block, position, _ in rows:
            yield key.decode(), (block, position)

    def has_transaction(self, tx_id: str) -> bool:
        """Whether a transaction with this id is already in a block."""
        return self._db.execute("SELECT 1 FROM tx WHERE tx_id=?", (tx_id,)).fetchone() is not None

    def stage_block(
        self,
        number: int,
        header_hash: bytes,
        raw: bytes,
        transactions: Sequence[CommittedTx],
        meta: Mapping[str, bytes] | None = None,
    ) -> None:
        """Prepare a block with all its effects; `commit` makes it durable. Raises `StorageError`; nothing is kept."""
        with self._failing(number):
            if self._seal is not None:
                self._seal.begin()
            self._db.execute("BEGIN IMMEDIATE")
            self._insert("block", (number, header_hash, raw))
            for position, tx in enumerate(transactions):
                if tx.tx_id and not self.has_transaction(tx.tx_id):  # a repeated id keeps its first place, as in Fabric
                    self._insert("tx", (tx.tx_id, number, position, tx.code))
                self._apply(number, position, tx)
            for name, value in (meta or {}).items():
                old = self._db.execute("SELECT * FROM meta WHERE name=?", (name,)).fetchone()
                self._insert("meta", (name, value), old)
            self._write_seal(number, header_hash)

    def seal_as_is(self, tip: Tip) -> None:
        """Seal what is stored, for the first time. Raises `StorageError`."""
        with self._failing(tip.number):
            self._write_seal(tip.number, tip.header_hash)

    def commit(self, number: int) -> None:
        """Write the staged block durably (the only slow step; it may run in another thread). Raises `StorageError`."""
        with self._failing(number):
            self._db.execute("COMMIT")

    def keep(self) -> None:
        """The staged block is committed. Not in another thread: what is read is held against it."""
        if self._seal is not None:
            self._seal.keep()

    @contextlib.contextmanager
    def _failing(self, number: int) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, LedgerCorruptedError) as cause:
            if self._db.in_transaction:
                with contextlib.suppress(sqlite3.Error):
                    self._db.execute("ROLLBACK")
            if isinstance(cause, LedgerCorruptedError):
                raise
            full = getattr(cause, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
            raise StorageError(f"block {number} could not be written: {cause}", full=full) from cause

    def _apply(self, number: int, position: int, tx: CommittedTx) -> None:
        for write in {(each.namespace, each.key): each for each in tx.writes}.values():
            place = write.namespace, write.key.encode()
            old = _state_row(self._db, None, write.namespace, write.key)  # checked when it is written over
            if write.value is not None:
                # A key keeps its own endorsement policy while only its value changes.
                self._insert("state", (*place, write.value, number, position, old[5] if old else None), old)
            elif old is not None:
                self._db.execute("DELETE FROM state WHERE namespace=? AND key=?", place)
                self._sealed("state", old, None)
            self._insert("history", (*place, number, position, tx.tx_id, tx.timestamp_ms, write.value))
        for each in tx.policies:
            old = _state_row(self._db, None, each.namespace, each.key)
            if old is not None:
                self._insert("state", (*old[:3], number, position, each.policy), old)

    def _state_row(self, namespace: str, key: str) -> Any:
        return _state_row(self._db, self._rows, namespace, key)

    def _insert(self, table: str, row: Row, old: Row | None = None) -> None:
        """Write a row in the place of `old`, which is None where there is none."""
        marks = ",".join("?" * len(row))
        self._db.execute(f"INSERT {'OR REPLACE ' if old else ''}INTO {table} VALUES ({marks})", row)  # noqa: S608
        self._sealed(table, old, row)

    def _sealed(self, table: str, old: Row | None, new: Row | None) -> None:
        if self._seal is not None:
            self._seal.replace(table, old, new)

    def _write_seal(self, number: int, header_hash: bytes) -> None:
        if self._seal is not None:
            value = self._seal.value(number, header_hash)
            self._db.execute("INSERT OR REPLACE INTO meta VALUES (?,?)", (SEAL, value))


def _state_row(db: sqlite3.Connection, rows: KnownRows | None, namespace: str, key: str) -> Any:
    place = namespace, key.encode()
    row = db.execute("SELECT * FROM state WHERE namespace=? AND key=?", place).fetchone()
    if rows is not None:
        rows.check(place, row)
    return row


def _connect(path: Path | None) -> sqlite3.Connection:
    """A connection; without a path to a temporary store that SQLite deletes by itself."""
    try:
        db = sqlite3.connect(
            path or "", isolation_level=None, timeout=10.0, cached_statements=64, check_same_thread=False
        )
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=FULL")
        db.execute("PRAGMA fullfsync=ON")  # macOS: without it fsync does not reach the platters; elsewhere no effect
        db.execute("PRAGMA cache_size=-16384")
        db.execute("PRAGMA temp_store=MEMORY")
    except sqlite3.DatabaseError as cause:
        raise _unusable(path, cause) from cause
    return db


def _check_or_create_schema(db: sqlite3.Connection, path: Path) -> None:
    try:
        application, version = (
            db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version")
        )
        if application == APPLICATION_ID:
            for older in range(version, SCHEMA_VERSION):
                db.executescript(f"BEGIN IMMEDIATE; {_UPGRADES[older]} PRAGMA user_version={older + 1}; COMMIT;")
                version = older + 1
            if version != SCHEMA_VERSION:
                raise DirectoryError(
                    f"{path} was written by another version of Wonderland (schema {version}, this one has "
                    f"{SCHEMA_VERSION}); start that version, or use another directory"
                )
            return
        if db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            raise DirectoryError(f"{path} is a database, but not a ledger's; choose another directory")
        db.executescript(
            f"BEGIN IMMEDIATE; {SCHEMA} PRAGMA application_id={APPLICATION_ID}; "
            f"PRAGMA user_version={SCHEMA_VERSION}; COMMIT;"
        )
    except sqlite3.DatabaseError as cause:
        raise _unusable(path, cause) from cause


def _unusable(path: Path | None, cause: sqlite3.DatabaseError) -> DirectoryError | LedgerCorruptedError:
    if getattr(cause, "sqlite_errorcode", None) in {sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT}:
        return LedgerCorruptedError(f"{path} is no sound SQLite file ({cause}); restore it from a copy")
    return DirectoryError(f"{path} cannot be opened as a ledger's store ({cause})")
