"""`wonderland doctor` on parts that are whole, and on each thing that is really broken."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from kit.backend_process import ledger
from sqlalchemy.engine import make_url

from wonderland.doctor import checks, command
from wonderland.doctor.checks import DAY_MS, Clock
from wonderland_backend.backup.make import backups
from wonderland_backend.backup.manifest import moment_ms
from wonderland_backend.db.roles import confine

__all__ = ["ledger"]
NOW_MS = 1_800_000_000_000


async def doctor(*arguments, path=None):
    """Exit code, and the checks by part and what: a list of each."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "wonderland.cli", "doctor", "--json"),
        *map(str, arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env=os.environ | ({} if path is None else {"PATH": f"{path}{os.pathsep}{os.environ['PATH']}"}),
    )
    out, err = await asyncio.wait_for(process.communicate(), 60)
    assert not err, err.decode()
    found = {}
    for line in out.decode().splitlines():
        each = json.loads(line)
        assert bool(each["next_step"]) or each["status"] in {"ok", "not_checked"}, each
        found.setdefault((each["part"], each["what"]), []).append((each["status"], each["text"]))
    return process.returncode, found


@pytest.fixture
def time_server(tmp_path):
    """A `chronyc` that answers as chrony's does, so that this machine's own clock is nobody's business."""

    def answers(offset_s, leap="Normal"):
        program = tmp_path / "bin" / "chronyc"
        program.parent.mkdir(exist_ok=True)
        line = (
            f"A9FEA97B,169.254.169.123,4,1795760000.0,{offset_s:.9f},0.0,0.0,-12.1,0.0,0.02,0.0003,0.0001,16.2,{leap}"
        )
        program.write_text(f"#!/bin/sh\necho '{line}'\n")
        program.chmod(0o755)
        return program.parent

    return answers


@pytest.fixture
def pad(ledger, tmp_path):
    """A pad's settings, each of its boards on a pty."""
    pairs = [os.openpty() for _ in range(3)]
    path = tmp_path / "pad.toml"
    lines = ['pad_id = "pad-1"', 'connection = "ledger/connection.json"', 'spool = "spool"']
    for number, (_, slave) in enumerate(pairs):
        lines += ["[[anchors]]", f'anchor_id = "A{number}"', f'port = "{os.ttyname(slave)}"']
    path.write_text("\n".join(lines))
    yield path
    for pair in pairs:
        for each in pair:
            os.close(each)


async def test_a_pad_that_is_whole(pad, time_server):
    code, found = await doctor("--config", pad, path=time_server(0.0004))
    assert code == 0, found
    assert {each[0] for every in found.values() for each in every} == {"ok"}
    assert "the key fits its certificate" in found["pad", "identity"][0][1]
    assert "blocks" in found["pad", "ledger"][0][1]
    assert len(found["pad", "port"]) == 3


async def test_what_is_broken_of_a_pad_is_named(pad, ledger, tmp_path, time_server):
    connection = json.loads((tmp_path / "ledger" / "connection.json").read_text())
    key = tmp_path / "ledger" / connection["identities"]["pad"]["key"]
    good = pad.read_text()
    clock = time_server(3.2)

    async def one(what, status="failed", text="", code=1):
        done, found = await doctor("--config", pad, path=clock)
        assert done == code, found
        assert any(each[0] == status and text in each[1] for each in found["pad", what]), found
        return found

    found = await one("port", "ok")
    assert found["machine", "clock"] == [("failed", "chrony: 3.200 s off")]
    clock = time_server(0.0, "Not synchronised")
    assert (await one("port", "ok"))["machine", "clock"] == [("failed", "chrony: the clock is not in step")]
    clock = time_server(0.0)

    pad.write_text(good.replace("/dev/pts", "/dev/nothing"))
    await one("port", text="is not there")
    pad.write_text(good.replace("/dev/pts/", f"{tmp_path}/pts-"))
    for line in pad.read_text().splitlines():
        if line.startswith("port"):
            Path(line.split('"')[1]).touch()
    await one("port", text="no serial port")
    pad.write_text(good.replace("pad_id", "pod_id"))
    await one("settings", text="pod_id")
    pad.write_text(good)

    key.chmod(0o644)
    await one("key", text="mode 0644")
    key.chmod(0o600)
    kept = key.read_bytes()
    shutil.copy(tmp_path / "ledger" / connection["identities"]["mirror"]["key"], key)
    await one("ledger", text="signature")
    key.write_bytes(kept)
    await ledger.stop()
    await one("ledger", text="does not answer")


