"""Access and erasure by command: all of it given, part of it gone, and every proof as before."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import sqlite3
import zipfile

import pytest
from click.testing import CliRunner
from kit.chain import START_MS, Source
from kit.facts import Facts
from kit.openings import NUMBER, keep_usual, opening
from sqlalchemy import insert, select, text

from wonderland_backend.commands import backend
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables import Base
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.db.tables.reported import BroadcastOperatorRow, EstimateRow, LatestTrackRow, TrackRow
from wonderland_backend.mirror import rebuild as rebuilding
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.row_check import RowCheck
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.numbers import store as numbers
from wonderland_backend.personal_data import queries
from wonderland_backend.personal_data.subjects import Subject

both = pytest.mark.parametrize(
    "database_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)], indirect=True
)
HEARD_MS = 1_700_000_000_000
LATER_MS = 2 * START_MS
BROADCAST = "SWE00zqbroadcst1"


@pytest.fixture
async def filled(database, chain, clock):
    """Two drones, one proved, both heard; two administrators."""
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_uav(), facts.put_uav("uav-2"), facts.grant())
    chain.add(facts.request("one"))
    chain.add(facts.decide("one"))
    status = MirrorStatus()
    named = {"channel": "wonderland", "chaincode": "pol", "status": status, "clock": clock}
    await Mirror(database, Source(chain), **named).run_until(chain.height)
    await keep_usual(database)
    async with database.write() as connection:
        for uav_id in ("uav-1", "uav-2"):
            for model, more in (
                (TrackRow, {"body": "{}", "pad_id": "pad-1", "received_ms": HEARD_MS}),
                (LatestTrackRow, {"body": "{}", "pad_id": "pad-1"}),
                (BroadcastOperatorRow, {"operator_id": BROADCAST, "pad_id": "pad-1"}),
                (EstimateRow, {"body": "{}", "pad_id": "pad-1", "session_id": "s", "received_ms": HEARD_MS}),
            ):
                await connection.execute(insert(model), [{"uav_id": uav_id, "t_ms": HEARD_MS} | more])
        for index, name in enumerate(("Ada Anderson", "Bo Berg")):
            row = {
                "person_id": f"{index}" * 32, "name": name, "email": f"{name[:3].lower()}@example.org",
                "roles": "admin", "msp_id": "", "state": "active", "created_ms": 1, "changed_ms": 1, "revision": 1,
            }  # fmt: skip
            await connection.execute(insert(PersonRow), [row])
    return RowCheck(database, Source(chain), **named, transactions_per_s=10_000), status


@pytest.fixture
def command(database_url, tmp_path):
    """``wonderland backend …`` on the test's database."""

    def run(*words, fails=False):
        found = CliRunner().invoke(backend, [*words, "--database", database_url])
        assert (found.exit_code != 0) is fails, found.output
        return found.output

    return run


async def everything(database, drone=None):
    """The database as a text, table by table; of a drone only the rows about it."""
    found = {}
    async with database.read() as session:
        for table in Base.metadata.sorted_tables:
            rows = [str(tuple(row)) for row in await session.execute(select(table))]
            found[table.name] = [row for row in rows if drone is None or f"'{drone}'" in row]
    return found


def copied(database, path):
    """A backup, as SQLite makes it of a running database."""
    old, new = (contextlib.closing(sqlite3.connect(each)) for each in (database.url.database, path))
    with old as here, new as there:
        here.backup(there)


async def threaded(function, *words, **options):
    return await asyncio.to_thread(function, *words, **options)


async def test_a_dry_run_changes_nothing_and_says_what_would_stay(filled, database, command):
    before = await everything(database)
    told = await threaded(command, "person", "erase", "--drone", "uav-1", "--reason", "asked for")
    assert "Nothing is erased yet" in told
    assert "every later block's hash" in told
    assert await everything(database) == before
    assert "--journal" in await threaded(
        command, "person", "erase", "--drone", "uav-1", "--reason", "x", "--yes", fails=True
    )
    assert await everything(database) == before


