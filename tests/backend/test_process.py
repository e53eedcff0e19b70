"""The backend as a process on a real embedded ledger: served, killed, started again, rebuilt."""

from __future__ import annotations

import asyncio
import json
import signal

import pytest
from click.testing import CliRunner
from kit.backend_process import ledger, mirrored, ready, run, signed_in, start, stop

from wonderland.proofs import encoding
from wonderland_backend.commands import backend
from wonderland_fabric_gateway.gateway import Gateway

PAD = {
    "pad_id": "pad-1",
    "name": "Aurajoki 2",
    "operator_id": "turku",
    "lat_e7": 604_518_000,
    "lon_e7": 222_666_000,
    "height_mm": 30_000,
}


__all__ = ["ledger"]


@pytest.fixture
async def submit(ledger):
    connection = ledger.connection
    async with connection.open_channel() as channel:

        async def submit(who, function, **argument):
            gateway = Gateway(channel, connection.identity(who), connection.signer(who))
            contract = gateway.network(connection.channel).contract(connection.chaincode)
            return await contract.submit(function, encoding.encode(argument))

        yield submit


async def test_served_killed_and_started_again(tmp_path, ledger, submit):
    database = f"sqlite:///{tmp_path / 'backend.db'}"
    token_file = tmp_path / "token"
    process = await start(tmp_path, "--token-file", str(token_file), database=database)
    try:
        told = await ready(process)
        assert told["ready"] is True
        assert token_file.read_text().strip() == told["token"]
        assert token_file.stat().st_mode & 0o777 == 0o600
        async with signed_in(told) as http:
            done = await submit("pad_operator", "RegisterPad", **PAD)
            status = await mirrored(http, done.block_number + 1)
            assert status["ledger"]["kind"] == "embedded"
            assert "trust" in status["ledger"]["notice"]
            assert status["server"]["demo"] is True
            pad = (await http.get("/api/v1/pads/pad-1")).json()
            assert (pad["name"], pad["msp_id"], pad["status"]) == ("Aurajoki 2", "PadMSP", "registered")
            found = (await http.get(f"/api/v1/transactions/{done.tx_id}")).json()
            assert (found["function"], found["event"], found["valid"]) == ("RegisterPad", "PadRegistered", True)
            assert found["creator"]["name"] == "pad_operator"

            writing = asyncio.create_task(many(submit, 120))
            await asyncio.sleep(0.15)
            process.send_signal(signal.SIGKILL)
            await writing
        await process.wait()
        process = await start(tmp_path, database=database)
        async with signed_in(await ready(process)) as http:
            status = await mirrored(http, ledger.chain.height)
            assert status["ledger"]["halted"] is None
            blocks = (await http.get("/api/v1/blocks", params={"limit": 500})).json()["items"]
            assert [block["number"] for block in blocks] == list(reversed(range(ledger.chain.height)))
            assert sum(block["valid"] for block in blocks) >= 121
        assert await stop(process) == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()

    code, out, _ = await run("digest", "--database", database, "--json")
    assert code == 0
    assert json.loads(out)["tables"]["assets"]["rows"] == 120
    connection = str(tmp_path / "ledger" / "connection.json")
    code, rebuilt, err = await run("rebuild", "--database", database, "--connection", connection, "--json")
    assert code == 0, err
    assert json.loads(rebuilt)["before"] == json.loads(rebuilt)["after"] == json.loads(out)


async def many(submit, count):
    async def one(index):
        await submit("uav", "CreateAsset", id=f"asset-{index}", type="t", media_type="text/plain", value="x" * 50)

    for first in range(0, count, 10):
        await asyncio.gather(*(one(index) for index in range(first, first + 10)))


async def test_links_for_more_people(tmp_path, ledger):
    database = f"sqlite:///{tmp_path / 'backend.db'}"
    process = await start(tmp_path, database=database)
    try:
        told = await ready(process)
        code, out, _ = await run("link", "--database", database, "--json")
        assert code == 0
        async with signed_in(told | {"token": json.loads(out)["token"]}) as http:
            assert (await http.get("/api/v1/session")).json()["name"] == "Demo"
    finally:
        assert await stop(process) == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["serve", "--listen", "nowhere"], "not HOST:PORT"),
        (["serve", "--listen", "127.0.0.1:0"], "--connection"),
        (["serve", "--listen", "0.0.0.0:0", "--demo"], "loopback only"),
        (["serve", "--listen", "0.0.0.0:0"], "can reach 0.0.0.0:0 by http"),
        (["serve", "--listen", "[::]:0"], "can reach [::]:0 by http"),
        (["serve", "--listen", "pad.example:0", "--public-url", "http://pad.example"], "--plaintext inside a network"),
        (["serve", "--listen", "0.0.0.0:0", "--public-url", "https://pad.example"], "--connection"),
        (["serve", "--listen", "0.0.0.0:0", "--plaintext"], "--connection"),
        (["serve", "--listen", "127.0.0.1:0", "--connection", "/nowhere/connection.json"], "/nowhere/connection.json"),
        (["serve", "--listen", "127.0.0.1:0", "--console", "/nowhere"], "no index.html"),
        (["serve", "--database", "mysql://x/y", "--connection", "x"], "not supported"),
        (["digest", "--database", "sqlite:////nowhere/none.db"], "there is no file"),
        (["migrate", "--database", "oracle://x"], "not supported"),
        (["serve", "--public-url", "ftp://x"], "public_url"),
    ],
)
def test_wrong_options_are_one_line(arguments, said):
    done = CliRunner().invoke(backend, arguments)
    assert done.exit_code == 1
    assert isinstance(done.exception, SystemExit), done.exception
    assert said in done.output
    assert len(done.output.splitlines()) == 1


def test_the_description_is_printed():
    done = CliRunner().invoke(backend, ["openapi"])
    assert done.exit_code == 0
    document = json.loads(done.output)
    assert document["openapi"].startswith("3.1")
    assert "/api/v1/sessions/{session_id}" in document["paths"]
