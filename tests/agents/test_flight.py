"""``wonderland uav serve`` flies by permission: an autopilot, a pad, a ledger, and a GPS that is dragged away."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys

import pytest
from click.testing import CliRunner
from kit.agents import FRAME, Flight
from kit.fake_autopilot import OverUdp
from kit.flying_autopilot import FlyingAutopilot

from wonderland_uav_agent.commands import uav

LONG_S = 60.0
UAV_TOML = """
connection = "ledger/connection.json"
port = "{node}"
position = "mavlink:udp:127.0.0.1:{port}"
pads = ["pad-1"]
backend = "ws://127.0.0.1:9/ingest"

[flight]
gate_m = 6
attempts = {attempts}
"""


class Beside(Flight):
    """The true place, from where the autopilot believes to be."""

    def __init__(self, drone, off):
        super().__init__()
        self.drone, self.off = drone, off

    @property
    def truth(self):
        return tuple(here + away for here, away in zip(self.drone.place, self.off, strict=True))

    @truth.setter
    def truth(self, _):
        """As the dataclass sets it."""


@contextlib.asynccontextmanager
async def serving(world, drone, attempts):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    path = world.directory / "uav.toml"
    path.write_text(UAV_TOML.format(port=port, attempts=attempts, node=world.directory / "tty-uav"))
    command = (sys.executable, "-m", "wonderland.cli", "uav", "serve", "--config", str(path))
    process = await asyncio.create_subprocess_exec(*command, stderr=asyncio.subprocess.PIPE)
    said = []

    async def listen():
        while line := await process.stderr.readline():
            said.append(line.decode())

    listening = asyncio.create_task(listen())
    try:
        async with OverUdp(drone, ("127.0.0.1", port)):
            yield said
            process.send_signal(signal.SIGTERM)
            assert await asyncio.wait_for(process.wait(), 10) == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        await listening


async def until(condition, said):
    try:
        async with asyncio.timeout(LONG_S):
            while not condition():
                await asyncio.sleep(0.05)
    except TimeoutError:
        pytest.fail("".join(said))


def words(said, text):
    return any(text in line for line in said)


async def test_it_is_held_proves_itself_and_lands_and_the_ledger_says_so(world):
    drone = FlyingAutopilot(frame=FRAME, place=[6_000.0, 0.0, 20_000.0])
    world.flight = Beside(drone, (0.0, 0.0, 0.0))
    async with world.pad(), serving(world, drone, 3) as said:
        await until(lambda: 245 in drone.rates and drone.heartbeats_heard, said)
        drone.mode = "land"
        await until(lambda: drone.on_ground, said)
        assert (drone.commands[0], drone.commands[-1], drone.mode) == (192, 21, "land")
        assert words(said, "the ledger permits the landing at pad-1: landing")
        events = world.contract("mirror").events(start_block=0, names=frozenset({"InteractionCompleted"}))
        async with asyncio.timeout(LONG_S):
            record = (await anext(events)).record
        assert (record["result"] if "result" in record else record["end"]) == "done"


async def test_a_dragged_gps_does_not_land(world):
    """The autopilot is content, and six metres from where it believes to be: the pad says no, and it stays up."""
    drone = FlyingAutopilot(frame=FRAME, place=[6_000.0, 0.0, 20_000.0])
    world.flight = Beside(drone, (6_000.0, 0.0, 0.0))
    async with world.pad(), serving(world, drone, 1) as said:
        await until(lambda: 245 in drone.rates and drone.heartbeats_heard, said)
        drone.mode = "land"
        await until(lambda: words(said, "no permission to land at pad-1"), said)
        assert words(said, "refuted")
        await asyncio.sleep(1.0)
        assert (drone.on_ground, drone.mode, 21 in drone.commands) == (False, "guided", False)


async def test_a_pilot_who_lands_without_permission_is_on_the_ledger(world):
    drone = FlyingAutopilot(frame=FRAME, place=[6_000.0, 0.0, 20_000.0])
    world.flight = Beside(drone, (0.0, 0.0, 0.0))
    async with serving(world, drone, 1) as said:  # no pad's agent: no proof comes about
        await until(lambda: 245 in drone.rates and drone.heartbeats_heard, said)
        drone.mode = "land"
        await until(lambda: words(said, "no permission to land at pad-1") and drone.commands.count(192) == 2, said)
        drone.mode = "land"
        await until(lambda: drone.on_ground, said)
        events = world.contract("mirror").events(start_block=0, names=frozenset({"LandingReported"}))
        async with asyncio.timeout(LONG_S):
            record = (await anext(events)).record
        assert (record["uav_id"], record["pad_id"], record["cause"]) == ("uav-1", "pad-1", "pilot")
        await until(lambda: words(said, "the landing at pad-1 without a permission is on the ledger"), said)


def test_the_settings_are_the_options_and_complaints_name_the_field(tmp_path):
    path = tmp_path / "uav.toml"
    for text, complaint in (
        ('connexion = "x"', "connexion is unknown"),
        ("[flight]\ngate_m = 0", "flight.gate_m is 0"),
        ('[flight]\nrefused = "alternate"', 'flight.alternate: give it together with refused = "alternate"'),
        ('[flight]\nrefused = "crash"', "flight.refused is 'crash', which is not known"),
        ("pads = []", "pads"),
        ("[[", "no TOML"),
    ):
        path.write_text(text)
        result = CliRunner().invoke(uav, ["serve", "--config", str(path)])
        assert result.exit_code == 2, text
        assert complaint in result.output, (complaint, result.output)
