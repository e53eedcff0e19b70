"""`wonderland registry` against a real ledger: lists there and back, two people, and what is wrong said before anything."""

from __future__ import annotations

import csv
import io
import json
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from wonderland.cli import main
from wonderland.proofs.registration import Opening
from wonderland.registry.lists import KINDS

WONDERLAND = Path(sys.executable).with_name("wonderland")
DRONES = "uav_id;model;operator_id;registration\nD-1;Falcon;op-7;FIN87astrdge12k8\nD-2;Kestrel;op-7;\n"


@pytest.fixture(scope="module")
def connection(tmp_path_factory):
    """Of an embedded ledger in a process of its own, with its own people."""
    directory = tmp_path_factory.mktemp("registry")
    command = [WONDERLAND, "ledger", "start", "--data", directory, "--listen", "127.0.0.1:0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout.readline(), process.stderr.read().decode()
        yield directory / "connection.json"
        process.terminate()


@pytest.fixture
def registry(connection):
    """`registry(identity, *arguments)`: exit code, standard output, complaints."""

    def run(identity, kind, verb, *arguments):
        options = ("--connection", str(connection), "--identity", identity)
        done = CliRunner().invoke(main, ["registry", kind, verb, *map(str, arguments), *options])
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        return done.exit_code, done.stdout, done.stderr

    return run


@pytest.fixture
def said(registry):
    """As `registry`, of what has to go well: what it printed."""

    def run(*arguments):
        code, out, err = registry(*arguments)
        assert code == 0, out + err
        return out

    return run


def rows(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_a_list_of_drones_goes_in_once_and_comes_out_again(registry, said, tmp_path):
    file, openings = tmp_path / "drones.csv", tmp_path / "openings"
    file.write_text(DRONES)
    dry = said("fleet_operator", "drones", "import", file, "--openings", openings, "--dry-run")
    assert "D-1: new" in dry
    assert "D-2: new" in dry
    assert not openings.exists(), "a dry run writes nothing"
    assert rows(said("pad", "drones", "list", "--format", "csv")) == []
    said("fleet_operator", "drones", "import", file, "--openings", openings)
    kept = openings / "D-1.json"
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600
    record = json.loads(said("pad", "drones", "show", "D-1"))
    assert record["registration_commitment"] == Opening.decode(kept.read_bytes()).commitment
    assert "FIN87" not in json.dumps(record)
    code, out, err = registry("fleet_operator", "drones", "import", file, "--openings", openings, "--json")
    assert (code, err.strip()) == (0, f"{file}: 2 there already")
    assert [json.loads(line)["state"] for line in out.splitlines()] == ["there already"] * 2
    exported = said("pad", "drones", "export")
    again = tmp_path / "again.csv"
    again.write_text(exported)
    assert "2 there already" in registry("fleet_operator", "drones", "import", again)[2]
    assert [row["state"] for row in rows(said("pad", "drones", "list", "--format", "csv"))] == ["active"] * 2


def test_the_same_by_json_maintenance_and_authorisations(registry, said, tmp_path):
    said("fleet_operator", "drones", "add", "--uav-id", "D-3", "--model", "Owl", "--operator-id", "op-7")
    done, allowed = tmp_path / "done.json", tmp_path / "allowed.json"
    done.write_text(
        json.dumps([{"uav_id": "D-3", "performed": "2026-01-05", "valid_until": "2036-01-05", "work": "Yearly"}])
    )
    allowed.write_text(
        json.dumps(
            [
                {
                    "uav_id": "D-3",
                    "authorisation_id": "season",
                    "pad_id": "*",
                    "actions": ["land", "dock"],
                    "valid_from": "2026-01-01T12:00:00+02:00",
                    "valid_until": "2036-01-01",
                }
            ]
        )
    )
    said("fleet_operator", "maintenance", "import", done)
    said("inspector", "authorisations", "import", allowed)
    assert "1 there already" in registry("fleet_operator", "maintenance", "import", done)[2]
    assert "1 there already" in registry("inspector", "authorisations", "import", allowed)[2]
    (row,) = json.loads(said("pad", "authorisations", "export", "--format", "json"))
    assert (row["valid_from"], row["actions"]) == ("2026-01-01T10:00:00Z", "land dock")
    (listed,) = rows(said("pad", "maintenance", "list", "--format", "csv"))
    assert listed["uav_id"] == "D-3"
    said("inspector", "authorisations", "revoke", "D-3", "season", "--reason", "over")
    code, out, _ = registry("inspector", "authorisations", "import", allowed)
    assert code == 1
    assert "D-3/season: differs: was revoked" in out
    assert json.loads(said("pad", "authorisations", "show", "D-3", "season"))["revoked"] is True
    assert json.loads(said("pad", "authorisations", "export", "--format", "json")) == []


def test_pads_are_registered_edited_and_retired(registry, said):
    place = ("--latitude", "60.4518001", "--longitude", "22.2666", "--height-m", "30.25")
    pad = ("--pad-id", "quay", "--name", "Quay", "--operator-id", "op-1", *place)
    assert said("pad_operator", "pads", "add", *pad, "--dry-run").startswith("would submit RegisterPad")
    said("pad_operator", "pads", "add", *pad)
    assert registry("pad_operator", "pads", "add", *pad)[2].strip() == "Error: quay: there already", (
        "said, and not sent twice"
    )
    said("pad_operator", "pads", "edit", "quay", "--name", "Old quay")
    (row,) = rows(said("pad", "pads", "list", "--format", "csv"))
    assert (row["name"], row["latitude"], row["height_m"]) == ("Old quay", "60.4518001", "30.25")
    code, _, err = registry("pad_operator", "pads", "add", *pad)
    assert code == 1
    assert "differs: name is Old quay, not Quay" in err
    assert rows(said("pad", "operators", "list", "--format", "csv"))[0]["pads"] == "1"
    said("pad_operator", "pads", "retire", "quay", "--reason", "built over")
    assert said("pad", "pads", "export").count("\n") == 1
    assert registry("pad_operator", "pads", "edit", "quay", "--name", "New")[0] == 1


def test_a_policy_takes_two_people_and_so_does_a_reinstatement(registry, said):
    place = ("--latitude", "60.4", "--longitude", "22.2", "--height-m", "30")
    said("pad_operator", "pads", "add", "--pad-id", "roof", "--name", "Roof", "--operator-id", "op-1", *place)
    said("admin", "policies", "propose", "roof", "--set", "buffer_mm=800", "--set", "cancel_hopeless=true")
    (proposal,) = rows(said("inspector", "policies", "proposals", "--format", "csv"))
    code, _, err = registry("admin", "policies", "approve", proposal["change_id"], "--yes")
    assert code == 1
    assert "SAME_PERSON" in err
    shown = said("inspector", "policies", "approve", proposal["change_id"], "--yes")
    assert "buffer_mm: 1000 → 800" in shown
    assert json.loads(said("pad", "policies", "show", "roof"))["buffer_mm"] == 800
    (held,) = rows(said("pad", "policies", "list", "--format", "csv"))
    assert (held["pad_id"], held["buffer_mm"]) == ("roof", "800")
    said("fleet_operator", "drones", "add", "--uav-id", "D-9", "--model", "Owl", "--operator-id", "op-7")
    said("inspector", "drones", "suspend", "D-9", "--reason", "lost its way")
    said("inspector", "drones", "reinstate", "D-9", "--reason", "mended")
    waiting = [row for row in rows(said("pad", "policies", "proposals", "--format", "csv")) if row["state"] == "open"]
    said("admin", "policies", "approve", waiting[0]["change_id"], "--yes")
    states = {row["uav_id"]: row["state"] for row in rows(said("pad", "drones", "list", "--format", "csv"))}
    assert states["D-9"] == "active"


def test_closures_are_set_and_read_back(said, tmp_path):
    place = ("--latitude", "60.4", "--longitude", "22.2", "--height-m", "30")
    said("pad_operator", "pads", "add", "--pad-id", "lawn", "--name", "Lawn", "--operator-id", "op-1", *place)
    now_ms = time.time_ns() // 1_000_000
    file = tmp_path / "closed.json"
    closure = {"zone_id": "FIN:EFR1", "actions": ["land"], "from_ms": now_ms, "until_ms": now_ms + 3_600_000}
    file.write_text(json.dumps({"closures": [closure], "valid_until_ms": now_ms + 86_400_000}))
    said("admin", "closures", "set", "lawn", file)
    (row,) = rows(said("pad", "closures", "list", "--format", "csv"))
    assert (row["pad_id"], row["zone_id"]) == ("lawn", "FIN:EFR1")
    assert json.loads(said("pad", "closures", "show", "lawn"))["closures"] == [closure]


WRONG = {
    "a cell": ("drones.csv", "uav_id,model,operator_id,registration\n,Owl,op,\n", "line 2, uav_id: missing"),
    "a column": ("drones.csv", "uav_id,colour\nD-8,red\n", "colour"),
    "no list": ("drones.json", "{}", "a list of objects is wanted"),
    "no JSON": ("drones.json", "[", "no list in JSON"),
    "deep": ("drones.json", "[" * 100_000, "no list in JSON"),
    "an unknown field": ("drones.json", '[{"uav_id": "D-8", "model": "Owl", "operator_id": "op", "x": 1}]', "x"),
    "a table within": ("drones.json", '[{"uav_id": {"a": 1}, "model": "Owl", "operator_id": "op"}]', "uav_id"),
    "numbers, and nowhere to keep them": ("drones.csv", DRONES.replace("D-", "N-"), "say --openings DIR"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_list_with_something_wrong_submits_nothing(registry, said, tmp_path, name):
    file_name, text, complaint = WRONG[name]
    before = said("pad", "drones", "list", "--format", "csv")
    file = tmp_path / file_name
    file.write_text(text)
    code, _, err = registry("fleet_operator", "drones", "import", file)
    assert code == 1
    assert complaint in err
    assert said("pad", "drones", "list", "--format", "csv") == before


def test_who_may_not_is_told_by_the_contract_and_the_rest_goes_on(registry, tmp_path):
    file = tmp_path / "drones.csv"
    file.write_text(DRONES.replace("D-", "X-"))
    code, out, err = registry("pad", "drones", "import", file, "--openings", tmp_path / "openings")
    assert code == 1
    assert out.count("refused: ROLE") == 2, out
    assert "2 refused" in err


def test_a_name_that_looks_like_markup_is_printed_as_it_is(said):
    """Anybody who may register something chooses names that everybody lists."""
    for number, name in enumerate(("[/]", "[red]all is well[/red]", "x\u009b2Jy")):
        said("fleet_operator", "drones", "add", "--uav-id", f"M-{number}", "--model", name, "--operator-id", "op-7")
    table = said("pad", "drones", "list")
    assert "[/]" in table
    assert "[red]all is well[/red]" in table
    assert "\u009b" not in table


def test_no_ledger_no_identity_and_an_openings_file_of_another(registry, connection, tmp_path):
    code, _, err = registry("nobody", "drones", "list")
    assert code == 1
    assert "there is no such identity; there are: admin" in err
    gone = json.loads(connection.read_text())
    gone["gateway"]["address"] = "127.0.0.1:9"
    away = connection.with_name("away.json")
    away.write_text(json.dumps(gone))
    done = CliRunner().invoke(main, ["registry", "pads", "list", "--connection", str(away), "--identity", "pad"])
    assert done.exit_code == 1
    assert "Traceback" not in done.stderr
    openings = tmp_path / "openings"
    openings.mkdir()
    (openings / "D-5.json").write_text("{}")
    add = ("--uav-id", "D-5", "--model", "Owl", "--operator-id", "op", "--registration", "FIN87astrdge12k8")
    code, _, err = registry("fleet_operator", "drones", "add", *add, "--openings", openings)
    assert code == 1
    assert "D-5.json" in err
    assert (openings / "D-5.json").read_text() == "{}", "what is there is never written over"


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_help_says_what_a_cell_holds_and_not_what_the_ledger_does(kind):
    helped = CliRunner().invoke(main, ["registry", kind, "add", "--help"]).output
    assert "10⁷" not in helped
    assert "illimet" not in helped
    assert "illisecond" not in helped
    plain = KINDS[kind].argument.json_schema()["properties"]
    for column in KINDS[kind].columns.values():
        assert column.says or column.read("x") == "x"
        assert column.says or plain[column.field]["description"]


def test_a_pad_is_added_by_what_help_says(said):
    said("admin", "pads", "list")
    place = (
        "--latitude",
        "60.45",
        "--longitude",
        "22.26",
        "--height-m",
        "12.5",
        "--name",
        "Roof",
        "--operator-id",
        "skyport",
    )
    said("pad_operator", "pads", "add", "--pad-id", "by-help", *place)
    assert "60.45" in said("admin", "pads", "export")
