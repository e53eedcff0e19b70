"""Backups of real databases: whole or none, refused when they are not what they say, and restored as plain roles."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tarfile
import threading
from pathlib import Path

import psycopg
import pytest
from click.testing import CliRunner
from kit.databases import copy_migrated
from kit.openings import NUMBER, keep_usual
from sqlalchemy import insert
from sqlalchemy.engine import make_url

from wonderland.cli import main
from wonderland_backend import audit
from wonderland_backend.backup import sealed
from wonderland_backend.backup.postgres import digests
from wonderland_backend.commands import backend
from wonderland_backend.db import partitions
from wonderland_backend.db.engine import Database
from wonderland_backend.db.tables.people import PersonRow
from wonderland_backend.db.tables.reported import TrackRow
from wonderland_backend.errors import BackendError
from wonderland_backend.personal_data.subjects import Erased, Subject

both = pytest.mark.parametrize("kind", ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
NOW_MS = 1_800_000_000_000
BEFORE_MS = 1_700_000_000_000
"""Before commands run: the log's times never go back."""
ROLE = "backed_up_server"
PERSON = {
    "name": "Ada", "roles": "admin", "msp_id": "", "state": "active", "created_ms": 1, "changed_ms": 1, "revision": 1,
}  # fmt: skip


def run(*words, code=0):
    done = CliRunner().invoke(main, [str(each) for each in words])
    assert done.exit_code == code, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.output


def track(number):
    return {"uav_id": "uav-1", "t_ms": NOW_MS + number, "body": "{}", "pad_id": "p", "received_ms": NOW_MS + number}


def fill(url):
    async def work():
        database = Database(url)
        async with database.write() as connection:
            await partitions.make_ahead(connection, NOW_MS)
        await keep_usual(database)
        async with database.write() as connection:
            await audit.record(connection, "Ada", "note", "alert/1", t_ms=BEFORE_MS)
            people = [PERSON | {"person_id": str(each) * 32, "email": f"{each}@example.org"} for each in range(2)]
            await connection.execute(insert(PersonRow), people)
            await connection.execute(insert(TrackRow), [track(each) for each in range(100)])
        await database.close()

    asyncio.run(work())


