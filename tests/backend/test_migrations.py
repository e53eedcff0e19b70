"""The migrations make exactly the tables that the code describes, on both databases."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import threading

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, text

from wonderland.proofs import encoding
from wonderland_backend.db import bulk
from wonderland_backend.db import migrate as migrations
from wonderland_backend.db.engine import Database, parse_url
from wonderland_backend.db.partitions import forget, is_partition, make_ahead, partition_of, partitions
from wonderland_backend.db.tables import Base
from wonderland_backend.db.tables.reported import TrackRow
from wonderland_backend.errors import DatabaseError, SettingsError

NEW_TRACK = {"uav_id": "new", "pad_id": "pad-1", "t_ms": 1, "received_ms": 1_800_000_000_001, "body": "{}"}

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


@both
async def test_migrated_tables_are_those_of_the_models(database):
    def differences(connection):
        def seen(name, kind, _parents):
            return kind != "table" or not is_partition(name)

        context = MigrationContext.configure(connection, opts={"compare_type": True, "include_name": seen})
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
async def test_what_was_stored_before_history_was_dated_by_arrival_stays(database_url):
    database = Database(database_url)
    pad = {"pad_id": "pad-1", "name": "Åbo", "msp_id": "PadMSP"}
    try:
        await migrations.migrate(database, "0005")
        async with database.write() as connection:
            for statement in (
                (
                    "INSERT INTO tracks (uav_id, pad_id, t_ms, body) VALUES ('uav-1', 'pad-1', 1800000000000, '{}'), "
                    "('uav-1', 'pad-1', 1800090000000, '{}'), ('uav-1', 'pad-1', 1800090000001, '{}')"
                ),
                "INSERT INTO estimates (session_id, uav_id, pad_id, t_ms, body) VALUES ('s', 'u', 'p', -5, '{}')",
                (
                    "INSERT INTO reported_steps (session_id, step, agent, agent_id, uav_id, t_ms, ok) "
                    "VALUES ('s', 'poll', 'pad', 'p', 'u', 7, true)"
                ),
                "INSERT INTO reported_ends (session_id, agent, agent_id, t_ms, body) VALUES ('s', 'pad', 'p', 9, '{}')",
                (
                    "INSERT INTO alerts (alert_id, kind, severity, source, t_ms, facts, state, revision, changed_ms) "
                    "VALUES ('a', 'refuted', 'critical', 'x', 5, '{}', 'open', 0, 8)"
                ),
                "INSERT INTO blocks VALUES (0, 'h', 'p', 'd', 33, 1, 1, 10)",
            ):
                await connection.execute(text(statement))
            payload = json.dumps({"kind": "PadRegistered", "record": pad, "t_ms": 33, "tx_id": "t"})
            event = "INSERT INTO events VALUES (0, 0, 'PadRegistered', :payload)"
            await connection.execute(text(event), {"payload": payload})
        await migrations.migrate(database)
        async with database.write() as connection:
            await make_ahead(connection, 1_800_000_000_000)

        async def rows(query):
            async with database.read() as session:
                return [tuple(row) for row in await session.execute(text(query))]

        assert await rows("SELECT id, t_ms, received_ms FROM tracks ORDER BY id") == [
            (1, 1_800_000_000_000, 1_800_000_000_000),
            (2, 1_800_090_000_000, 1_800_090_000_000),
            (3, 1_800_090_000_001, 1_800_090_000_001),
        ]
        assert await rows("SELECT positions FROM track_minutes ORDER BY minute_ms") == [(1,), (2,)]
        assert await rows("SELECT received_ms FROM estimates") == [(-5,)]
        assert await rows("SELECT received_ms FROM reported_steps") == [(7,)]
        assert await rows("SELECT received_ms FROM reported_ends") == [(9,)]
        assert await rows("SELECT raised_ms FROM alerts") == [(8,)]
        assert await rows("SELECT number, known_ms FROM block_arrivals") == [(0, 33)]
        ((kind, key, record),) = await rows("SELECT kind, key, record FROM record_versions")
        assert (kind, key, record) == ("pad", "pad-1", encoding.encode(pad).decode())
        async with database.write() as connection:
            await bulk.append(connection, TrackRow, [NEW_TRACK])
        assert await rows("SELECT id FROM tracks WHERE uav_id = 'new'") == [(4,)]
    finally:
        await database.close()


@pytest.mark.parametrize("database_url", [pytest.param("postgresql", marks=pytest.mark.postgres)], indirect=True)
async def test_partitions_are_made_ahead_and_dropped_and_no_row_is_refused(database):
    day = 86_400_000
    today = 1_800_000_000_000 // day * day

    async def held():
        async with database.read() as session:
            query = "SELECT tableoid::regclass::text, received_ms FROM tracks ORDER BY received_ms"
            return [tuple(row) for row in await session.execute(text(query))]

    async with database.write() as connection:
        await bulk.append(connection, TrackRow, [NEW_TRACK | {"received_ms": each} for each in (5, today + 7)])
    assert [name for name, _ in await held()] == ["tracks_default", "tracks_default"]
    for _ in range(2):
        async with database.write() as connection:
            await make_ahead(connection, today + 9)
    assert await held() == [("tracks_default", 5), (partition_of("tracks", today // day), today + 7)]
    async with database.write() as connection:
        await bulk.append(connection, TrackRow, [NEW_TRACK | {"received_ms": today + 3 * day}])
        await forget(connection, TrackRow, today + 10)
    assert [received for _, received in await held()] == [today + 7, today + 3 * day], "a day goes as a whole"
    async with database.write() as connection:
        await forget(connection, TrackRow, today + day)
        names = await partitions(connection, "tracks")
    assert [received for _, received in await held()] == [today + 3 * day]
    assert partition_of("tracks", today // day) not in names


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
