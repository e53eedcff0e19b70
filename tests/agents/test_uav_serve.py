"""``wonderland uav serve`` as a process, while what it needs is not there yet."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import socket
import sys
import time

import pytest
from kit.agents import open_ledger

from wonderland.telemetry import PleaseProve
from wonderland_uav_agent.willing import Willing


class Proving:
    def __init__(self):
        self.asked = []
        self.ends = asyncio.Event()

    async def prove(self, pad_id, action):
        self.asked.append((pad_id, action))
        await self.ends.wait()

    def stop(self, reason="drone_stopped"):
        self.ends.set()


async def test_a_request_is_answered_with_what_is_missing_and_no_proof_begins():
    lacking = ["no position yet: none"]
    agent = Proving()
    willing = Willing(agent, frozenset({"pad-1"}), lambda: lacking[0])
    wish = PleaseProve(request_id="a" * 32, pad_id="pad-1", action="land", expires_ms=2_000_000_000_000)
    assert await willing.decide(wish) == lacking[0]
    lacking[0] = ""
    assert await willing.decide(wish) == ""
    assert await willing.decide(wish) == "another proof is under way"
    await asyncio.sleep(0)
    await willing.stop()
    assert agent.asked == [("pad-1", "land")]


async def said(process, words):
    async with asyncio.timeout(30):
        while words not in (line := (await process.stderr.readline()).decode()):
            assert line, f"it ended before it said {words!r}"
    return line


@contextlib.asynccontextmanager
async def serve(directory, position):
    """The process, beside a ledger that is not there at first and no node or backend; told to end, it does."""
    ledger = open_ledger(directory)
    await ledger.start()
    address = ledger.connection.gateway.address
    await ledger.stop()
    command = [sys.executable, "-m", "wonderland.cli", "uav", "serve", "--pad", "pad-1"]
    command += ["--connection", directory / "ledger" / "connection.json", "--port", directory / "tty-uav"]
    command += ["--position", position, "--backend", "ws://127.0.0.1:9/ingest"]
    process = await asyncio.create_subprocess_exec(*map(str, command), stderr=asyncio.subprocess.PIPE)
    ledger = open_ledger(directory, listen=address)
    try:
        yield process, ledger
        process.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(process.wait(), 5) == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        await ledger.stop()


@pytest.mark.parametrize(
    ("position", "why"),
    [
        ("udp:127.0.0.1:0", "no datagram with a position has come"),
        ("mavlink:udp:127.0.0.1:0", "no heartbeat of an autopilot"),
    ],
)
async def test_it_waits_for_no_position_and_says_why_there_is_none(tmp_path, position, why):
    async with serve(tmp_path, position) as (process, _):
        assert f"no position yet: {why}. See that" in await said(process, "no position yet")


async def test_it_stays_says_what_is_missing_and_ends_when_told(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    async with serve(tmp_path, f"udp:127.0.0.1:{port}") as (process, ledger):
        await said(process, "the ledger is away since")
        await ledger.start()
        await said(process, "the ledger is there now")
        fix = {"lat_e7": 1, "lon_e7": 1, "height_mm": 1, "accuracy_mm": 1, "height_accuracy_mm": 1}
        fix["t_ms"] = time.time_ns() // 1_000_000
        heard = asyncio.create_task(said(process, "the position is there now"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            while not heard.done():
                autopilot.sendto(json.dumps(fix).encode(), ("127.0.0.1", port))
                await asyncio.wait({heard}, timeout=0.2)
        await heard
        await ledger.stop()
        await said(process, "the ledger is away since")
