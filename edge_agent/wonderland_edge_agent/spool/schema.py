"""The spool's tables, and how its file is opened.

``records`` holds what the server has not acknowledged. ``class`` 0 is telemetry, 1 evidence, 2 a marker that says
which range of numbers was dropped: it stands at the last number of that range, so that numbers have no unexplained gap.
"""

from __future__ import annotations

import os
import sqlite3
import uuid
from pathlib import Path
from typing import Final

from wonderland_edge_agent.spool.errors import SpoolCorruptError, SpoolError, SpoolFull

VERSION: Final = 1
APPLICATION_ID: Final = 0x57_50_53_31
"""``WPS1``: lets `file` and `open_database` tell a spool from any other SQLite file."""
PAGE_BYTES: Final = 4096

TELEMETRY: Final = 0
EVIDENCE: Final = 1
MARKER: Final = 2

_TABLES: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value ANY NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE records (
  seq INTEGER PRIMARY KEY, class INTEGER NOT NULL, kind TEXT NOT NULL, t_ms INTEGER NOT NULL, body BLOB NOT NULL
) STRICT;
CREATE INDEX records_by_class ON records (class, seq);
CREATE TABLE secrets (name TEXT PRIMARY KEY, value BLOB NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE sessions (session_id TEXT PRIMARY KEY, state BLOB NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE notes (name TEXT PRIMARY KEY, value BLOB NOT NULL) STRICT, WITHOUT ROWID;
"""
_FULL_CODES: Final = frozenset(
    {
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_IOERR_WRITE,  # how SQLite reports a disk quota or a limit of file size
        sqlite3.SQLITE_IOERR_SHMSIZE,
        sqlite3.SQLITE_IOERR_SHMOPEN,
    }
)
_CORRUPT_CODES: Final = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB})


def translated(error: sqlite3.Error, what: str) -> SpoolError:
    """The spool's own error for one of SQLite's."""
    code = getattr(error, "sqlite_errorcode", None)
    if code in _FULL_CODES:
        return SpoolFull(f"{what}: the disk is full ({error}); free space on it, the agent goes on by itself")
    if code is not None and code & 0xFF in _CORRUPT_CODES:
        return SpoolCorruptError(
            f"{what}: the file is no spool or is damaged ({error}); keep a copy, then move the directory aside: "
            "the agent starts a new spool"
        )
    return SpoolError(f"{what}: {error}")


def open_database(path: Path, *, owner: str, max_bytes: int) -> sqlite3.Connection:
    """The spool's file, made if there is none, readable by its owner only. Raises `SpoolError`.

    ``owner`` is the pad's id: a spool that another pad has written is refused.
    """
    what = f"spool {path}"
    try:
        # SQLite gives its journal files the mode of the database, so that it is created here with the right one.
        os.close(os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600))
    except OSError as cause:
        raise SpoolError(f"{what}: cannot be opened ({cause.strerror or cause})") from cause
    connection: sqlite3.Connection | None = None
    try:
        connection = sqlite3.connect(path, isolation_level=None, timeout=5.0, check_same_thread=False)
        _configure(connection, max_bytes)
        if (
            _value(connection, "PRAGMA user_version") == 0
            and _value(connection, "SELECT count(*) FROM sqlite_schema") == 0
        ):
            _create(connection, owner)
        _check(connection, owner, what)
    except sqlite3.Error as cause:
        if connection is not None:
            connection.close()
        raise translated(cause, what) from cause
    except SpoolError:
        if connection is not None:
            connection.close()
        raise
    return connection


def _configure(connection: sqlite3.Connection, max_bytes: int) -> None:
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    connection.execute("PRAGMA secure_delete = ON")  # a used prekey must not linger in free pages
    mode = _value(connection, "PRAGMA journal_mode = WAL")
    if mode != "wal":
        raise SpoolError(f"the file system gives SQLite no write-ahead log (journal mode {mode}); use a local disk")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA wal_autocheckpoint = 256")
    connection.execute("PRAGMA journal_size_limit = 1048576")
    connection.execute("PRAGMA cache_size = -512")
    connection.execute("PRAGMA temp_store = MEMORY")
    connection.execute(f"PRAGMA max_page_count = {max(256, max_bytes // PAGE_BYTES)}")


def _create(connection: sqlite3.Connection, owner: str) -> None:
    # One transaction: a kill in between leaves an empty file, which the next start makes a spool.
    connection.executescript(
        f"BEGIN IMMEDIATE; {_TABLES} PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION};"
    )
    connection.executemany(
        "INSERT INTO meta VALUES (?, ?)",
        [("spool", uuid.uuid4().hex), ("owner", owner), ("last_seq", 0), ("acknowledged", 0), ("dropped", 0)],
    )
    connection.execute("COMMIT")


def _check(connection: sqlite3.Connection, owner: str, what: str) -> None:
    if _value(connection, "PRAGMA application_id") != APPLICATION_ID:
        raise SpoolCorruptError(f"{what}: an SQLite file of something else; choose another directory")
    version = _value(connection, "PRAGMA user_version")
    if version != VERSION:
        raise SpoolError(f"{what}: written by another version (format {version}, this one reads {VERSION})")
    theirs = _value(connection, "SELECT value FROM meta WHERE name = 'owner'")
    if theirs != owner:
        raise SpoolError(f"{what}: belongs to pad {theirs!r}, not {owner!r}; each pad needs a directory of its own")


def _value(connection: sqlite3.Connection, statement: str) -> object:
    row = connection.execute(statement).fetchone()
    return None if row is None else row[0]