def content(url, *, log=True):
    """Every row of every table; ``log``: of the audit log, too, into which a restore writes itself."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        with contextlib.closing(sqlite3.connect(parsed.database)) as opened:
            lines = list(opened.iterdump())
        return "\n".join(each for each in lines if log or not each.startswith('INSERT INTO "audit_log"'))
    with psycopg.connect(url) as opened:
        return {name: each for name, each in digests(opened).items() if log or name != "audit_log"}


class Place:
    """A filled database of a kind, and empty ones."""

    def __init__(self, kind, tmp_path, request):
        self.kind, self.tmp_path, self.count = kind, tmp_path, 0
        self.to = tmp_path / "backups"
        if kind == "sqlite":
            self.url = self.empty()
            copy_migrated(make_url(self.url).database)
        else:
            self.postgres = request.getfixturevalue("postgres")
            self.postgres._say(
                "DO $$ BEGIN CREATE ROLE plain_owner LOGIN CREATEDB CREATEROLE;"
                " EXCEPTION WHEN duplicate_object THEN NULL; END $$"
            )
            self.url = self.empty()
            (tmp_path / "password").write_text("of the server\n")
            done = CliRunner().invoke(
                backend,
                ["migrate", "--database", self.url, "--server-role", ROLE,
                 "--server-password-file", str(tmp_path / "password")],
            )  # fmt: skip
            assert done.exit_code == 0, done.output
        self.server = self.url if kind == "sqlite" else self.as_server(self.url)
        fill(self.server)

    def empty(self):
        self.count += 1
        if self.kind == "sqlite":
            return f"sqlite:///{self.tmp_path / f'{self.count}.db'}"
        name = make_url(self.postgres.new_database()).database
        self.postgres._say(f"ALTER DATABASE {name} OWNER TO plain_owner")
        return make_url(self.postgres.url(name)).set(username="plain_owner").render_as_string()

    @staticmethod
    def as_server(url):
        return make_url(url).set(username=ROLE).render_as_string()

    def backup(self, *more):
        """As the role that the server has; its directory."""
        return Path(json.loads(run("backup", "--to", self.to, "--database", self.server, "--json", *more))["backup"])


@pytest.fixture
def place(kind, tmp_path, request, monkeypatch):
    # The commands set it for their own process, which is this one here: undone with what is recorded now.
    monkeypatch.setenv("WONDERLAND_BACKEND_CONFIG", "")
    monkeypatch.delenv("WONDERLAND_BACKEND_CONFIG")
    return Place(kind, tmp_path, request)


@both
def test_what_is_restored_is_what_was_there(place):
    made = place.backup()
    assert [f"{each.stat().st_mode & 0o777:o}" for each in (place.to, made)] == ["700", "700"]
    assert {f"{each.stat().st_mode & 0o777:o}" for each in made.iterdir()} == {"600"}
    target = place.empty()
    said = run("restore", made, "--database", target)
    assert "The database is as it was at " in said
    assert "erase-again" in said
    assert content(target, log=False) == content(place.url, log=False)
    assert read(target, LOG)[:-1] == read(place.url, LOG)
    assert not list(place.tmp_path.glob("*.replaced"))
    ours = [CliRunner().invoke(backend, ["digest", "--database", url]).output for url in (target, place.url)]
    assert ours[0] == ours[1]
    if place.kind == "sqlite":
        return
    server = place.as_server(target)
    with psycopg.connect(server, autocommit=True) as connection:
        connection.execute("INSERT INTO tracks SELECT * FROM tracks WHERE false")
        for statement in ("UPDATE audit_log SET person = 'Eve'", "DROP TRIGGER audit_log_no_change ON audit_log"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(statement)
    with psycopg.connect(target, autocommit=True) as connection, pytest.raises(psycopg.errors.RaiseException):
        connection.execute("UPDATE audit_log SET person = 'Eve'")

    async def works():
        database = Database(server)
        async with database.write() as connection:
            await partitions.make_ahead(connection, NOW_MS + 10 * partitions.DAY_MS)
            await audit.record(connection, "Ada", "note", "alert/2", t_ms=NOW_MS)
        await database.close()

    asyncio.run(works())


@both
def test_a_database_that_is_written_to_meanwhile(place):
    stop, begun, written = threading.Event(), threading.Event(), []

    def write():
        async def work():
            database = Database(place.server)
            while not stop.is_set():
                async with database.write() as connection:
                    rows = [track(1000 + 2 * len(written)), track(1001 + 2 * len(written))]
                    await connection.execute(insert(TrackRow), rows)
                written.append(rows)
                begun.set()
            await database.close()

        asyncio.run(work())

    thread = threading.Thread(target=write)
    thread.start()
    try:
        assert begun.wait(30)
        before = len(written)
        made = place.backup()
        after = len(written)
    finally:
        stop.set()
        thread.join()
    assert after > before
    target = place.empty()
    run("restore", made, "--database", target)
    rows = count(target)
    assert rows % 2 == 0
    assert 100 + 2 * before <= rows <= 100 + 2 * (after + 1)


def count(url):
    parsed = make_url(url)
    connect = sqlite3.connect(parsed.database) if parsed.get_backend_name() == "sqlite" else psycopg.connect(url)
    with contextlib.closing(connect) as opened:
        return opened.execute("SELECT count(*) FROM tracks").fetchone()[0]


@both
def test_what_is_there_is_replaced_only_when_told_and_what_was_erased_stays_erased(place):
    made = place.backup()
    journal = place.tmp_path / "journal"
    words = ["person", "erase", "--account", "0" * 32, "--reason", "x", "--journal", str(journal), "--yes"]
    assert CliRunner().invoke(backend, [*words, "--database", place.server]).exit_code == 0
    before = content(place.url)
    assert "is not empty" in run("restore", made, "--database", place.url, code=1)
    said = run("restore", made, "--database", place.url, "--replace", code=1)
    assert f"has forgotten since the backup what this would bring back: person/{'0' * 32}." in said
    assert content(place.url) == before
    said = run("restore", made, "--database", place.url, "--replace", "--journal", journal)
    assert f"Erased again: person/{'0' * 32}" in said
    parsed = make_url(place.url)
    connect = sqlite3.connect(parsed.database) if place.kind == "sqlite" else psycopg.connect(place.url)
    with contextlib.closing(connect) as opened:
        names = {row[0] for row in opened.execute("SELECT name FROM people").fetchall()}
    assert names == {"Ada", "erased-00000000"}


@contextlib.contextmanager
def opened(url):
    """By the database's own driver."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        with contextlib.closing(sqlite3.connect(parsed.database)) as connection, connection:
            yield connection
    else:
        with psycopg.connect(url, autocommit=True) as connection:
            yield connection


