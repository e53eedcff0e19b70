"""``wonderland network``: what it says when it cannot."""

import json

import pytest
from click.testing import CliRunner

from wonderland_fabric_network import bringing_up
from wonderland_fabric_network.commands import network
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.layout import NetworkDirectory


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command on a machine without Fabric's servers."""
    monkeypatch.setenv("FABRIC_BIN", str(tmp_path / "nothing"))
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))

    def run(*arguments):
        return CliRunner().invoke(network, [*arguments, "--dir", str(tmp_path / "net")])

    return run


@pytest.fixture
def made(tmp_path):
    """A network that was described and never started."""
    return bringing_up.new_network(NetworkDirectory(tmp_path / "net"), NetworkDescription())


def test_help_tells_the_first_steps(run):
    answer = CliRunner().invoke(network, ["--help"])
    assert "wonderland network up" in answer.output
    for command in ("up", "status", "logs", "down", "destroy", "enrol", "revoke", "upgrade", "add-org", "renew"):
        assert f"  {command} " in answer.output


def test_up_without_fabrics_servers_says_where_they_are_and_writes_nothing(run, tmp_path):
    answer = run("up")
    assert answer.exit_code == 1
    assert "peer, orderer, fabric-ca-server not found" in answer.output
    assert "releases" in answer.output
    assert not (tmp_path / "net").exists()


def test_up_with_a_bad_description_names_file_and_field(run, tmp_path):
    (tmp_path / "my.yaml").write_text("ordering: {consensus: paxos}")
    answer = run("up", "--file", str(tmp_path / "my.yaml"))
    assert answer.exit_code == 1
    assert "my.yaml: ordering.consensus: 'paxos' is none of raft, bft" in " ".join(answer.output.split())


def test_too_few_orderers_for_bft_are_refused(run):
    answer = run("up", "--consensus", "bft", "--orderers", "3")
    assert answer.exit_code == 1
    assert "bft needs at least 4" in answer.output


@pytest.mark.parametrize(
    "command", [["status"], ["logs"], ["down"], ["destroy", "--yes"], ["enrol", "x", "--role", "pad"]]
)
def test_without_a_network_every_command_says_so(run, command):
    answer = run(*command)
    assert answer.exit_code == 1
    assert "there is no network in" in answer.output
    assert "wonderland network up" in answer.output


def test_status_of_a_network_that_never_ran(run, made):
    answer = run("status", "--json")
    assert answer.exit_code == 3
    status = json.loads(answer.output)
    assert status["healthy"] is False
    assert {each["pid"] for each in status["components"]} == {None}


def test_enrolling_while_the_ca_is_down_says_so(run, made):
    answer = run("enrol", "pad-7", "--role", "pad")
    assert answer.exit_code == 1
    assert "Error: " in answer.output
    assert "Traceback" not in answer.output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["revoke"], "say one of: a name, --serial, --crl"),
        (["revoke", "x", "--serial", "ab"], "say one of"),
        (["revoke", "--serial", "ab"], "say the organisation with --org"),
        (["revoke", "nobody"], "none has one"),
        (["add-org", "Pad 2", "--kind", "pads"], "msp_id: 'Pad 2' does not match"),
        (["logs", "PadMSP.peer0"], "there is no component"),
    ],
)
def test_what_is_missing_or_wrong_is_said(run, made, arguments, says):
    answer = run(*arguments)
    assert answer.exit_code != 0
    assert says in " ".join(answer.output.split())


def test_destroy_asks_first_and_leaves_foreign_files(run, made, tmp_path):
    (tmp_path / "net" / "notes.txt").write_text("mine")
    assert CliRunner().invoke(network, ["destroy", "--dir", str(tmp_path / "net")], input="n\n").exit_code == 1
    assert (tmp_path / "net" / "network.yaml").exists()
    assert run("destroy", "--yes").exit_code == 0
    assert [each.name for each in (tmp_path / "net").iterdir()] == ["notes.txt"]
