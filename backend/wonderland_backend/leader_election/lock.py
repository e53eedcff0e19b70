"""Which backend is the leader: whoever holds the database's lock. A lock ends with the process or the connection.

PostgreSQL has advisory locks of a session for it; SQLite gets a locked file beside the database's own.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final, Protocol

from sqlalchemy import text
from sqlalchemy.engine import URL
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.ext.asyncio import AsyncConnection, create_async_engine
from sqlalchemy.pool import NullPool

from wonderland_backend.db.engine import parse_url
from wonderland_backend.errors import DatabaseError, SettingsError

KEY: Final = 0x776F6E6465726C64
"""Of the advisory lock in its database: any number that nobody else takes."""
TRY_EVERY_S: Final = 1.0
PROVE_EVERY_S: Final = 3.0
PROVE_WITHIN_S: Final = 20.0
"""A busy backend may be late to see the answer; one whose lock is gone cannot write in the meantime either."""
_NOTICE_THE_DEAD: Final = (
    # A machine that lost its power closes no connection; the server finds out within 20 s and frees the lock.
    "SET tcp_keepalives_idle = 10; SET tcp_keepalives_interval = 5; SET tcp_keepalives_count = 2"
)
_NAMED: Final = "wonderland-"
_HOLDER: Final = (
    "SELECT application_name FROM pg_locks JOIN pg_stat_activity USING (pid) WHERE locktype = 'advisory' AND granted "
    "AND classid = :high AND objid = :low AND objsubid = 1 "
    "AND pg_locks.database = (SELECT oid FROM pg_database WHERE datname = current_database())"
)


class Lock(Protocol):
    """The lock of one database."""

    async def take_lock(self) -> bool:
        """Whether it is ours now."""

    async def prove(self) -> None:
        """Raises `DatabaseError` where it is ours no longer."""

    async def release(self) -> None:
        """Give the lock back, so that another one can take it."""

    async def holder(self) -> str:
        """The name of whoever holds it; empty where nobody does, or it is not to be known just now."""


class PostgresLock:
    """An advisory lock, held by a connection of its own for as long as that lives."""

    def __init__(self, url: URL, name: str) -> None:
        self._engine = create_async_engine(
            url,
            poolclass=NullPool,
            isolation_level="AUTOCOMMIT",
            connect_args={"connect_timeout": 10, "application_name": _NAMED + name},
        )
        self._connection: AsyncConnection | None = None
        self._one_at_a_time = asyncio.Lock()

    async def take_lock(self) -> bool:
        """Whether it is ours now. Raises `DatabaseError` where the database does not answer."""
        try:
            async with self._one_at_a_time:
                if self._connection is None:
                    self._connection = await self._engine.connect()
                    await self._connection.execute(text(_NOTICE_THE_DEAD))
                return bool(await self._connection.scalar(text(f"SELECT pg_try_advisory_lock({KEY})")))
        except SQLAlchemyError as cause:
            await self.release()
            raise DatabaseError(f"--database: PostgreSQL does not answer ({_why(cause)})") from None

    async def holder(self) -> str:
        """As its connection is named: a name that ends with the lock."""
        try:
            async with self._one_at_a_time:
                if self._connection is None:
                    return ""
                named = await self._connection.scalar(text(_HOLDER), {"high": KEY >> 32, "low": KEY & 0xFFFFFFFF})
        except SQLAlchemyError:
            await self.release()
            return ""
        return str(named or "").removeprefix(_NAMED)

    async def prove(self) -> None:
        """The connection answers, so that its lock is still held. Raises `DatabaseError`."""
        assert self._connection is not None
        try:
            async with asyncio.timeout(PROVE_WITHIN_S):
                await self._connection.execute(text("SELECT 1"))
        except (SQLAlchemyError, TimeoutError) as cause:
            raise DatabaseError(
                f"This backend is not the leader any more: its lock in the database is gone ({_why(cause)}). Start it "
                "again; it stands by if another one has taken over."
            ) from None

    async def release(self) -> None:
        """Close the connection, and with it the lock."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(SQLAlchemyError):
                await connection.close()
        await self._engine.dispose()


class FileLock:
    """A file beside a SQLite database: two processes of one machine cannot both lock it."""

    def __init__(self, database: Path, name: str) -> None:
        self._name = name
        self._path = database.with_name(f"{database.name}.lock")
        self._file: int | None = None

    async def take_lock(self) -> bool:
        """Whether it is ours now. Raises `SettingsError` where no file can be made."""
        try:
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as cause:
            raise SettingsError(f"--database: cannot write {self._path} ({cause.strerror})") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            await self.release()
            return False
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, self._name.encode(), 0)
        return True

    async def holder(self) -> str:
        """As the file says; of one that has ended, until somebody else locks it."""
        try:
            return self._path.read_text("utf-8")
        except (OSError, UnicodeDecodeError):
            return ""

    async def prove(self) -> None:
        """A file stays locked as long as its process lives."""

    async def release(self) -> None:
        """Close the file; it stays where it is, since others may be about to lock it."""
        file, self._file = self._file, None
        if file is not None:
            os.close(file)


def lock_of(database: str, name: str = "") -> Lock:
    """The lock of the database at this URL, held under this name. Raises `SettingsError`."""
    url = parse_url(database)
    if url.get_backend_name() == "sqlite":
        return FileLock(Path(url.database or ""), name)
    return PostgresLock(url, name)


@contextlib.asynccontextmanager
async def held(database: str) -> AsyncIterator[None]:
    """Alone with a database, for what must not be done beside a running backend. Raises `DatabaseError`."""
    lock = lock_of(database)
    try:
        if not await lock.take_lock():
            raise DatabaseError("A backend works on this database; stop it (and those that stand by) first.")
        yield
    finally:
        await lock.release()


def _why(cause: BaseException) -> str:
    return (str(cause.args[0]) if cause.args else type(cause).__name__).strip().partition("\n")[0]
