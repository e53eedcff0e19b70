"""``wonderland chaincode`` as a process: ready line, health, SIGTERM in the middle of work, and clear refusals."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from contextlib import asynccontextmanager

import grpc
import pytest
from click.testing import CliRunner

from wonderland.proofs import encoding
from wonderland_chaincode.commands import chaincode

PACKAGE_ID = "pol_1.0:" + "ef" * 32


@asynccontextmanager
async def started(tmp_path, *options, env=None):
    """The process and its ready line; ended by its id if it still runs."""
    with (tmp_path / "log").open("wb") as log:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "wonderland.cli", "chaincode", "serve", "--json", *options,
            stdout=asyncio.subprocess.PIPE, stderr=log, env=os.environ | (env or {}),
        )  # fmt: skip
    try:
        yield process, json.loads(await asyncio.wait_for(process.stdout.readline(), 30))
    finally:
        if process.returncode is None:
            process.kill()
        await process.wait()
        process._transport.close()


async def command(*arguments):
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "wonderland.cli", "chaincode", *arguments,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    output, _ = await asyncio.wait_for(process.communicate(), 30)
    return process.returncode, output.decode()


async def test_a_service_runs_the_installed_contract_and_ends_when_told(tools, tmp_path):
    environment = {"CHAINCODE_ID": PACKAGE_ID, "CHAINCODE_SERVER_ADDRESS": "127.0.0.1:0"}
    options = ("--metrics", "127.0.0.1:0", "--log", "json", "--time-window-s", "86400")
    async with started(tmp_path, *options, env=environment) as (process, ready):
        assert (ready["ready"], ready["contract"], ready["tls"]) == (True, "pol", "none")
        assert ready["package_id"] == PACKAGE_ID
        async with grpc.aio.insecure_channel(ready["address"]) as channel:
            stream = channel.stream_stream("/protos.Chaincode/Connect")()
            peer = await tools.FakePeer(stream, tools.State()).register()
            now_ms = time.time_ns() // 1_000_000
            pad = {"pad_id": "p", "name": "P", "operator_id": "o", "lat_e7": 0, "lon_e7": 0, "height_mm": 0}
            operator = tools.Person("olga", "PadMSP", (("pol.role", "pad_operator"),))
            call = tools.Call("RegisterPad", (encoding.encode(pad),), who=operator, timestamp_ms=now_ms)
            ended = await peer.run(call)
            assert (ended.status, ended.text) == (200, "")
            assert ended.event[0] == "PadRegistered"
            code, text = await command("health", "--at", ready["metrics"])
            assert (code, text.splitlines()[0]) == (0, f"OK: package {PACKAGE_ID}")
            code, text = await command("health", "--at", ready["metrics"], "--json")
            assert json.loads(text)["contract_version"] == ready["version"]
            # A transaction under way is finished, then the process ends by itself.
            peer.delay_s = 0.5
            call = tools.Call("ReadPad", (b'{"pad_id":"p"}',), who=operator, timestamp_ms=now_ms)
            begun = await peer.begin(call)
            await asyncio.sleep(0.2)
            process.send_signal(signal.SIGTERM)
            assert (await peer.end(call, begun)).status == 404
            assert await asyncio.wait_for(process.wait(), 10) == 0
    code, text = await command("health", "--at", ready["metrics"])
    assert code == 1
    assert "no contract service answers" in text
    lines = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert [line["message"] for line in lines if line["message"] == "stopping"]


async def test_ctrl_c_ends_an_idle_service(tmp_path):
    async with started(tmp_path, "--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0") as (process, _):
        process.send_signal(signal.SIGINT)
        assert await asyncio.wait_for(process.wait(), 10) == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--package-id", "pol", "--listen", "127.0.0.1:0"), "'pol' is no package id: LABEL:HASH"),
        (("--package-id", "pol:" + "AB" * 32, "--listen", "127.0.0.1:0"), "is no package id"),
        (("--package-id", PACKAGE_ID, "--listen", "7051"), "'7051' is no HOST:PORT"),
        (("--package-id", PACKAGE_ID, "--listen", "0.0.0.0:0"), "can be reached by other machines"),
        (("--package-id", PACKAGE_ID, "--listen", "[::]:0"), "can be reached by other machines"),
        (("--package-id", PACKAGE_ID, "--listen", "contract.example:9999"), "can be reached by other machines"),
        (
            ("--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--contract", "nix"),
            "no contract 'nix' is installed",
        ),
        (("--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--tls-cert", "c.pem"), "--tls-cert and --tls-key"),
        (("--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--client-ca", "c.pem"), "--tls-cert and --tls-key"),
        (
            ("--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--tls-cert", "nowhere", "--tls-key", "nowhere"),
            "TLS certificate: cannot read nowhere",
        ),
        (("--package-id", PACKAGE_ID, "--listen", "127.0.0.1:0", "--metrics", "x"), "'x' is no HOST:PORT"),
        (("--package-id", PACKAGE_ID, "--listen", "192.0.2.1:1", "--plaintext"), "cannot listen at 192.0.2.1:1"),
    ],
)
def test_what_cannot_be_served_is_said_in_one_line(options, said):
    done = CliRunner().invoke(chaincode, ["serve", *options])
    assert done.exit_code == 1, done.output
    assert said in done.output
    assert "Traceback" not in done.output
    assert len(done.output.strip().splitlines()) == 1


def test_a_certificate_that_expires_soon_is_warned_of(tools, tmp_path, caplog):
    from wonderland_chaincode.service import Tls

    for days, warned in ((13, True), (15, False)):
        caplog.clear()
        _, _, key, certificate = tools.key_and_certificate("service", days=days)
        (tmp_path / "key").write_bytes(key)
        (tmp_path / "certificate").write_bytes(certificate)
        assert not Tls(tmp_path / "certificate", tmp_path / "key", None).mutual
        assert ("expires on" in caplog.text) == warned
