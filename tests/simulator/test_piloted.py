"""A vehicle with an autopilot of its own, by a stand-in that speaks MAVLink: what a real one says, and what none should.

The real one flies in tests/autopilots/test_practised_flight.py.
"""

from __future__ import annotations

import asyncio
import math
import socket
import stat
import sys

import pytest
from pymavlink.dialects.v20 import common

from wonderland_simulator.practice.piloted import Piloted
from wonderland_simulator.practice.reading import read_scenario

LAT_E7, LON_E7 = 604_518_000, 222_666_000
SCENARIO = """
pads:
  - pad_id: quay
    origin: {{lat: 60.4518, lon: 22.2666, height_m: 30.0}}
    survey: survey.csv
vehicles:
  - uav_id: D-1
    pad: quay
    path: [{{east_m: 30, north_m: 0, up_m: 0}}]
    autopilot: {{program: {program}}}
"""
STAYS = f"#!{sys.executable}\nimport time\ntime.sleep(60)\n"


class Autopilot:
    """Where the program would be: it sends to the world's own link."""

    def __init__(self, piloted):
        self._to = piloted._link._transport.get_extra_info("sockname")[:2]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._mavlink = common.MAVLink(None, srcSystem=1, srcComponent=1)

    async def says(self, *messages):
        for message in messages:
            self._socket.sendto(message.pack(self._mavlink), self._to)
        await asyncio.sleep(0.05)

    async def sends(self, data):
        self._socket.sendto(data, self._to)
        await asyncio.sleep(0.05)

    def close(self):
        self._socket.close()


def state(lat_e7=LAT_E7, lon_e7=LON_E7, alt_m=40.0):
    return common.MAVLink_sim_state_message(
        *(0.0,) * 10, 0.0, 0.0, 0.0, lat_e7 / 1e7, lon_e7 / 1e7, alt_m, *(0.0,) * 2, 1.0, 2.0, -3.0, lat_e7, lon_e7
    )


def position(lat_e7=LAT_E7, lon_e7=LON_E7):
    return common.MAVLink_global_position_int_message(0, lat_e7, lon_e7, 40_000, 10_000, 100, 200, -300, 0)


def receiver(fix=3):
    return common.MAVLink_gps_raw_int_message(0, fix, LAT_E7, LON_E7, 40_000, 0, 0, 0, 0, 9, 0, 300, 500)


def heartbeat(armed):
    return common.MAVLink_heartbeat_message(2, 3, 128 if armed else 0, 0, 4, 3)


@pytest.fixture
async def piloted(tmp_path):
    """`begun(program text)`: a vehicle whose program that is, and the stand-in beside it."""
    (tmp_path / "survey.csv").write_text("anchor,x,y,z\nA1,2,2,0.2\nA2,-2,2,1.2\nA3,-2,-2,0.2\n")
    program = tmp_path / "copter"
    vehicles = []

    async def begun(text=STAYS):
        program.write_text(text)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        (tmp_path / "scenario.yaml").write_text(SCENARIO.format(program=program))
        scenario = read_scenario(tmp_path / "scenario.yaml")
        made = Piloted(scenario.vehicles[0], scenario.pads[0].site.frame, 0)
        await made.__aenter__()
        vehicles.append((made, Autopilot(made)))
        return vehicles[-1]

    yield begun
    for vehicle, autopilot in vehicles:
        autopilot.close()
        await vehicle.__aexit__(None, None, None)
        assert vehicle._process is None


async def test_it_is_where_the_simulation_has_it_and_claims_what_its_filter_says(piloted):
    vehicle, autopilot = await piloted()
    assert vehicle.flight.position == (30.0, 0.0, 0.0)
    assert vehicle.fix(0, 0) is None, "it has said nothing yet"
    east_e7 = round(6 / (111_320 * math.cos(math.radians(60.4518))) * 1e7)
    await autopilot.says(
        heartbeat(armed=False), state(), position(lon_e7=LON_E7 + east_e7), receiver(), heartbeat(armed=True)
    )
    assert vehicle.flight.position == pytest.approx((0, 0, 10), abs=0.01)
    assert vehicle.flight.velocity == (2.0, 1.0, 3.0)
    fix = vehicle.fix(0, 1_000)
    assert vehicle.claimed_m == pytest.approx((6, 0, 10), abs=0.05)
    assert (fix.accuracy_mm, fix.t_ms, fix.airborne) == (734, 1_000, True)
    assert vehicle.step(0, 0.05) == "has its autopilot: it can be armed in a minute; is armed"


async def test_a_filter_without_a_place_and_states_of_nowhere_stop_nothing(piloted):
    vehicle, autopilot = await piloted()
    await autopilot.says(state(), receiver(), position(0, 0))
    assert vehicle.fix(0, 0) is None
    await autopilot.says(state(0, 0), state(alt_m=math.nan), state(alt_m=math.inf))
    assert vehicle.flight.position == pytest.approx((0, 0, 10), abs=0.01)
    await autopilot.says(receiver(fix=1), position())
    assert vehicle.fix(0, 0) is None, "without a fix a Remote ID module says no place"
    await autopilot.sends(b"\xfd" * 300)
    await autopilot.says(*(state(alt_m=41.0) for _ in range(10)))  # half a message swallows what follows it
    assert vehicle.flight.position[2] == pytest.approx(11, abs=0.01)


async def test_a_bystander_on_this_machine_does_not_move_it(piloted):
    vehicle, autopilot = await piloted()
    await autopilot.says(state())
    bystander = Autopilot(vehicle)
    await bystander.says(state(alt_m=500.0), heartbeat(armed=True))
    bystander.close()
    assert vehicle.flight.position == pytest.approx((0, 0, 10), abs=0.01)
    assert vehicle.doing == "no word from its autopilot"


async def test_a_program_that_ends_is_said_once_and_named(piloted):
    vehicle, _ = await piloted(f"#!{sys.executable}\nimport sys\nsys.exit(7)\n")
    async with asyncio.timeout(10):
        while not (said := vehicle.step(0, 0.05)):
            await asyncio.sleep(0.02)
    assert said.startswith("has lost its autopilot (code 7)")
    assert said.endswith("autopilot.log")
    assert vehicle.step(0, 0.05) == ""
