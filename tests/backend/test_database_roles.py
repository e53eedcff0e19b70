"""PostgreSQL with two roles: the server uses the tables, and cannot undo what keeps the audit log."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner
from sqlalchemy import text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DBAPIError

from wonderland_backend import audit
from wonderland_backend.commands import backend
from wonderland_backend.db import partitions
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import head, migrate
from wonderland_backend.db.partitions import DAY_MS
from wonderland_backend.db.roles import confine
from wonderland_backend.db.tables.reported import TrackRow
from wonderland_backend.errors import DatabaseError

ROLE = "console_server"
NOW_MS = 1_800_000_000_000
pytestmark = pytest.mark.postgres


def migrated(url, *more, code=0):
    done = CliRunner().invoke(backend, ["migrate", "--database", url, "--server-role", ROLE, *more])
    assert done.exit_code == code, done.output
    return done.output


@pytest.fixture
def urls(postgres, tmp_path):
    """The owner's and the server's."""
    owner = postgres.new_database()
    (tmp_path / "password").write_text("it's a %:secret\n")
    migrated(owner, "--server-password-file", str(tmp_path / "password"))
    return owner, make_url(owner).set(username=ROLE).render_as_string()


async def as_role(url, work):
    database = Database(url)
    try:
        return await work(database)
    finally:
        await database.close()


async def test_the_server_does_its_work_as_its_own_role(urls):
    async def work(database):
        await migrate(database)
        async with database.write() as connection:
            await partitions.make_ahead(connection, NOW_MS)
            await audit.record(connection, "Ada", "note", "alert/1", t_ms=NOW_MS)
            made = await partitions.partitions(connection, "tracks")
        async with database.write() as connection:
            await partitions.forget(connection, TrackRow, NOW_MS + 2 * DAY_MS)
            left = await partitions.partitions(connection, "tracks")
        async with database.read() as session:
            return made, left, list(await session.scalars(text("SELECT person FROM audit_log")))

    made, left, people = await as_role(urls[1], work)
    assert len(left) < len(made)
    assert people == ["Ada"]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE audit_log SET person = 'Eve'",
        "DELETE FROM audit_log",
        "TRUNCATE audit_log",
        "DROP TRIGGER audit_log_no_change ON audit_log",
        "ALTER TABLE audit_log DISABLE TRIGGER ALL",
        "CREATE OR REPLACE FUNCTION audit_log_refuse() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN RETURN NULL; END $$",
        "DROP TABLE audit_log",
        "ALTER TABLE people ADD COLUMN door text",
        "UPDATE alembic_version SET version_num = '0001'",
        "SET ROLE wonderland",
        "SET session_replication_role = replica",
        "GRANT UPDATE ON audit_log TO console_server",
    ],
)
async def test_what_the_servers_role_cannot_do(urls, statement):
    async def work(database):
        async with database.write() as connection:
            await connection.execute(text(statement))
            await connection.execute(text("UPDATE audit_log SET person = 'Eve'"))

    with pytest.raises(DBAPIError, match=r"permission denied|must be owner|no privileges"):
        await as_role(urls[1], work)


async def test_tables_of_an_older_version_are_not_the_servers_to_change(postgres):
    owner = postgres.new_database()
    await as_role(owner, lambda database: migrate(database, "0015"))
    await as_role(owner, lambda database: confine(database, ROLE, "secret"))
    with pytest.raises(DatabaseError, match="as that role, run `wonderland backend migrate --server-role`"):
        await as_role(make_url(owner).set(username=ROLE).render_as_string(), migrate)


def test_who_cannot_be_the_server(urls, tmp_path):
    assert json.loads(migrated(urls[0], "--json"))["after"] == head(), "again, with the same role"
    assert "there is no role somebody_else; give --server-password-file" in migrated(
        urls[0], "--server-role", "somebody_else", code=1
    )
    assert "is no name for a role" in migrated(urls[0], "--server-role", 'x"; DROP', code=1)
    assert "migrates here itself" in migrated(urls[0], "--server-role", "wonderland", code=1)
    sqlite = f"sqlite:///{tmp_path / 'backend.db'}"
    assert "SQLite has no roles" in migrated(sqlite, code=1)
    done = CliRunner().invoke(backend, ["migrate", "--database", sqlite, "--server-password-file", __file__])
    assert (done.exit_code, "give both" in done.output) == (2, True)