def write(url, *statements):
    with opened(url) as connection:
        for each in statements:
            connection.execute(each)


def read(url, query):
    with opened(url) as connection:
        return [tuple(each) for each in connection.execute(query).fetchall()]


def note(url, act, subject, t_ms):
    async def work():
        database = Database(url)
        async with database.write() as connection:
            await audit.record(connection, "Ada", act, subject, t_ms=t_ms)
        await database.close()

    asyncio.run(work())


ADA, BOB, EVER = "0" * 32, "1" * 32, 9_999_999_999_999
ACCESS = (
    f"INSERT INTO passkeys VALUES ('old', '{BOB}', 'k', 0, '', 'Key', 1, NULL)",
    f"INSERT INTO passkeys VALUES ('stolen', '{BOB}', 'k', 0, '', 'Key', 1, NULL)",
    f"INSERT INTO links VALUES ('{'a' * 64}', 'invitation', '{BOB}', 1, {EVER}, NULL)",
    f"""INSERT INTO sign_ins
    (cookie_sha256, sign_in_id, person_id, method, browser, created_ms, expires_ms, last_seen_ms)
    VALUES ('{"b" * 64}', 's', '{BOB}', 'passkey', '', 1, {EVER}, 1)""",
    """INSERT INTO clients (client_id, name, scopes, role, msp_id, created_ms, created_by)
    VALUES ('machine', 'M', '', 'viewer', '', 1, 'Ada')""",
    """INSERT INTO subscriptions
    (subscription_id, owner, name, url, secret, filter, state, block, tx_index, created_ms)
    VALUES ('hook', 'machine', 'h', 'https://a', 's', '{}', 'active', 0, 0, 1)""",
)
WHAT = {
    "people": "SELECT person_id, state, roles FROM people ORDER BY 1",
    "passkeys": "SELECT credential_id FROM passkeys ORDER BY 1",
    "machines": "SELECT client_id FROM clients WHERE revoked_ms IS NULL",
    "webhooks": "SELECT subscription_id FROM subscriptions WHERE state = 'active'",
    "links": "SELECT token_sha256 FROM links",
    "sign_ins": "SELECT sign_in_id FROM sign_ins",
}
LOG = "SELECT * FROM audit_log ORDER BY seq"


@both
def test_what_was_taken_from_people_and_machines_is_not_given_back(place):
    write(place.server, *ACCESS, f"UPDATE people SET roles = 'admin inspector' WHERE person_id = '{ADA}'")
    made = place.backup()
    write(
        place.server,
        f"UPDATE people SET state = 'suspended' WHERE person_id = '{BOB}'",
        f"UPDATE people SET roles = 'admin' WHERE person_id = '{ADA}'",
        "DELETE FROM passkeys WHERE credential_id = 'stolen'",
        "UPDATE clients SET revoked_ms = 5",
        "DELETE FROM subscriptions",
    )
    note(place.server, "person_suspended", f"person/{BOB}", BEFORE_MS + 1)
    log = read(place.server, LOG)
    for _ in range(2):
        said = run("restore", made, "--replace", "--database", place.url)
        assert "Nobody is signed in any more" in said
        assert {name: read(place.server, query) for name, query in WHAT.items()} == {
            "people": [(ADA, "active", "admin"), (BOB, "suspended", "admin")],
            "passkeys": [("old",)],
            "machines": [],
            "webhooks": [],
            "links": [],
            "sign_ins": [],
        }
    # The log goes on where it was, so that anchors on the ledger fit it.
    now = read(place.server, LOG)
    assert now[: len(log)] == log
    assert [each[4] for each in now[len(log) :]] == ["restore_database", "restore_database"]


@both
def test_a_restore_that_would_leave_nobody_in_charge_changes_nothing(place):
    made = place.backup()
    write(place.server, f"UPDATE people SET roles = 'viewer' WHERE person_id IN ('{ADA}', '{BOB}')")
    before = content(place.url)
    said = run("restore", made, "--replace", "--database", place.url, code=1)
    assert "no administrator of the backup is one still" in said
    assert content(place.url) == before


@both
def test_an_empty_place_knows_of_nothing_that_was_taken_and_says_so(place):
    write(place.server, *ACCESS)
    made = place.backup()
    url = place.empty()
    said = run("restore", made, "--database", url)
    assert "look through people, machines and webhooks" in said
    assert read(url, WHAT["sign_ins"]) == read(url, WHAT["links"]) == []
    assert read(url, WHAT["passkeys"]) == [("old",), ("stolen",)]


