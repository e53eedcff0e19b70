"""The registry moved to another ledger: two embedded ones in processes of their own, person by person."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from kit.registry_house import commissioning

from wonderland.cli import main
from wonderland.proof_contract import ProofContract
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway

WONDERLAND = Path(sys.executable).with_name("wonderland")
PLACE = ("--latitude", "60.4", "--longitude", "22.2", "--height-m", "30")
PEOPLE = ("pad_operator", "fleet_operator", "admin", "inspector")


def invoke(*arguments):
    done = CliRunner().invoke(main, ["registry", *map(str, arguments)])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stdout, done.stderr


class Ledger:
    """One, with its people."""

    def __init__(self, directory):
        self.connection = directory / "connection.json"

    def run(self, identity, *arguments, code=0):
        ended, out, err = invoke(*arguments, "--connection", self.connection, "--identity", identity)
        assert ended == code, out + err
        return out + err

    def rows(self, kind):
        return json.loads(self.run("mirror", kind, "list", "--format", "json"))

    async def commission(self, pad_id):
        where = Connection.load(self.connection)
        async with where.open_channel() as channel:
            gateway = Gateway(channel, where.identity("pad_operator"), where.signer("pad_operator"))
            contract = ProofContract(gateway.network(where.channel), where.chaincode)
            await contract.commission_pad(pad_id, commissioning(time.time_ns() // 1_000_000, 60.4, 22.2))

    def taken(self, former, identity, *arguments, code=0):
        return self.run(identity, "move", "--from", former.connection, *arguments, code=code)


def started(directory):
    command = [WONDERLAND, "ledger", "start", "--data", directory, "--listen", "127.0.0.1:0", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline(), process.stderr.read().decode()
    return process


@pytest.fixture(scope="module")
def ledgers(tmp_path_factory):
    directories = [tmp_path_factory.mktemp(name) for name in ("former", "shared")]
    processes = [started(directory) for directory in directories]
    try:
        yield [Ledger(directory) for directory in directories]
    finally:
        for process in processes:
            with process:
                process.terminate()


@pytest.fixture(scope="module")
def former(ledgers, tmp_path_factory):
    """A ledger with a bit of everything, and what is not to be moved."""
    ledger, _ = ledgers
    for pad in ("roof", "lawn", "old"):
        name = ("--pad-id", pad, "--name", pad.title(), "--operator-id", "skyport", *PLACE)
        ledger.run("pad_operator", "pads", "add", *name)
    ledger.run("pad_operator", "pads", "retire", "old", "--reason", "gone")
    asyncio.run(ledger.commission("roof"))
    for drone in ("D-1", "D-2", "D-3"):
        ledger.run("fleet_operator", "drones", "add", "--uav-id", drone, "--model", "Owl", "--operator-id", "air")
        dates = ("--valid-from", "2026-01-01", "--valid-until", "2036-01-01")
        grant = ("--uav-id", drone, "--authorisation-id", "a-1", "--pad-id", "*", "--actions", "land", *dates)
        ledger.run("inspector", "authorisations", "add", *grant)
    work = ("--performed", "2026-05-01", "--valid-until", "2036-05-01", "--work", "new blades")
    ledger.run("fleet_operator", "maintenance", "add", "--uav-id", "D-1", *work)
    ledger.run("inspector", "drones", "suspend", "D-2", "--reason", "lost its way")
    ledger.run("fleet_operator", "drones", "retire", "D-3", "--reason", "sold")
    ledger.run("admin", "policies", "propose", "roof", "--set", "buffer_mm=800")
    (proposal,) = json.loads(ledger.run("inspector", "policies", "proposals", "--format", "json"))
    ledger.run("inspector", "policies", "approve", proposal["change_id"], "--yes")
    now_ms = time.time_ns() // 1_000_000
    file = tmp_path_factory.mktemp("closures") / "closed.json"
    closure = {"zone_id": "FIN:EFR1", "actions": ["land"], "from_ms": now_ms, "until_ms": now_ms + 3_600_000}
    file.write_text(json.dumps({"closures": [closure], "valid_until_ms": now_ms + 86_400_000}))
    ledger.run("admin", "closures", "set", "lawn", file)
    return ledger


def test_each_does_what_is_his_and_nothing_is_permitted_before_its_limits_hold(ledgers, former):
    shared = ledgers[1]
    dry = shared.taken(former, "pad_operator", "--dry-run")
    assert "roof: new" in dry
    assert "left for admin or fleet_operator of FleetMSP: 3" in dry
    assert not shared.rows("pads")

    assert "3 done" in shared.taken(former, "pad_operator")
    early = shared.taken(former, "inspector", code=1)  # the drone that is to be suspended is not there yet
    assert "suspension of D-2: refused" in early
    assert "authorisations wait until these are in force: suspension of D-2" in early
    said = shared.taken(former, "fleet_operator")
    assert "3 done" in said
    assert "left for admin or inspector: 1" in said
    said = shared.taken(former, "admin")
    assert "suspension of D-2, closures of lawn, policy of roof for *" in said
    assert not shared.rows("authorisations")
    again = shared.taken(former, "admin", code=1)
    assert "policy of roof for *: differs: was proposed; a second person has to approve it" in again
    assert not shared.rows("authorisations")
    (proposal,) = json.loads(shared.run("inspector", "policies", "proposals", "--format", "json"))
    shared.run("inspector", "policies", "approve", proposal["change_id"], "--yes")
    said = shared.taken(former, "inspector")
    assert "2 done" in said
    assert "left" not in said

    for identity in PEOPLE:
        said = shared.taken(former, identity)
        assert " done" not in said
        assert "new" not in said
    assert {row["pad_id"] for row in shared.rows("pads")} == {"roof", "lawn"}
    assert {row["uav_id"]: row["state"] for row in shared.rows("drones")} == {"D-1": "active", "D-2": "suspended"}
    assert [row["uav_id"] for row in shared.rows("authorisations")] == ["D-1", "D-2"]
    assert [row["work"] for row in shared.rows("maintenance")] == ["new blades"]
    for question in (("policies", "show", "roof"), ("closures", "show", "lawn"), ("pads", "show", "roof")):
        before, after = (json.loads(ledger.run("pad", *question)) for ledger in (former, shared))
        for document in (before, after):
            for moment in ("registered_ms", "updated_ms", "set_ms"):
                document.pop(moment, None)
        assert before == after


def test_what_is_another_there_is_named_and_left_alone(ledgers, former):
    shared = ledgers[1]
    shared.run("pad_operator", "pads", "edit", "roof", "--name", "Another")
    said = shared.taken(former, "pad_operator", "--json", code=1)
    lines = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
    (other,) = [line for line in lines if line["state"] == "differs"]
    assert (other["id"], other["why"]) == ("roof", "is another there: name")
    assert next(row["name"] for row in shared.rows("pads") if row["pad_id"] == "roof") == "Another"


def test_no_former_ledger_and_nobody_of_that_name(ledgers, tmp_path):
    former, shared = ledgers
    assert "does not exist" in shared.run("admin", "move", "--from", tmp_path / "none.json", code=2)
    assert "nobody" in shared.run("nobody", "move", "--from", former.connection, code=1)
    assert "stranger" in shared.taken(former, "admin", "--from-identity", "stranger", code=1)
