"""PostgreSQL by its own pg_dump and pg_restore, with a digest of every table at the dump's own moment."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Final

import psycopg
from psycopg import sql
from sqlalchemy.engine import URL

from wonderland_backend.errors import DatabaseError

KEPT: Final = "wonderland_replaced"
"""The schema that holds what was there, until what comes in its place is whole."""
_TABLES: Final = """
SELECT c.relname FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace
WHERE n.nspname = 'public' AND c.relkind IN ('r', 'p') AND NOT c.relispartition ORDER BY 1
"""
_DIGEST: Final = "SELECT count(*), coalesce(sum(('x' || left(md5(t::text), 15))::bit(60)::bigint), 0)::text FROM {} t"
"""The sum of the rows' hashes: their order does not matter. It finds faults; the file's SHA-256 finds changes."""
_SERVER_ROLE: Final = """
SELECT tableowner FROM pg_tables WHERE schemaname = 'public' AND tablename = 'tracks' AND tableowner <>
  (SELECT tableowner FROM pg_tables WHERE schemaname = 'public' AND tablename = 'audit_log')
"""


def connect(url: URL) -> psycopg.Connection[Any]:
    """A connection, each statement by itself. Raises `DatabaseError`."""
    try:
        return psycopg.connect(_conninfo(url, with_password=True), autocommit=True, connect_timeout=10)
    except psycopg.Error as error:
        raise DatabaseError(f"the database cannot be used: {error}") from error


def _conninfo(url: URL, *, with_password: bool) -> str:
    plain = URL.create(
        "postgresql", url.username, url.password if with_password else None, url.host, url.port, url.database, url.query
    )
    return plain.render_as_string(hide_password=False)


def dump(url: URL, to: Path) -> tuple[dict[str, tuple[int, str]], str]:
    """Write a dump; the tables' digests at that very moment, and the server's role. Raises `DatabaseError`, OSError."""
    with connect(url) as connection:
        connection.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        connection.autocommit = False
        snapshot = connection.execute("SELECT pg_export_snapshot()").fetchone()
        assert snapshot is not None
        found = digests(connection)
        role = connection.execute(_SERVER_ROLE).fetchone()
        with open(to, "xb", opener=_private) as file:
            _run("pg_dump", url, "--format=custom", "--no-password", f"--snapshot={snapshot[0]}", stdout=file)
            os.fsync(file.fileno())
    return found, "" if role is None else role[0]


def _private(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_CLOEXEC, 0o600)


def restore(connection: psycopg.Connection[Any], url: URL, file: Path, expected: dict[str, tuple[int, str]]) -> None:
    """Into an empty schema, all or nothing, as whoever owns the database. Raises `DatabaseError`."""
    _run(
        "pg_restore", url, "--no-password", "--no-owner", "--no-privileges", "--single-transaction", "--exit-on-error",
        str(file),
    )  # fmt: skip
    if (found := digests(connection)) != expected:
        wrong = sorted(name for name in {*found, *expected} if found.get(name) != expected.get(name))
        raise DatabaseError(f"what was restored is not what was backed up: {', '.join(wrong)}")


def digests(connection: psycopg.Connection[Any]) -> dict[str, tuple[int, str]]:
    """Rows and digest of each table."""
    found = {}
    for (name,) in connection.execute(_TABLES).fetchall():
        row = connection.execute(sql.SQL(_DIGEST).format(sql.Identifier("public", name))).fetchone()
        assert row is not None
        found[name] = (row[0], row[1])
    return found


def is_empty(connection: psycopg.Connection[Any]) -> bool:
    """Whether there are no tables."""
    return connection.execute(_TABLES).fetchone() is None


def has_role(connection: psycopg.Connection[Any], role: str) -> bool:
    """Whether the server knows it."""
    return connection.execute("SELECT 1 FROM pg_roles WHERE rolname = %s", (role,)).fetchone() is not None


@contextlib.contextmanager
def replacing(connection: psycopg.Connection[Any]) -> Iterator[None]:
    """An empty schema; what was there comes back where what is done meanwhile fails. Raises `DatabaseError`."""
    left = connection.execute("SELECT to_regnamespace(%s) IS NOT NULL", (KEPT,)).fetchone() == (True,)
    if left and not is_empty(connection):
        raise DatabaseError(
            f"a restore was cut off here: the schema {KEPT} has what was there before. Drop it (DROP SCHEMA {KEPT} "
            "CASCADE) if public is what you want, or drop public and rename it to public"
        )
    try:
        with connection.transaction():
            # Where a restore was cut off, what was there before it has this name already, and public is empty.
            connection.execute("DROP SCHEMA public CASCADE" if left else f"ALTER SCHEMA public RENAME TO {KEPT}")
            _make_public(connection)
    except psycopg.Error as error:
        raise DatabaseError(f"restore as the role that owns the database and its schema public: {error}") from error
    try:
        yield
    except BaseException:
        with connection.transaction():
            connection.execute("DROP SCHEMA public CASCADE")
            connection.execute(f"ALTER SCHEMA {KEPT} RENAME TO public")
        raise
    connection.execute(f"DROP SCHEMA {KEPT} CASCADE")


def _make_public(connection: psycopg.Connection[Any]) -> None:
    connection.execute("CREATE SCHEMA public")
    connection.execute("GRANT USAGE ON SCHEMA public TO PUBLIC")


@contextlib.contextmanager
def scratch(url: URL, name: str) -> Iterator[URL]:
    """A database of its own beside this one, dropped at the end. Raises `DatabaseError`."""
    with connect(url) as connection:
        try:
            connection.execute(sql.SQL("CREATE DATABASE {} TEMPLATE template0").format(sql.Identifier(name)))
        except psycopg.Error as error:
            raise DatabaseError(f"--verify needs a role with CREATEDB: {error}") from error
        try:
            yield url.set(database=name)
        finally:
            connection.execute(sql.SQL("DROP DATABASE {} WITH (FORCE)").format(sql.Identifier(name)))


def _run(program: str, url: URL, *arguments: str, stdout: IO[bytes] | int = subprocess.DEVNULL) -> None:
    # A password in the command line could be read by everybody on this machine.
    secret = {"PGPASSWORD": url.password} if url.password else {}
    line = [program, *arguments, f"--dbname={_conninfo(url, with_password=False)}"]
    try:
        done = subprocess.run(  # noqa: S603 - our own words; the URL is one argument
            line, stdout=stdout, stderr=subprocess.PIPE, env={**os.environ, **secret}, check=False
        )
    except FileNotFoundError as error:
        raise DatabaseError(f"{program} is missing: apt install postgresql-client") from error
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip()[-2000:]
        raise DatabaseError(f"{program} ended with {done.returncode}: {said}")
