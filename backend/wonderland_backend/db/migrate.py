"""Bringing a database to the tables of this version (Alembic)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util.exc import CommandError
from sqlalchemy import Connection, func, select
from sqlalchemy.exc import OperationalError, ProgrammingError

from alembic import command
from wonderland_backend.db.engine import Database
from wonderland_backend.errors import DatabaseError

_LOCK: Final = 0x504F4C  # "POL"


def scripts() -> Path:
    """Where the migrations are: inside the installed package, or beside it in a working tree."""
    packaged = Path(__file__).parent / "migrations"
    beside = Path(__file__).parents[3] / "alembic"
    for directory in (packaged, beside):
        if (directory / "env.py").is_file():
            return directory
    raise DatabaseError("the migrations are missing from this installation; install the package again")


async def migrate(database: Database, revision: str = "head") -> None:
    """Bring the tables to a revision. Raises `DatabaseError` for a database of a later version, or of another role."""

    def run(connection: Connection) -> None:
        if revision == "head" and _revision(connection) == head():
            return  # a server's role may ask, and owns no tables (`db.roles`)
        config = Config()
        config.set_main_option("script_location", str(scripts()).replace("%", "%%"))
        config.attributes["connection"] = connection
        try:
            command.upgrade(config, revision)
        except CommandError as cause:
            raise DatabaseError(f"the database cannot be migrated: {cause}; is it of a later version?") from cause

    try:
        async with database.write() as connection:
            if not database.is_sqlite:
                # Two servers that start at once migrate one after the other; SQLite's write lock does the same.
                await connection.execute(select(func.pg_advisory_xact_lock(_LOCK)))
            await connection.run_sync(run)
    except ProgrammingError as cause:
        if not any(words in str(cause) for words in ("permission denied", "must be owner")):
            raise
        raise DatabaseError(
            "the database's tables are of another version and belong to another role; as that role, run "
            "`wonderland backend migrate --server-role` with this server's role"
        ) from cause
    except OperationalError as cause:
        # A full file system, a server that is away: it was one transaction, so the tables are as they were.
        raise DatabaseError(f"the database was not migrated and is as it was: {cause.orig}") from cause


async def revision(database: Database) -> str | None:
    """The revision of the database; None for an empty one."""
    async with database.engine.connect() as connection:
        return await connection.run_sync(_revision)


def _revision(connection: Connection) -> str | None:
    return MigrationContext.configure(connection).get_current_revision()


def head() -> str | None:
    """The revision that this version needs."""
    return ScriptDirectory(str(scripts())).get_current_head()


def knows(revision: str) -> bool:
    """Whether a database of this revision can be brought to this version's."""
    try:
        return ScriptDirectory(str(scripts())).get_revision(revision) is not None
    except CommandError:
        return False
