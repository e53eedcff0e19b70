"""Claims from a real PX4's own topics, by its Zenoh module, beside what the same PX4 says by MAVLink."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from pathlib import Path

import pytest
from kit import environment
from kit.geoids import write_geoid
from kit.ros2 import router
from kit.sitl import PX4, Px4, metres_between, own_network

from wonderland_uav_agent.position.receiver import GRID_95_MM, vertical_95_mm

pytestmark = pytest.mark.timeout(240)
LOCK_S = 120.0
UTC_OFF_MS = 1_000
ROUTER_PORT = 7_447
"""Where PX4's module looks for one."""


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory):
    build = os.environ.get(PX4)
    if not build or not Path(build, "bin", "px4-zenoh").exists():
        pytest.skip(f"{PX4} names no build of PX4 with its Zenoh module (px4_sitl_zenoh)")
    with own_network(), Px4(tmp_path_factory.mktemp("px4"), parameters={"ZENOH_ENABLE": 1}) as vehicle:
        yield vehicle


class Listener:
    """The agent's side."""

    def __init__(self, process):
        self._process = process

    async def until(self, fits, what):
        try:
            async with asyncio.timeout(LOCK_S):
                while True:
                    line = await self._process.stdout.readline()
                    assert line, "the listener has ended"
                    said = json.loads(line)
                    if fits(said):
                        return said
        except TimeoutError:
            pytest.fail(f"{what}; {said['why']}")


@contextlib.asynccontextmanager
async def listener(*arguments):
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "kit.px4_listener",
        *map(str, arguments),
        stdout=asyncio.subprocess.PIPE,
        env=environment(),
    )
    try:
        yield Listener(process)
    finally:
        process.kill()
        await process.wait()


async def test_a_claim_is_where_the_simulation_has_the_vehicle(vehicle, tmp_path, geoid):
    grid = write_geoid(tmp_path / "WW15MGH.DAC")
    async with router(ROUTER_PORT), listener(grid) as computer, vehicle.ground_station() as station:
        said = await computer.until(lambda each: each["claim"], "no position")
        claim = said["claim"]
        lat, lon, alt_m = await vehicle.true_place(station)
        raised_m = geoid.undulation_mm(claim["lat_e7"], claim["lon_e7"]) / 1e3
        off = metres_between(
            (lat, lon, alt_m + raised_m), (claim["lat_e7"] / 1e7, claim["lon_e7"] / 1e7, claim["height_mm"] / 1e3)
        )
        assert max(map(abs, off)) < 0.5, off
        said = await computer.until(
            lambda each: each["claim"] and abs(each["claim"]["t_ms"] - each["t_ms"]) < UTC_OFF_MS, "no time"
        )
        gps = await station.next("GPS_RAW_INT")
        assert said["claim"]["height_accuracy_mm"] >= vertical_95_mm(gps.v_acc) + GRID_95_MM
        print(said, "beside GPS_RAW_INT", gps.h_acc, gps.v_acc)


async def test_without_a_geoids_grid_it_says_that_the_simulated_receiver_has_none(vehicle):
    async with router(ROUTER_PORT), listener() as computer:
        await computer.until(lambda each: "no height above the ellipsoid" in each["why"], "it is not said")


async def test_a_restart_in_the_middle(vehicle, tmp_path):
    grid = write_geoid(tmp_path / "WW15MGH.DAC")
    async with router(ROUTER_PORT), listener(grid) as computer, vehicle.ground_station() as station:
        await computer.until(lambda each: each["claim"], "no position")
        await vehicle.restart(station)
        await computer.until(lambda each: not each["claim"], "it goes on")
        await computer.until(lambda each: each["claim"], "it does not come back")
