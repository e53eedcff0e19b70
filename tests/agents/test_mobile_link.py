"""A drone proves itself over a mobile network: late and lossy, gone for seconds, its connections forgotten unsaid."""

from __future__ import annotations

import asyncio
import json
import sys
from asyncio.subprocess import PIPE

import pytest
from kit import environment
from kit.mobile_link import MobileLink

pytestmark = pytest.mark.timeout(180)


class Drone:
    """The drone's agent on the far side of the link."""

    def __init__(self, process):
        self._process = process

    async def answer(self, limit_s):
        async with asyncio.timeout(limit_s):
            line = await self._process.stdout.readline()
        assert line, (await self._process.stderr.read()).decode()
        return json.loads(line)

    def ask(self):
        self._process.stdin.write(b"prove pad-1\n")

    async def prove(self, limit_s=60):
        self.ask()
        return await self.answer(limit_s)


@pytest.fixture
async def link(world):
    port = int(world.connection.gateway.address.rpartition(":")[2])
    async with MobileLink(port) as made:
        yield made


@pytest.fixture
async def drone(world, link):
    claim = world.flight.claim(0)
    track = world.directory / "track.csv"
    track.write_text(
        "t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n"
        f"0,{claim.lat_e7},{claim.lon_e7},{claim.height_mm},500,500\n"
    )
    where = world.directory / "ledger" / "connection.json"
    document = json.loads(where.read_text())
    document["gateway"] |= {"address": link.address, "server_name": "localhost"}
    remote = where.with_name("by-mobile.json")
    remote.write_text(json.dumps(document))
    process = await asyncio.create_subprocess_exec(
        *link.prefix,
        *(sys.executable, "-m", "kit.drone_process", str(remote), str(world.directory / "tty-uav"), str(track)),
        env=environment(),
        stdin=PIPE,
        stdout=PIPE,
        stderr=PIPE,
    )
    try:
        made = Drone(process)
        assert await made.answer(60) == {"ready": True}
        yield made
    finally:
        process.kill()
        await process.communicate()


async def test_late_and_lossy_is_no_matter(world, link, drone):
    async with world.pad():
        result = await drone.prove()
    assert (result["state"], result["end"]) == ("completed", "done")
    assert link.carried > 50


async def test_connections_that_were_forgotten_are_missed_by_nobody(world, link, drone):
    async with world.pad():
        assert (await drone.prove())["end"] == "done"
        link.forget()
        result = await drone.prove(30)
    assert (result["state"], result["end"]) == ("completed", "done")


@pytest.mark.parametrize(("fault", "after_s"), [("away", 0.6), ("forgotten", 1.2)])
async def test_a_fault_in_the_middle_permits_nothing_that_is_not_committed_and_the_next_proof_is_well(
    world, link, drone, fault, after_s
):
    async with world.pad():
        drone.ask()
        await asyncio.sleep(after_s)
        if fault == "away":
            link.is_away = True
            await asyncio.sleep(7)
            link.is_away = False
        else:
            link.forget()
        result = await drone.answer(60)
        session = await world.contract("mirror").read_session(result["session_id"])
        assert (session.state, session.end) == (result["state"], "done" if result["acted"] else None)
        if result["acted"]:
            assert result["acted"] == [result["session_id"]]
            assert (result["state"], result["verdict"]["permission"]) == ("completed", "granted")
        else:
            assert result["verdict"]["outcome"] == "inconclusive", "the pad waited in vain for the drone's reply"
            assert (await drone.prove())["end"] == "done"
