"""The pad's agent as a process of its own: ready, small, stopped by a signal, out and back."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import sys

import psutil
import pytest
from kit.agents import ANCHORS

CONFIG = """
pad_id = "pad-1"
connection = "ledger/connection.json"
spool = "{spool}"
prekeys = 6
{anchors}
[remote_id]
listen = "127.0.0.1:0"
"""
MAX_PRIVATE_BYTES = 40 << 20
"""What a second agent on the same machine would cost; the code of gRPC, OpenSSL and Python (34 MB) is shared."""


@pytest.fixture
async def start_pad(world):
    path = world.directory / "pad.toml"
    anchors = "".join(
        f'[[anchors]]\nanchor_id = "{name}"\nport = "{world.directory / f"tty-{name}"}"\n'
        for name in ("A1", "A2", "A3", "A4")
    )
    started = []

    async def start(spool="spool"):
        path.write_text(CONFIG.format(anchors=anchors, spool=spool))
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-c",
            "from wonderland.cli import main; main()",
            "pad",
            "run",
            "--json",
            "--config",
            str(path),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "PYTHONWARNINGS": "error"},
        )
        started.append(process)
        async with asyncio.timeout(20):
            line = await process.stdout.readline()
        assert line, (await process.stderr.read()).decode()
        assert json.loads(line) == {"ready": True, "pad_id": "pad-1"}
        return process

    yield start
    for process in started:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def test_ready_small_and_stopped_by_a_signal(world, start_pad):
    process = await start_pad()
    async with world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"
    memory = psutil.Process(process.pid).memory_info()
    assert memory.rss - memory.shared <= MAX_PRIVATE_BYTES
    process.send_signal(signal.SIGTERM)
    async with asyncio.timeout(10):
        _, errors = await process.communicate()
    assert process.returncode == 0, errors.decode()
    assert b"Traceback" not in errors, errors.decode()


async def test_out_in_mid_session_and_back_the_end_is_on_the_ledger(world, start_pad, outage):
    spool = outage.directory / "spool"
    process = await start_pad(spool)
    async with world.uav() as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        async with asyncio.timeout(10):
            while uav._runner is None or "reply" not in uav._runner._machine.steps:
                await asyncio.sleep(0.01)
        outage.strike(process.pid)
        await process.wait()
        outage.back()
        await start_pad(spool)
        result = await working
    assert (result.state, result.end) == ("cancelled", "agent_restart")
    assert not world.acted


async def test_killed_while_somebody_waits_the_pad_is_not_given_twice_and_who_waited_is_served(world, start_pad):
    await world.second_uav()
    await world.policy(occupied_ms=600_000)
    process = await start_pad()
    async with world.uav() as first, world.uav(name="uav-2") as second:
        landed = await first.prove("pad-1", "land")
        waiting = asyncio.create_task(second.prove("pad-1", "land"))
        events = world.contract("mirror").events(start_block=0, names=frozenset({"ProofRequested"}))
        async with asyncio.timeout(10):
            while (await anext(events)).record["uav_id"] != "uav-2":
                pass
        await asyncio.sleep(1)
        process.kill()
        await process.wait()
        await start_pad()
        await asyncio.sleep(2)
        assert not waiting.done(), "the first one stands there still"
        await world.call("pad_operator", "RecordDeparture", session_id=landed.session_id)
        async with asyncio.timeout(20):
            result = await waiting
    assert (result.state, result.end) == ("completed", "done")
    assert [verdict.uav_id for verdict in world.acted] == ["uav-1", "uav-2"]


async def sessions(world, event="InteractionCompleted"):
    """As their events tell of them: those that ended with what was permitted, or otherwise."""
    contract, found = world.contract("mirror"), []
    events = contract.events(start_block=0, names=frozenset({event}))
    with contextlib.suppress(TimeoutError):
        while True:
            async with asyncio.timeout(0.5):
                found.append((await anext(events)).record)
    return found


@pytest.fixture
def track(world):
    """Where the drone hovers, as a file of positions."""
    claim = world.flight.claim(0)
    path = world.directory / "track.csv"
    path.write_text(
        "t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n"
        f"0,{claim.lat_e7},{claim.lon_e7},{claim.height_mm},500,500\n"
    )
    return path


async def test_the_drones_command_interrupted_is_no_refusal_and_no_fault_of_the_pad(world, start_pad, track):
    await start_pad()
    world.mute = set(ANCHORS)  # so that the session lasts
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", "from wonderland.cli import main; main()", "uav", "prove"),
        *("--connection", str(world.directory / "ledger"), "--identity", "uav"),
        *("--port", str(world.directory / "tty-uav"), "--position", f"track:{track}", "--pad", "pad-1"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(40):
        while "request" not in (line := (await process.stderr.readline()).decode()):
            assert line, "it has ended"
        process.send_signal(signal.SIGINT)
        output, _ = await process.communicate()
    assert process.returncode == 1, output.decode()
    assert "the drone’s agent was stopped" in output.decode()
    (session,) = await sessions(world, "ProofCancelled")
    assert (session["state"], session["end"], session["ended_by"]) == ("cancelled", "drone_stopped", "uav")


async def test_the_drones_command_proves_and_says_how(world, start_pad, track):
    await start_pad()

    async def prove(*more, command="prove"):
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", "from wonderland.cli import main; main()", "uav", command),
            *("--connection", str(world.directory / "ledger"), "--identity", "uav"),
            *("--port", str(world.directory / "tty-uav"), "--position", f"track:{track}", "--pad", "pad-1"),
            *more,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        async with asyncio.timeout(30):
            output, errors = await process.communicate()
        return process.returncode, output.decode(), errors.decode()

    code, output, errors = await prove("--json", "--then", "true")
    assert code == 0, errors
    document = json.loads(output)
    assert (document["outcome"], document["permission"], document["end"]) == ("verified", "granted", "done")
    assert document["steps"][0]["step"] == "request"
    assert len(document["verdict_tx"]) == 64

    code, output, errors = await prove("--then", "false")
    assert code == 2
    assert "Verified with assurance 2, permission granted" in output
    assert "✓ match" in errors

    code, output, errors = await prove("--sessions", "1", command="calibrate")
    assert code == 0, errors
    session_id = re.search(r"session ([0-9a-f]{12})…", output).group(1)
    (session,) = [each for each in await sessions(world) if each["session_id"].startswith(session_id)]
    assert (session["end"], session["ended_by"]) == ("aborted", "uav")
    assert session["note"] == "ranged for a calibration: nothing was flown"
    code, _, errors = await prove("--then", "true", command="calibrate")
    assert code == 2
    assert "nothing is done that a calibration's sessions permit" in errors

    world.flight.truth = (20_000.0, 3_000.0, 6_000.0)
    code, output, _ = await prove()
    assert code == 2
    assert "Refuted with assurance" in output

    code, _, errors = await prove("--action", "land", "--pad", "pad-9")
    assert code == 1
    assert "PAD_UNKNOWN" in errors