@both
def test_a_journal_of_an_older_erasure_of_the_same_drone_does_not_do(place):
    made = place.backup()
    subject, late_ms = Subject("drone", "uav-1"), 4_000_000_000_000
    note(place.server, "erase_personal_data", subject.audited, late_ms)
    journal = place.tmp_path / "journal"
    for erased_ms, code in ((NOW_MS, 1), (late_ms, 0)):
        journal.write_bytes(Erased(subject, erased_ms, ()).line())
        said = run("restore", made, "--replace", "--journal", journal, "--database", place.url, code=code)
        assert ("has forgotten since the backup" in said) == bool(code)


@both
def test_an_erasure_that_was_committed_after_the_backups_moment_is_done_again(place):
    """It has the time at which it began, which may be before."""
    made = place.backup()
    made_ms = json.loads((made / "manifest.json").read_text())["made_ms"]
    journal = place.tmp_path / "journal"
    journal.write_bytes(
        Erased(Subject("account", "0" * 32), made_ms - 1_000).line()
        + Erased(Subject("account", "1" * 32), made_ms - 3_600_000).line()  # long before: the backup is without it
    )
    said = run("restore", made, "--database", place.url, "--replace", "--journal", journal)
    assert f"Erased again: person/{'0' * 32}" in said
    assert f"person/{'1' * 32}" not in said


@both
@pytest.mark.parametrize("fault", ["cut", "altered", "foreign", "newer", "unfinished", "no manifest", "other kind"])
def test_what_is_no_backup_of_ours_is_refused_before_anything_changes(place, fault, request):
    made = place.backup()
    path, stated = made / "database", json.loads((made / "manifest.json").read_text())
    target = place.url
    if fault == "cut":
        os.truncate(path, path.stat().st_size - 1)
    elif fault == "altered":
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    elif fault == "foreign":
        stated["format"] = "wonderland-backup-2"
    elif fault == "newer":
        stated["revision"] = "9999"
    elif fault == "unfinished":
        (made / "manifest.json").unlink()
    elif fault == "no manifest":
        (made / "manifest.json").write_text("[1]")
    else:
        target = f"sqlite:///{place.tmp_path}/x.db" if place.kind == "postgresql" else "postgresql://x@127.0.0.1:9/x"
    if fault in {"foreign", "newer"}:
        (made / "manifest.json").write_text(json.dumps(stated))
    before = content(place.url)
    said = run("restore", made, "--replace", "--database", target, code=1)
    assert {
        "cut": "it was cut", "altered": "its SHA-256 is another", "foreign": "reads wonderland-backup-1",
        "newer": "install that version or a later one", "unfinished": "was not finished",
        "no manifest": "no manifest", "other kind": "both must be the same",
    }[fault] in said  # fmt: skip
    assert content(place.url) == before
    assert not (place.tmp_path / "x.db").exists()


@both
def test_a_backup_is_tried(place):
    made = place.backup()
    before = content(place.url)
    assert "is whole" in run("restore", made, "--verify", "--database", place.url)
    assert content(place.url) == before
    if place.kind == "postgresql":
        with psycopg.connect(place.url) as opened:
            assert not opened.execute("SELECT 1 FROM pg_database WHERE datname LIKE 'wonderland_verify%'").fetchall()
        stated = json.loads((made / "manifest.json").read_text())
        stated["tables"]["people"][0] += 1
        (made / "manifest.json").write_text(json.dumps(stated))
        assert "not what was backed up: people" in run("restore", made, "--verify", "--database", place.url, code=1)
        said = run("restore", made, "--replace", "--database", place.url, code=1)
        assert "not what was backed up: people" in said
        assert content(place.url) == before


@both
def test_a_full_disk_leaves_nothing_behind(place):
    line = f"ulimit -f 40; exec {sys.executable} -m wonderland.cli backup --to {place.to} --database '{place.server}'"
    if place.kind == "postgresql":
        line = line.replace("-f 40", "-f 4")
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert [each.name for each in place.to.iterdir()] == [".lock"]


