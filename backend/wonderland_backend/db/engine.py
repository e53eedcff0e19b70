"""Connections: one `Database` for an application, with what SQLite and PostgreSQL each need."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import sqlite3
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.ext.asyncio import AsyncConnection, AsyncEngine, AsyncSession, create_async_engine

from wonderland_backend.errors import SettingsError

DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+psycopg", "postgres": "postgresql+psycopg"}
# Its debug lines have the values of every statement, operators' numbers and their salts among them.
logging.getLogger("aiosqlite").setLevel(logging.INFO)

BUSY_TIMEOUT_S: Final = 30
POOL_TIMEOUT_S: Final = 10
"""Longer nobody waits for a connection: the answer is 503 and when to ask again."""
_WRITES: Final = "wonderland_writes"


def parse_url(text: str) -> URL:
    """The URL with our drivers. Raises `SettingsError` for another database or a text that is no URL."""
    try:
        url = make_url(text)
    except ArgumentError:
        raise SettingsError(
            "--database: not a URL; use sqlite:///path/to/file.db or postgresql://user@host/name"
        ) from None
    kind = url.get_backend_name()
    driver = DRIVERS.get(kind)
    if driver is None:
        raise SettingsError(f"--database: {kind} is not supported; use sqlite or postgresql")
    if kind == "sqlite" and url.database in {None, "", ":memory:"}:
        raise SettingsError("--database: SQLite needs a file, for example sqlite:///wonderland.db")
    return url.set(drivername=driver)


class Database:
    """An engine, and the rule that SQLite has one writer at a time."""

    def __init__(self, url: str, *, pool_size: int = 10) -> None:
        self.url = parse_url(url)
        self.is_sqlite = self.url.get_backend_name() == "sqlite"
        options: dict[str, Any] = {
            "pool_size": pool_size,
            "max_overflow": pool_size,
            "pool_timeout": POOL_TIMEOUT_S,
            # An error's text ends up in logs; what was to be stored may be somebody's number, or the salt of one.
            "hide_parameters": True,
        }
        if self.is_sqlite:
            options["connect_args"] = {"timeout": BUSY_TIMEOUT_S}
        else:
            options |= {"pool_pre_ping": True, "connect_args": {"connect_timeout": 10}}
        self.engine: AsyncEngine = create_async_engine(self.url, **options)
        self._snapshots = self.engine
        if self.is_sqlite:
            event.listen(self.engine.sync_engine, "connect", _prepare_sqlite)
            event.listen(self.engine.sync_engine, "begin", _begin_sqlite)
        else:
            self._snapshots = self.engine.execution_options(isolation_level="REPEATABLE READ")
        self._writer = asyncio.Lock()

    def exists(self) -> bool:
        """Whether there is a database at all: SQLite would quietly make an empty one."""
        return not self.is_sqlite or Path(self.url.database or "").is_file()

    @contextlib.asynccontextmanager
    async def read(self) -> AsyncIterator[AsyncSession]:
        """A session for reading; what it sees is one snapshot."""
        async with AsyncSession(self._snapshots, expire_on_commit=False) as session:
            yield session

    @contextlib.asynccontextmanager
    async def write(self) -> AsyncIterator[AsyncConnection]:
        """A transaction: committed at the end, rolled back by an exception."""
        async with contextlib.AsyncExitStack() as stack:
            if self.is_sqlite:
                await stack.enter_async_context(self._writer)
            connection = await stack.enter_async_context(self.engine.connect())
            await connection.execution_options(**{_WRITES: True})
            async with connection.begin():
                yield connection

    async def close(self) -> None:
        """Close all connections; nothing may be asked of it after."""
        await self.engine.dispose()


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    # The driver's own transactions begin late and not before reads; ours are begun by _begin_sqlite.
    connection.isolation_level = None
    cursor = connection.cursor()
    try:
        _write_ahead(cursor)
        # FULL: what was acknowledged to an agent must survive a power cut.
        cursor.execute("PRAGMA synchronous=FULL")
        cursor.execute("PRAGMA foreign_keys=ON")
        cursor.execute("PRAGMA temp_store=MEMORY")
        cursor.execute("PRAGMA cache_size=-32000")
    finally:
        cursor.close()


def _write_ahead(cursor: Any) -> None:
    # SQLite does not wait for another connection that makes the same change: it says "locked" at once,
    # whatever the timeout. Two servers that start together on a new database meet here.
    deadline_s = time.monotonic() + BUSY_TIMEOUT_S
    while True:
        try:
            cursor.execute("PRAGMA journal_mode=WAL")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or time.monotonic() > deadline_s:
                raise
            time.sleep(0.01)
        else:
            return


def _begin_sqlite(connection: Connection) -> None:
    # A transaction that will write takes the lock at once: one that read first could no longer get it.
    immediate = connection.get_execution_options().get(_WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if immediate else "BEGIN")
