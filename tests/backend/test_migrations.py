"""The migrations make exactly the tables that the code describes, on both databases."""

from __future__ import annotations

import asyncio
import sqlite3
import threading

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, text

from backend.db import migrate as migrations
from backend.db.engine import Database, parse_url
from backend.db.models import Base
from backend.errors import DatabaseError, SettingsError

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


@both
async def test_migrated_tables_are_those_of_the_models(database):
    def differences(connection):
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        return compare_metadata(context, Base.metadata)

    async with database.engine.connect() as connection:
        assert await connection.run_sync(differences) == []
    assert await migrations.revision(database) == migrations.head()


@both
async def test_migrating_twice_changes_nothing(database):
    await migrations.migrate(database)
    assert await migrations.revision(database) == migrations.head()


@both
async def test_servers_that_start_at_once_migrate_one_after_the_other(database_url):
    servers = [Database(database_url) for _ in range(4)]
    try:
        await asyncio.gather(*map(migrations.migrate, servers))
        assert await migrations.revision(servers[-1]) == migrations.head()
    finally:
        for each in servers:
            await each.close()


async def test_a_new_sqlite_file_that_another_is_preparing_is_waited_for(tmp_path):
    path = tmp_path / "new.db"
    other = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN EXCLUSIVE")
    threading.Timer(0.3, other.execute, ["COMMIT"]).start()
    database = Database(f"sqlite:///{path}")
    try:
        async with database.engine.connect() as connection:
            assert (await connection.exec_driver_sql("PRAGMA journal_mode")).scalar() == "wal"
    finally:
        await database.close()
        other.close()


@both
async def test_back_to_nothing_and_again(database_url):
    from alembic.config import Config

    from alembic import command

    database = Database(database_url)
    try:
        await migrations.migrate(database)

        def down(connection):
            config = Config()
            config.set_main_option("script_location", str(migrations.scripts()))
            config.attributes["connection"] = connection
            command.downgrade(config, "base")

        async with database.write() as connection:
            await connection.run_sync(down)
            names = await connection.run_sync(lambda each: inspect(each).get_table_names())
        assert names == ["alembic_version"]
        await migrations.migrate(database)
        assert await migrations.revision(database) == migrations.head()
    finally:
        await database.close()


@both
async def test_a_database_of_a_later_version_is_refused(database):
    async with database.write() as connection:
        await connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(DatabaseError, match="later version"):
        await migrations.migrate(database)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("nonsense", "not a URL"),
        ("mysql://host/name", "mysql is not supported"),
        ("sqlite://", "needs a file"),
        ("sqlite:///:memory:", "needs a file"),
    ],
)
def test_database_urls_that_cannot_be_used(url, said):
    with pytest.raises(SettingsError, match=said):
        parse_url(url)