@both
async def test_a_drone_is_erased_and_no_proof_suffers(filled, database, chain, command, tmp_path):
    check, status = filled
    digest = await rebuilding.digest(database)
    other = await everything(database, "uav-2")
    path = tmp_path / "erasures.jsonl"
    words = ("person", "erase", "--drone", "uav-1", "--reason", "article 17", "--journal", str(path), "--yes", "--json")
    told = json.loads(await threaded(command, *words))
    assert told["erased"] is True
    gone = {name for name, rows in told["rows"].items() if rows}
    assert gone == {"registration_numbers", "tracks", "latest_tracks", "broadcast_operators", "estimates"}
    after = await everything(database)
    assert not [row for name in gone for row in after[name] if "'uav-1'" in row]
    assert opening().salt not in str(after)
    assert await everything(database, "uav-2") == other, "nobody else's"
    (row,) = [row for row in after["audit_log"] if "erase_personal_data" in row]
    assert "article 17" in row
    assert NUMBER not in row
    # What a proof rests on: the same rows as before, the same as the blocks say, now and rebuilt.
    assert await rebuilding.digest(database) == digest
    await check.once()
    assert status.rows_differ == ()
    await rebuilding.rebuild(database, Source(chain), channel="wonderland", chaincode="pol", batch_transactions=50)
    assert await rebuilding.digest(database) == digest
    async with database.read() as session:
        found = await numbers.number_of(session, "uav-1")
    assert (found.state, found.value) == ("elsewhere", "")
    assert (path.stat().st_mode & 0o777) == 0o600
    assert json.loads(path.read_text())["commitments"] == [opening().commitment]
    assert NUMBER not in path.read_text()
    assert opening().salt not in path.read_text()


async def test_a_restored_backup_is_erased_again_and_what_is_newer_stays(filled, database, command, tmp_path):
    backup = tmp_path / "backup.db"
    copied(database, backup)
    path = tmp_path / "erasures.jsonl"
    for about in (("--drone", "uav-1"), ("--account", "0" * 32)):
        await threaded(command, "person", "erase", *about, "--reason", "x", "--journal", str(path), "--yes")
    restored = Database(f"sqlite:///{backup}")
    try:
        assert "uav-1" in str((await everything(restored))["registration_numbers"])
        async with restored.write() as connection:
            new = {"uav_id": "uav-1", "t_ms": LATER_MS, "body": "{}", "pad_id": "pad-1", "received_ms": LATER_MS}
            await connection.execute(insert(TrackRow), [new])
        words = ["person", "erase-again", "--journal", str(path), "--database", f"sqlite:///{backup}"]
        dry = await threaded(CliRunner().invoke, backend, words)
        assert "would be erased" in dry.output
        assert NUMBER in str((await everything(restored, "uav-1"))["registration_numbers"])
        done = await threaded(CliRunner().invoke, backend, [*words, "--yes"])
        assert done.exit_code == 0, done.output
        after = await everything(restored)
        assert "'uav-1'" not in str(after["registration_numbers"])
        assert [str(LATER_MS) in row for row in after["tracks"] if "'uav-1'" in row] == [True]
        assert "Ada" not in str(after["people"])
        path.write_bytes(path.read_bytes() + b'{"kind":"ship","id":"x","erased_ms":1}\n')
        broken = await threaded(CliRunner().invoke, backend, [*words, "--yes"])
        assert broken.exit_code != 0
        assert "line 3" in broken.output
    finally:
        await restored.close()


async def test_an_account_is_neutralised_and_the_last_administrator_stays(filled, database, command, tmp_path):
    path = tmp_path / "erasures.jsonl"
    words = ("person", "erase", "--reason", "left", "--journal", str(path), "--yes", "--account")
    await threaded(command, *words, "0" * 32)
    async with database.read() as session:
        row = await session.get(PersonRow, "0" * 32)
    assert (row.name, row.email, row.state) == ("erased-00000000", None, "suspended")
    assert "Ada" not in str((await everything(database))["people"])
    assert "last administrator" in await threaded(command, *words, "1" * 32, fails=True)
    assert "nothing is kept" in await threaded(command, *words, "2" * 32, fails=True)