@pytest.mark.parametrize("database_url", [pytest.param("postgresql", marks=pytest.mark.postgres)], indirect=True)
async def test_a_backend_whose_server_owns_its_tables_is_warned(ledger, database_url, database, tmp_path, time_server):
    path = tmp_path / "backend.toml"
    settings = 'database = "{}"\nconnection = "' + str(tmp_path / "ledger" / "connection.json") + '"\n'
    path.write_text(settings.format(database_url))
    clock = time_server(0.0)
    _, found = await doctor("--config", path, path=clock)
    assert found["backend", "database"][0][0] == "ok"
    assert found["backend", "role"][0][0] == "warning"
    assert found["backend", "ledger"][0][0] == "ok"
    await confine(database, "doctors_server", "a password")
    path.write_text(settings.format(make_url(database_url).set(username="doctors_server").render_as_string()))
    _, found = await doctor("--config", path, path=clock)
    assert found["backend", "role"] == [("ok", "the server cannot change the audit log")]
    async with database.write() as connection:  # who may become the owner is not confined
        await connection.exec_driver_sql(f"GRANT {make_url(database_url).username} TO doctors_server")
    _, found = await doctor("--config", path, path=clock)
    assert found["backend", "role"][0][0] == "warning"


async def test_what_is_broken_of_a_backend_is_named(tmp_path, time_server):
    path = tmp_path / "backend.toml"
    missing = tmp_path / "none.db"
    path.write_text(f'database = "sqlite:///{missing}"\n')
    code, found = await doctor("--config", path, path=time_server(0.0))
    assert code == 1
    assert found["backend", "database"][0] == ("failed", f"there is no file {missing}")
    assert not missing.exists(), "a check makes nothing"
    assert found["backend", "ledger"][0][0] == found["backend", "backup"][0][0] == "failed"
    missing.touch()
    _, found = await doctor("--config", path, path=time_server(0.0))
    assert "revision none" in found["backend", "database"][0][1]
    path.write_text("databse = 1\n")
    _, found = await doctor("--config", path, path=time_server(0.0))
    assert "databse" in found["backend", "settings"][0][1]


async def test_a_file_of_no_part_is_refused(tmp_path):
    (tmp_path / "other.toml").touch()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "wonderland.cli", "doctor", "--config", str(tmp_path / "other.toml")),
        stderr=asyncio.subprocess.PIPE,
    )
    _, err = await process.communicate()
    assert process.returncode == 2
    assert b"backend.toml, pad.toml, uav.toml" in err


def test_what_may_not_be_looked_at_is_said_and_other_parts_go_on(tmp_path, monkeypatch):
    def forbidden(path, now_ms):
        yield checks.Check("pad", "settings", "ok", "read")
        raise PermissionError(13, "Permission denied", "/var/lib/wonderland/key")

    def fine(path, now_ms):
        yield checks.Check("uav", "settings", "ok", "read")

    entries = [SimpleNamespace(name=name, load=lambda of=of: of) for name, of in (("pad", forbidden), ("uav", fine))]
    monkeypatch.setattr(command, "entry_points", lambda group: entries)
    files = [tmp_path / f"{name}.toml" for name in ("pad", "uav")]
    for each in files:
        each.touch()
    told = CliRunner().invoke(command.doctor, ["--json", "--config", str(files[0]), "--config", str(files[1])])
    found = [(each["part"], each["status"]) for each in map(json.loads, told.output.splitlines())]
    assert found[-3:] == [("pad", "ok"), ("pad", "not_checked"), ("uav", "ok")]
    assert "/var/lib/wonderland/key: Permission denied" in told.output


async def test_the_newest_backup_is_as_old_as_its_manifest_says(tmp_path):
    made = tmp_path / "wonderland-20270115T080000000Z"
    made.mkdir()
    (made / "manifest.json").write_text(f'{{"made_ms": {NOW_MS - 3 * DAY_MS}, "more": 1}}')
    assert moment_ms(backups(tmp_path)[-1]) == NOW_MS - 3 * DAY_MS
    (made / "manifest.json").write_text("{")
    assert moment_ms(made) is None


def test_limits():
    assert checks.clock(None).status == "not_checked"
    assert [checks.clock(Clock("chrony", True, each)).status for each in (0.09, -0.2, -1.0)] == [
        "ok",
        "warning",
        "failed",
    ]
    assert checks.versions({"wonderland-core": "1", "wonderland-backend": "1"}).status == "ok"
    assert checks.versions({"wonderland-core": "1", "wonderland-backend": "2"}).status == "failed"
    free = [checks.disk("pad", "/", each).status for each in (1 << 31, 1 << 29, 1 << 20)]
    assert free == ["ok", "warning", "failed"]
    certificate = [
        checks.certificate("pad", "it", 0, NOW_MS + days * DAY_MS, NOW_MS, "renew").status for days in (30, 3, -1)
    ]
    assert certificate == ["ok", "warning", "failed"]
    assert checks.certificate("pad", "it", NOW_MS + 1, NOW_MS + DAY_MS, NOW_MS, "renew").status == "failed"
    assert [checks.secret_file("pad", "k", mode).status for mode in (0o100600, 0o100640, 0o100644, 0o100660)] == [
        "ok",
        "ok",
        "failed",
        "failed",
    ]
    assert [checks.backups(each, "/b", NOW_MS).status for each in (NOW_MS, NOW_MS - 3 * DAY_MS, None)] == [
        "ok",
        "warning",
        "failed",
    ]
