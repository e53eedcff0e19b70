"""`wonderland ledger …`, as a person or a script uses it."""

import asyncio
import json
import signal
import subprocess
import sys

import pytest
from click.testing import CliRunner

from wonderland_fabric_gateway.commands import ledger
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.gateway import Gateway, GatewayError

MAIN = [sys.executable, "-m", "wonderland.cli", "ledger"]


def run(*args, code=0):
    """Run a command in this process; its output, parsed where it is JSON."""
    result = CliRunner().invoke(ledger, [str(each) for each in args])
    assert result.exit_code == code, result.output
    return json.loads(result.output) if "--json" in args and code == 0 else result.output


async def command(*args, code=0):
    """The same beside a running event loop."""
    return await asyncio.to_thread(run, *args, code=code)


async def whoami(directory, name):
    connection = Connection.load(directory)
    async with connection.open_channel() as channel:
        gateway = Gateway(channel, connection.identity(name), connection.signer(name))
        contract = gateway.network(connection.channel).contract(connection.chaincode)
        return json.loads(await contract.evaluate("whoami"))


@pytest.fixture
def directory(world):
    return world.ledger.directory.path


async def test_status_of_a_running_and_a_stopped_ledger(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        answer = await command("status", "--data", tmp_path / "l", "--json")
        assert answer["running"] is True
        assert answer["address"] == world.connection.gateway.address
        assert answer["height"] == 1
        assert answer["notice"] == NOTICE
        text = await command("status", "--data", tmp_path / "l")
        assert "no multi-party trust" in text
        tip = world.chain.tip.header_hash.hex()
    answer = await command("status", "--data", tmp_path / "l", "--json")
    assert answer["running"] is False
    assert (answer["height"], answer["tip_hash"], answer["channel"]) == (1, tip, "wonderland")
    assert "does not run" in await command("status", "--data", tmp_path / "l")


async def test_enrol_while_it_runs(directory):
    answer = await command("ca", "enrol", "pad-7", "--data", directory, "--role", "pad", "--json")
    assert answer["msp_id"] == "PadMSP"
    who = await whoami(directory, "pad-7")
    assert (who["role"], who["pol_id"], who["common_name"], who["msp_id"]) == ("pad", "pad-7", "pad-7", "PadMSP")
    await command("ca", "enrol", "drone", "--data", directory, "--role", "uav", "--id", "uav-9", "--days", "1")
    assert (await whoami(directory, "drone"))["pol_id"] == "uav-9"


async def test_enrol_refuses(directory):
    assert "already holds" in await command("ca", "enrol", "pad", "--data", directory, "--role", "pad", code=1)
    assert "choose another name" in await command("ca", "enrol", "pad", "--data", directory, "--role", "uav", code=1)
    assert "belongs to the ledger" in await command("ca", "enrol", "peer", "--data", directory, "--role", "pad", code=1)
    assert "belongs to FleetMSP" in await command(
        "ca", "enrol", "x", "--data", directory, "--role", "uav", "--org", "PadMSP", code=1
    )
    assert "a letter or digit" in await command("ca", "enrol", "a/b", "--data", directory, "--role", "pad", code=1)
    assert "Invalid value" in await command("ca", "enrol", "x", "--data", directory, "--role", "king", code=2)


async def test_revoke_reaches_the_running_ledger_at_once(directory, world):
    assert (await whoami(directory, "uav"))["role"] == "uav"
    answer = await command("ca", "revoke", "uav", "--data", directory, "--reason", "keyCompromise", "--json")
    assert answer["running"] is True
    assert answer["block"] == 1
    assert len(answer["revoked"]) == 1
    with pytest.raises(GatewayError, match="revoked"):
        await whoami(directory, "uav")
    assert "no identity certificate that could be revoked" in await command(
        "ca", "revoke", "uav", "--data", directory, code=1
    )
    rows = (await command("ca", "list", "--data", directory, "--json"))["certificates"]
    assert {row["name"]: row["state"] for row in rows if row["msp_id"] == "FleetMSP"} == {
        "msp-admin": "valid",
        "fleet_operator": "valid",
        "uav": "revoked",
    }
    await command("ca", "enrol", "uav", "--data", directory, "--role", "uav", "--id", "uav-1")
    assert (await whoami(directory, "uav"))["pol_id"] == "uav-1"


async def test_revoke_by_serial_and_while_stopped(tmp_path, open_world):
    async with open_world(tmp_path / "l"):
        pass
    rows = (await command("ca", "list", "--data", tmp_path / "l", "--org", "PadMSP", "--json"))["certificates"]
    (serial,) = [row["serial"] for row in rows if row["name"] == "pad"]
    assert "when it starts" in await command("ca", "revoke", "--serial", serial.upper(), "--data", tmp_path / "l")
    async with open_world(tmp_path / "l"):
        with pytest.raises(GatewayError, match="revoked"):
            await whoami(tmp_path / "l", "pad")


async def test_revoke_refuses(directory):
    assert "no organisation's CA" in await command("ca", "revoke", "nobody", "--data", directory, code=1)
    assert "either the name or the serial" in await command("ca", "revoke", "--data", directory, code=1)
    assert "no organisation's CA" in await command("ca", "revoke", "--serial", "ff", "--data", directory, code=1)
    assert "does not revoke itself" in await command("ca", "revoke", "peer", "--data", directory, code=1)
    assert "reason" in await command("ca", "revoke", "pad", "--data", directory, "--reason", "mood", code=1)


async def test_renew_keeps_role_and_id(directory):
    before = await whoami(directory, "pad")
    await command("ca", "renew", "pad", "--data", directory, "--days", "30")
    after = await whoami(directory, "pad")
    assert before["certificate_sha256"] != after["certificate_sha256"]
    assert (after["role"], after["pol_id"]) == ("pad", "pad-1")


async def test_renew_with_revocation_of_the_old(directory, tmp_path):
    await command("ca", "export", "pad", "--data", directory, "--to", tmp_path / "old")
    await command("ca", "renew", "pad", "--data", directory, "--revoke-old")
    assert (await whoami(directory, "pad"))["pol_id"] == "pad-1"
    with pytest.raises(GatewayError, match="revoked"):
        await whoami(tmp_path / "old", "pad")


async def test_export_gives_a_directory_that_stands_alone(directory, tmp_path):
    await command("ca", "export", "uav", "--data", directory, "--to", tmp_path / "drone")
    moved = (tmp_path / "drone").rename(tmp_path / "moved")
    assert (await whoami(moved, "uav"))["pol_id"] == "uav-1"
    assert set(Connection.load(moved).identities) == {"uav"}
    assert (moved / "uav.key").stat().st_mode & 0o777 == 0o600
    assert "not empty" in await command("ca", "export", "uav", "--data", directory, "--to", moved, code=1)
    assert "enrol it first" in await command("ca", "export", "x", "--data", directory, "--to", tmp_path / "x", code=1)


@pytest.mark.parametrize(
    "args",
    [
        ("status",),
        ("ca", "list"),
        ("ca", "enrol", "x", "--role", "pad"),
        ("ca", "renew", "x"),
        ("ca", "revoke", "x"),
        ("ca", "export", "x", "--to", "y"),
    ],
)
def test_a_directory_without_a_ledger(tmp_path, args):
    output = run(*args, "--data", tmp_path / "empty", code=1)
    assert "there is no" in output
    assert not (tmp_path / "empty").exists()


@pytest.mark.parametrize(
    "args", [(), ("start",), ("status",), ("ca",), ("ca", "enrol"), ("ca", "revoke"), ("ca", "list")]
)
def test_help_teaches(args):
    output = run(*args, "--help")
    assert "Usage" in output
    assert len(output.splitlines()) > 6


def test_start_says_what_is_wrong(tmp_path):
    assert "no contract 'nix' is installed" in run("start", "--data", tmp_path, "--contract", "nix", code=1)
    assert "HOST:PORT" in run("start", "--data", tmp_path / "l", "--listen", "nowhere", "--contract", "pol", code=1)


@pytest.mark.parametrize("stopper", [signal.SIGTERM, signal.SIGINT])
def test_start_serves_says_so_and_stops_on_a_signal(tmp_path, stopper):
    process = subprocess.Popen(
        [*MAIN, "start", "--data", tmp_path / "l", "--listen", "127.0.0.1:0", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        ready = json.loads(process.stdout.readline())
        assert ready["ready"] is True
        assert ready["notice"] == NOTICE
        assert Connection.load(tmp_path / "l").gateway.address == ready["address"]
        assert run("status", "--data", tmp_path / "l", "--json")["running"] is True
        second = subprocess.run(
            [*MAIN, "start", "--data", tmp_path / "l"], capture_output=True, text=True, timeout=20, check=False
        )
        assert second.returncode == 1
        assert f"process {process.pid}" in second.stderr
        process.send_signal(stopper)
        _, errors = process.communicate(timeout=10)
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
    assert process.returncode == 0
    assert "no multi-party trust" in errors
    assert "Traceback" not in errors
    assert run("status", "--data", tmp_path / "l", "--json")["running"] is False