async def test_access_gives_all_that_is_kept_and_no_key_to_anything(filled, database, command, tmp_path):
    out = tmp_path / "uav-1.zip"
    words = ("person", "access", "--drone", "uav-1", "--reason", "article 15", "--out", str(out))
    kept = await everything(database, "uav-1")
    await threaded(command, *words)
    assert (out.stat().st_mode & 0o777) == 0o600
    with zipfile.ZipFile(out) as packed:
        files = {name.removesuffix(".jsonl"): packed.read(name).decode() for name in packed.namelist()}
    about = json.loads(files.pop("about.json"))
    assert about["about"] == "drone/uav-1"
    assert {name for name, rows in kept.items() if rows} <= {name for name, lines in files.items() if lines}
    assert NUMBER in files["registration_numbers"]
    async with database.read() as session:
        named = await session.scalar(text("""SELECT count(*) FROM events WHERE payload LIKE '%"uav-1"%'"""))
    assert len(files["events"].splitlines()) == named > 0
    assert opening().salt not in str(files)
    assert "uav-2" not in str(files)
    assert "give_personal_data" in str((await everything(database))["audit_log"])
    await threaded(command, *words, fails=True)  # nothing is written over


def test_every_table_that_names_a_drone_or_an_account_is_looked_through():
    named = {"drone": {"uav_id"}, "account": {"person_id", "owner_id", "requested_by", "principal"}}
    for kind, columns in named.items():
        looked = {table.name for table, _ in queries.parts(Subject(kind, "x"))}
        there = {table.name for table in Base.metadata.sorted_tables if columns & set(table.c.keys())}
        assert there <= looked
        assert "audit_log" in looked


async def test_an_opening_goes_to_another_backend_and_opens_nothing_else(filled, database, command, tmp_path):
    out = tmp_path / "opening.json"
    await threaded(command, "number", "export", "uav-1", "--reason", "court order 7", "--out", str(out))
    assert hashlib.sha256(out.read_bytes()).hexdigest() == opening().commitment, "as sha256sum says"
    audited = str((await everything(database))["audit_log"])
    assert "court order 7" in audited
    assert NUMBER not in audited
    other = tmp_path / "other.db"
    copied(database, other)
    theirs = Database(f"sqlite:///{other}")
    words = ["number", "import", "--database", f"sqlite:///{other}"]
    try:
        async with theirs.write() as connection:
            await connection.execute(text("DELETE FROM registration_numbers"))
        wrong = json.loads(out.read_text())
        bad = tmp_path / "bad.json"
        for change in (
            {"registration": "SWE01abcdefghij2"}, {"uav_id": "uav-2"}, {"uav_id": "uav-7"},
            {"salt": opening("uav-2").salt}, {"salt": "00" * 32}, {"more": 1},
        ):  # fmt: skip
            bad.write_text(json.dumps(wrong | change))
            found = await threaded(CliRunner().invoke, backend, [*words, str(out), str(bad)])
            assert found.exit_code != 0, change
            assert (await everything(theirs))["registration_numbers"] == [], "none is taken"
        done = await threaded(CliRunner().invoke, backend, [*words, str(out)])
        assert done.exit_code == 0, done.output
        async with theirs.write() as connection:
            await connection.execute(text("UPDATE registration_numbers SET number = 'SWE01abcdefghij2'"))
        async with theirs.read() as session:
            assert (await numbers.number_of(session, "uav-1")).state == "altered"
        await threaded(CliRunner().invoke, backend, [*words, str(out)])
        async with theirs.read() as session:
            assert (await numbers.number_of(session, "uav-1")).value == NUMBER, "the right one mends the row"
    finally:
        await theirs.close()
