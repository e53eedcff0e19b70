"""`world run --scenario` with a real ArduPilot, as a fleet operator practises; MAVSDK flies it, our agents hold it."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import math
import os
import signal
import sys
from pathlib import Path

import pytest
from kit.sitl import ARDUCOPTER, own_network

from wonderland.proof_contract import ProofContract
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import Gateway

pytestmark = pytest.mark.timeout(400)
MAVSDK = "MAVSDK_PYTHON"
PILOT = Path(__file__).with_name("mavsdk_pilot.py")
LAT, LON, HEIGHT_M = 60.4518, 22.2666, 30.0
SCENARIO = """
pads:
  - pad_id: pad-1
    origin: {{lat: {lat}, lon: {lon}, height_m: {height_m}}}
    survey: survey.csv
vehicles:
  - uav_id: PRACTICE-0003
    pad: pad-1
    path: [{{east_m: 30, north_m: 0, up_m: 0}}]
    autopilot: {{program: {program}}}
    track: track.csv
    lies: {lies}
"""


async def start(*command):
    return await asyncio.create_subprocess_exec(
        *map(str, command), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )


async def said(process, text, timeout_s=60):
    """Until a process has printed it; all that came until then."""
    lines = []
    try:
        async with asyncio.timeout(timeout_s):
            while line := (await process.stdout.readline()).decode():
                lines.append(line)
                if text in line:
                    return lines
    except TimeoutError:
        pass
    pytest.fail(f"{text!r} was not said, but: {''.join(lines[-20:])}")


@contextlib.asynccontextmanager
async def running(*command, until):
    process = await start(*command)
    try:
        await said(process, until)
        yield process
    finally:
        if process.returncode is None:
            process.send_signal(signal.SIGINT)
        async with asyncio.timeout(20):
            process.rest = (await process.communicate())[0].decode()
    print(*command[1:3], process.rest, sep="\n")
    assert process.returncode == 0


@pytest.fixture
async def practice(tmp_path):
    """Begins a scenario; gives what the pilot says, line by line, and the ledger's connection."""
    program, python = os.environ.get(ARDUCOPTER), os.environ.get(MAVSDK)
    if not program:
        pytest.skip(f"{ARDUCOPTER} names no program: build ArduPilot's copter for the board sitl")
    if not python:
        pytest.skip(f"{MAVSDK} names no interpreter that has MAVSDK (pip install mavsdk-grpc)")
    wonderland = Path(sys.executable).with_name("wonderland")
    (tmp_path / "survey.csv").write_text(
        "anchor,x,y,z\nA1,2,2,0.2\nA2,-2,2,1.2\nA3,-2,-2,0.2\nA4,2,-2,0.2\nA5,0,2.6,1.2\n"
    )
    scenario, clients, agents = tmp_path / "scenario.yaml", tmp_path / "clients", tmp_path / "agents"
    connection = clients / "world" / "connection.json"
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(own_network())

        async def begun(lies="{}"):
            scenario.write_text(
                SCENARIO.format(lat=LAT, lon=LON, height_m=HEIGHT_M, program=Path(program).resolve(), lies=lies)
            )
            ledger = ("ledger", "start", "--data", tmp_path / "ledger", "--listen", "127.0.0.1:7051", "--json")
            await stack.enter_async_context(running(wonderland, *ledger, until="ready"))
            for steps in (
                ("enrol", "--scenario", scenario, "--ledger", tmp_path / "ledger", "--to", clients),
                ("register", "--scenario", scenario, "--connection", connection),
            ):
                done = await start(wonderland, "world", *steps)
                assert (await done.wait()) == 0, await done.stdout.read()
            flying = ("--scenario", scenario, "--write", agents, "--connection", connection)
            nobody = ("--backend", "http://127.0.0.1:9")
            await stack.enter_async_context(running(wonderland, "world", "run", *flying, *nobody, until="Ctrl-C"))
            pad = ("pad", "run", "--config", agents / "pad-1" / "pad.toml", "--json")
            await stack.enter_async_context(running(wonderland, *pad, until="ready"))
            serve = ("uav", "serve", "--config", agents / "PRACTICE-0003" / "uav.toml")
            await stack.enter_async_context(running(wonderland, *serve, until="ready"))
            pilot = await start(python, PILOT, 14_550, LAT, LON, HEIGHT_M)
            stack.callback(lambda: pilot.returncode is None and pilot.kill())
            return pilot, connection

        yield begun


async def decided(connection, name, timeout_s):
    """The first event of that name on the ledger."""
    known = Connection.load(connection)
    async with known.open_channel() as channel:
        gateway = Gateway(channel, known.identity("pad_operator"), known.signer("pad_operator"))
        contract = ProofContract(gateway.network(known.channel), known.chaincode)
        async with asyncio.timeout(timeout_s):
            return (await anext(contract.events(start_block=0, names=frozenset({name})))).record


def last_place_m(tmp_path):
    """East, north, up, where the simulation has it."""
    with (tmp_path / "track.csv").open() as file:
        *_, last = csv.DictReader(file)
    return [float(last[axis]) for axis in "xyz"]


async def test_it_waits_above_the_pad_proves_itself_and_lands_in_the_middle(practice, tmp_path):
    pilot, connection = await practice()
    await said(pilot, "ordered the landing", 180)
    verdict = await decided(connection, "ProofDecided", 60)
    assert (verdict["outcome"], verdict["permission"]) == ("verified", "granted"), verdict["reasons"]
    await said(pilot, "is down", 90)
    east_m, north_m, _ = last_place_m(tmp_path)
    print(f"{math.hypot(east_m, north_m):.2f} m from the middle")
    assert math.hypot(east_m, north_m) < 0.5
    assert (await decided(connection, "InteractionCompleted", 30))["end"] == "done"


async def test_one_whose_receiver_is_led_away_flies_beside_the_pad_and_is_not_let_down(practice, tmp_path):
    """Six metres from the start on: it is sure to be above the pad."""
    pilot, connection = await practice("{gnss_drag: {speed_m_s: 6, limit_m: 6, bearing_deg: 90}}")
    await said(pilot, "ordered the landing", 180)
    verdict = await decided(connection, "ProofDecided", 60)
    assert (verdict["outcome"], verdict["permission"]) == ("refuted", "refused"), verdict["reasons"]
    await asyncio.sleep(10)
    east_m, _, up_m = last_place_m(tmp_path)
    assert east_m == pytest.approx(-6, abs=1.5)
    assert up_m > 5, "it stays up"