@pytest.mark.postgres
@pytest.mark.parametrize("kind", ["postgresql"])
@pytest.mark.parametrize("program", ["pg_dump", "pg_restore"])
def test_killed_in_the_middle(place, program, monkeypatch):
    made = place.backup()
    before = content(place.url, log=False)
    fake = place.tmp_path / "bin"
    fake.mkdir()
    (fake / program).write_text("#!/bin/sh\necho half of it\nkill -9 $PPID\n")
    (fake / program).chmod(0o755)
    words = ["backup", "--to", place.to] if program == "pg_dump" else ["restore", made, "--replace"]
    url = place.server if program == "pg_dump" else place.url
    path = {**os.environ, "PATH": f"{fake}:{os.environ['PATH']}"}
    line = [sys.executable, "-m", "wonderland.cli", *map(str, words), "--database", url]
    assert subprocess.run(line, env=path, timeout=60, check=False).returncode == -9
    if program == "pg_dump":
        assert list(place.to.glob("*.partial"))
        place.backup("--keep", "1")
        assert not list(place.to.glob("*.partial"))
        assert [each for each in place.to.glob("wonderland-*") if each != made]
        assert not made.exists()
    else:
        run("restore", made, "--database", place.url)
        assert content(place.url, log=False) == before


@both
def test_settings_and_keys_come_along_sealed(place):
    keys = place.tmp_path / "etc"
    keys.mkdir()
    (keys / "connection.json").write_text(json.dumps({"identities": {"mirror": {"key": "mirror.key"}}}))
    (keys / "mirror.key").write_text("a secret key")
    (keys / "mirror.key").chmod(0o600)
    config = keys / "backend.toml"
    config.write_text(f'connection = "{keys}/connection.json"\n')
    ledger = keys / "ledger.sqlite3"
    with contextlib.closing(sqlite3.connect(ledger)) as opened:
        opened.executescript("PRAGMA journal_mode=WAL; CREATE TABLE block (n); INSERT INTO block VALUES (7)")
    passphrase = place.tmp_path / "passphrase"
    passphrase.write_text("short")
    more = ("--passphrase-file", passphrase, "--config", config, "--also", ledger)
    webhooks = place.tmp_path / f"{make_url(place.url).database}.webhooks.key"
    if place.kind == "sqlite":
        # No setting names it: the server made it beside its database.
        webhooks.write_text("a key of webhooks\n")
    assert "characters at least" in run("backup", "--to", place.to, "--database", place.server, *more, code=1)
    passphrase.write_text("correct horse battery\n")
    made = place.backup(*more)
    assert not any(b"a secret key" in each.read_bytes() for each in made.iterdir())
    wrong = place.tmp_path / "wrong"
    wrong.write_text("correct horse batterz\n")
    to = place.tmp_path / "back"
    said = run("restore", made, "--files-to", to, "--passphrase-file", wrong, "--config", config, code=1)
    assert "another passphrase" in said
    assert not to.exists()
    run("restore", made, "--files-to", to, "--passphrase-file", passphrase, "--config", config)
    key = to / str(keys / "mirror.key").lstrip("/")
    assert key.read_text() == "a secret key"
    assert key.stat().st_mode & 0o777 == 0o600
    if place.kind == "sqlite":
        assert (to / str(webhooks).lstrip("/")).read_text() == "a key of webhooks\n"
    assert (to / str(config).lstrip("/")).read_bytes() == config.read_bytes()
    with contextlib.closing(sqlite3.connect(to / str(ledger).lstrip("/"))) as opened:
        assert opened.execute("SELECT n FROM block").fetchall() == [(7,)]
    key.write_text("another")
    said = run("restore", made, "--files-to", to, "--passphrase-file", passphrase, "--config", config, code=1)
    assert "is there already" in said
    assert key.read_text() == "another"
    shutil.rmtree(to)
    stated = json.loads((made / "manifest.json").read_text())
    stated["made_ms"] += 1
    (made / "manifest.json").write_text(json.dumps(stated))
    said = run("restore", made, "--files-to", to, "--passphrase-file", passphrase, "--config", config, code=1)
    assert "an altered manifest" in said


@pytest.mark.parametrize("kind", ["sqlite"])
def test_numbers_are_in_it(place):
    assert NUMBER.encode() in (place.backup() / "database").read_bytes()


@pytest.mark.parametrize("name", ["../outside", "/outside", "in/../../outside"])
def test_files_of_a_backup_stay_below_the_directory_that_was_given(tmp_path, name):
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for each in ("fine", name):
            archive.addfile(tarfile.TarInfo(each), io.BytesIO())
    to = tmp_path / "to"
    with pytest.raises(BackendError, match="leads elsewhere; nothing is written"):
        sealed.unpack(packed.getvalue(), to)
    assert not to.exists()
