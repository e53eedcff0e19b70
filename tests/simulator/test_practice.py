"""`wonderland world run --scenario` as a beginner starts it: own ledger, real agents, each command a process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
from pathlib import Path

import pytest

from wonderland.proof_contract import ProofContract
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway

pytestmark = pytest.mark.timeout(240)
SURVEY = "anchor,x,y,z\nA1,2,2,0.2\nA2,-2,2,1.2\nA3,-2,-2,0.2\nA4,2,-2,0.2\n"
HONEST, LIAR = "PRACTICE-0001", "PRACTICE-0002"
SCENARIO = """
pads:
  - pad_id: quay
    origin: {{lat: 60.4518, lon: 22.2666, height_m: 30.0}}
    survey: four.csv
    remote_id: 127.0.0.1:{}
  - pad_id: roof
    origin: {{lat: 60.4530, lon: 22.2690, height_m: 28.0}}
    survey: five.csv
    remote_id: 127.0.0.1:{}
vehicles:
  - uav_id: PRACTICE-0001
    pad: quay
    position: 127.0.0.1:{}
    path: [{{east_m: 4, north_m: 3, up_m: 6, wait_s: 1}}, {{east_m: 5, north_m: 2, up_m: 6, speed_m_s: 1}}]
  - uav_id: PRACTICE-0002
    pad: roof
    position: 127.0.0.1:{}
    path: [{{east_m: -3, north_m: 4, up_m: 5}}]
    lies: {{gnss_drag: {{speed_m_s: 2, limit_m: 6}}}}
faults:
  - {{at_s: 0.5, node: roof/A5, what: unplug}}
"""


async def start(*arguments):
    return await asyncio.create_subprocess_exec(
        Path(sys.executable).with_name("wonderland"),
        *map(str, arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


async def run(*arguments):
    """(exit code, what it printed, what it complained about)."""
    process = await start(*arguments)
    async with asyncio.timeout(60):
        out, err = await process.communicate()
    return process.returncode, out.decode(), err.decode()


@contextlib.asynccontextmanager
async def running(*arguments, until=b"ready"):
    """A process that has said so, ended as by Ctrl-C."""
    process = await start(*arguments)
    try:
        async with asyncio.timeout(60):
            while until not in (line := await process.stdout.readline()):
                assert line, (await process.stderr.read()).decode()
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
        async with asyncio.timeout(20):
            process.rest, complaints = await process.communicate()
    assert process.returncode == 0, complaints.decode()
    assert b"Traceback" not in complaints, complaints.decode()


async def until_status(config, code, *words):
    """What `pad status` says, once it ends with that code and those words."""
    said = found = None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(40):
            while found != code or not all(word in said for word in words):
                found, said, _ = await run("pad", "status", "--config", config)
            return said
    pytest.fail(f"{found}: {said}")


async def commissioned(connection):
    """The hash of each pad's commissioning."""
    known = Connection.load(connection)
    async with known.open_channel() as channel:
        gateway = Gateway(channel, known.identity("quay"), known.signer("quay"))
        contract = ProofContract(gateway.network(known.channel), known.chaincode)
        return [(await contract.read_pad(pad_id)).commissioning_sha256 for pad_id in ("quay", "roof")]


@pytest.fixture
def scenario(tmp_path, unused_udp_port_factory):
    (tmp_path / "four.csv").write_text(SURVEY)
    (tmp_path / "five.csv").write_text(SURVEY + "A5,0,2.6,1.2\n")
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO.format(*(unused_udp_port_factory() for _ in range(4))))
    return path


async def test_an_honest_drone_a_dragged_one_and_an_unplugged_anchor_against_an_own_ledger(tmp_path, scenario):
    clients, agents = tmp_path / "clients", tmp_path / "agents"
    connection = clients / "world" / "connection.json"
    async with contextlib.AsyncExitStack() as stack:
        ledger = ("ledger", "start", "--data", tmp_path / "ledger", "--listen", "127.0.0.1:0", "--json")
        await stack.enter_async_context(running(*ledger))
        enrolled = await run("world", "enrol", "--scenario", scenario, "--ledger", tmp_path / "ledger", "--to", clients)
        assert enrolled[0] == 0, enrolled
        other = tmp_path / "other.yaml"
        other.write_text(scenario.read_text().replace(LIAR, "PRACTICE-0003"))
        more = await run("world", "enrol", "--scenario", other, "--ledger", tmp_path / "ledger", "--to", clients)
        assert more[0] == 0, more
        assert {HONEST, LIAR, "PRACTICE-0003"} <= set(Connection.load(connection).identities), "nobody's is taken away"
        registered = await run("world", "register", "--scenario", scenario, "--connection", connection)
        assert registered[0] == 0, registered
        before = await commissioned(connection)
        assert (await run("world", "register", "--scenario", scenario, "--connection", connection))[0] == 0
        assert await commissioned(connection) == before, "a commissioning stays"
        flying = ("world", "run", "--scenario", scenario, "--write", agents, "--connection", connection)
        world = await stack.enter_async_context(running(*flying, until=b"Ctrl-C"))
        for pad in ("quay", "roof"):
            config = agents / pad / "pad.toml"
            await stack.enter_async_context(running("pad", "run", "--config", config, "--json"))
        await until_status(agents / "quay" / "pad.toml", 0)
        crippled = await until_status(agents / "roof" / "pad.toml", 0, "A5")
        assert "A4 unplugged" not in crippled
        results = {}
        for uav_id, pad in ((HONEST, "quay"), (LIAR, "roof")):
            config = agents / uav_id / "uav.toml"
            code, out, err = await run("uav", "prove", "--config", config, "--pad", pad, "--json")
            assert out, err
            results[uav_id] = code, json.loads(out)
        ports = list((tmp_path / "ports").rglob("tty-*"))
        assert len(ports) == 4 + 4 + 2
    code, honest = results[HONEST]
    assert (code, honest["outcome"], honest["permission"]) == (0, "verified", "granted"), honest
    code, liar = results[LIAR]
    assert (liar["outcome"], liar["permission"]) == ("refuted", "refused"), liar
    assert code != 0
    assert 4_000 < liar["verdict"]["signed"]["error_mm"] < 7_500
    assert b"roof/A5 is unplugged" in world.rest
    assert b"PRACTICE-0001 sets out to waypoint 2 of 2" in world.rest
    assert not (tmp_path / "ports").exists()
