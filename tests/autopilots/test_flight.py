"""Real autopilots that are held above a pad, and land and arm by permission; a test says what the ledger said."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.resources
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from kit.agents import commissioning
from kit.ground_station import dialect
from kit.sitl import COMPANION_PORT, HOME, ArduCopter, Px4, own_network

from wonderland.clock import SteadyClock
from wonderland.proofs.frame import to_local
from wonderland_edge_agent.geodesy import frame_at
from wonderland_uav_agent.flight import FlightSettings, Gate, Pilot
from wonderland_uav_agent.flight.approach import Phase
from wonderland_uav_agent.flight.vehicle import Mode
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.session.events import OwnRange

pytestmark = pytest.mark.timeout(300)

LONG_S = 120.0
PAD = "pad-1"
ON_THE_GROUND = dialect.MAV_LANDED_STATE_ON_GROUND


@pytest.fixture(params=[ArduCopter, Px4], ids=lambda kind: kind.name)
def vehicle(request, tmp_path):
    """A vehicle of its own for each test; ArduPilot with our script."""
    parameters = getattr(request.function, "parameters", {}).get(request.param.name, {})
    with own_network(), request.param(tmp_path, parameters=parameters) as vehicle:
        yield vehicle


class Above:
    """A pilot beside a real autopilot whose launch is the pad; proofs begin, and end when a test says so."""

    def __init__(self, pilot, link, clock):
        self.pilot, self.link, self.clock = pilot, link, clock
        self.begun, self.ends = [], []
        pilot.prove_with(self.begin)

    def begin(self, pad_id, action, ended):
        self.begun.append((pad_id, action))
        self.ends.append(ended)
        return ""

    @property
    def seen(self):
        return self.pilot.vehicle(self.clock())

    def height_m(self):
        return (self.seen.claim.height_mm - self.ground_mm) / 1e3

    async def until(self, condition, what):
        try:
            async with asyncio.timeout(LONG_S):
                while not (self.seen and condition()):
                    await asyncio.sleep(0.05)
        except TimeoutError:
            pytest.fail(f"{what}: {self.seen}, {self.pilot.gatekeeper.phase}, {self.link.why_not(self.clock())}")


@contextlib.asynccontextmanager
async def above(geoid, settings=None):
    clock = SteadyClock()
    pilot = Pilot(settings or FlightSettings(gate_m=6.0, attempts=1), clock=clock)
    link = MavlinkPosition(UdpAddress("127.0.0.1", COMPANION_PORT), clock, geoid)
    pilot.board(link)
    async with link:
        here = Above(pilot, link, clock)
        await here.until(lambda: True, "mode, place and state are known")
        claim = here.seen.claim
        here.ground_mm = claim.height_mm
        pilot.gatekeeper.know([Gate(PAD, frame_at(claim.lat_e7, claim.lon_e7, claim.height_mm))])
        yield here


async def arms(station, vehicle):
    """Until the autopilot lets it be armed; it has its own reasons at first."""
    async with asyncio.timeout(LONG_S):
        while await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED:
            await asyncio.sleep(0.5)


async def takes_off(station, vehicle, here, height_m):
    if vehicle.name == "arducopter":
        await station.done(dialect.MAV_CMD_DO_SET_MODE, 1, 4)
        await arms(station, vehicle)
        await station.done(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)
    else:
        await station.set("MIS_TAKEOFF_ALT", height_m)
        nan = float("nan")
        await station.done(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, HOME.alt_m + height_m)
        await arms(station, vehicle)
    await here.until(lambda: here.height_m() > height_m - 1, "it takes off")


def permission(action="land"):
    return SimpleNamespace(action=action, pad_id=PAD, session_id="s")


async def lands(station, vehicle):
    """As a pilot orders it."""
    await station.done(dialect.MAV_CMD_NAV_LAND)


async def test_a_landing_is_held_until_a_verdict_permits_it(vehicle, geoid):
    async with vehicle.ground_station() as station, above(geoid) as here:
        await takes_off(station, vehicle, here, 10)
        assert here.begun == []
        await lands(station, vehicle)
        await here.until(lambda: here.begun, "held, a proof begins")
        assert here.begun == [(PAD, "land")]
        await asyncio.sleep(5)
        assert here.seen.mode is Mode.HELD
        assert 4 < here.height_m() < 8
        assert await here.pilot.act(permission()) == "done"
        assert here.seen.on_ground
        assert here.pilot.gatekeeper.phase is Phase.WATCHING


OFF_M = 2.0
PRECISION = {"arducopter": {"PLND_ENABLED": 1, "PLND_TYPE": 1}}


async def ranges(here, pad):
    """As the node would measure them, were the drone `OFF_M` further east than its GPS says; until cancelled."""
    while True:
        if here.seen:
            claim = here.seen.claim
            east, north, up = to_local(pad.frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
            for anchor in pad.anchors:
                place = (anchor.east_mm, anchor.north_mm, anchor.up_mm)
                range_mm = round(math.dist((east + 1e3 * OFF_M, north, up), place))
                here.pilot.on_range(pad, OwnRange(anchor.mac, here.clock(), range_mm))
        await asyncio.sleep(0.05)


async def test_it_lands_where_the_ranges_see_the_pad(vehicle, geoid):
    async with vehicle.ground_station() as station, above(geoid) as here:
        await takes_off(station, vehicle, here, 10)
        frame = here.pilot.gatekeeper.gates[0].frame
        pad = replace(commissioning(here.clock()), frame=frame)
        measuring = asyncio.create_task(ranges(here, pad))
        await lands(station, vehicle)
        await here.until(lambda: here.begun, "held, a proof begins")
        assert await here.pilot.act(permission()) == "done"
        measuring.cancel()
        claim = here.seen.claim
        east_mm, north_mm, _ = to_local(frame, claim.lat_e7, claim.lon_e7, claim.height_mm)
        print(f"{vehicle.name}: {math.hypot(east_mm / 1e3 + OFF_M, north_mm / 1e3):.2f} m from the pad's middle")
        assert math.hypot(east_mm / 1e3 + OFF_M, north_mm / 1e3) < 0.5


test_it_lands_where_the_ranges_see_the_pad.parameters = PRECISION


async def test_ranges_that_end_on_the_way_down_leave_it_to_the_autopilot(vehicle, geoid):
    async with vehicle.ground_station() as station, above(geoid) as here:
        await takes_off(station, vehicle, here, 10)
        pad = replace(commissioning(here.clock()), frame=here.pilot.gatekeeper.gates[0].frame)
        measuring = asyncio.create_task(ranges(here, pad))
        await lands(station, vehicle)
        await here.until(lambda: here.begun, "held, a proof begins")
        landing = asyncio.create_task(here.pilot.act(permission()))
        await here.until(lambda: here.height_m() < 4, "it sinks")
        measuring.cancel()
        began_s = asyncio.get_running_loop().time()
        async with asyncio.timeout(100):
            assert await landing == "done"
        print(f"{vehicle.name}: down {asyncio.get_running_loop().time() - began_s:.0f} s after the last range")
        assert here.seen.on_ground


test_ranges_that_end_on_the_way_down_leave_it_to_the_autopilot.parameters = PRECISION


async def test_refused_it_stays_and_the_pilot_can_take_it(vehicle, geoid, caplog):
    async with vehicle.ground_station() as station, above(geoid) as here:
        await takes_off(station, vehicle, here, 10)
        await lands(station, vehicle)
        await here.until(lambda: here.begun, "held, a proof begins")
        here.ends[0]("refuted: the ranges contradict the claim")
        await asyncio.sleep(5)
        assert here.pilot.gatekeeper.phase is Phase.REFUSED
        assert (here.seen.mode, here.seen.on_ground) == (Mode.HELD, False)
        await lands(station, vehicle)
        await here.until(lambda: here.pilot.gatekeeper.phase is Phase.OVERRIDDEN, "the pilot insists")
        await here.until(lambda: here.seen.on_ground, "and lands")
        await here.until(lambda: "without a permission" in caplog.text, "which is said")


async def test_returning_to_launch_is_held_above_the_pad_there(vehicle, geoid):
    async with vehicle.ground_station() as station, above(geoid) as here:
        await takes_off(station, vehicle, here, 10)
        await station.done(dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        await here.until(lambda: here.begun, "held, a proof begins")
        assert await here.pilot.act(permission()) == "done"
        assert here.seen.on_ground


async def test_taking_off_needs_a_permission(vehicle, geoid):
    if vehicle.name == "arducopter":
        scripts = vehicle.directory / "scripts"
        if not scripts.exists():
            vehicle.stop()
            scripts.mkdir()
            source = importlib.resources.files("wonderland_uav_agent.flight") / "wonderland_arming.lua"
            (scripts / "wonderland_arming.lua").write_text(source.read_text())
            vehicle.start()
    async with vehicle.ground_station() as station, above(geoid) as here:
        if vehicle.name == "px4":
            await station.set("COM_ARM_AUTH_REQ", 1, kind=dialect.MAV_PARAM_TYPE_INT32)
        else:
            await station.done(dialect.MAV_CMD_DO_SET_MODE, 1, 4)
            await ready(station)
        for _ in range(3):
            assert await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED
        if vehicle.name == "px4":
            assert (PAD, "takeoff") in here.begun
        else:
            assert any("no permission of the ledger" in text for text in station.texts), station.texts
        leaving = asyncio.create_task(here.pilot.act(permission("takeoff")))
        await takes_off(station, vehicle, here, 10)
        assert await leaving == "done"


async def ready(station):
    """Until nothing but the permission keeps ArduPilot from arming."""
    async with asyncio.timeout(LONG_S):
        while True:
            station.texts.clear()
            await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            await asyncio.sleep(0.5)
            reasons = [text for text in station.texts if text.startswith("Arm")]
            if reasons and all("no permission of the ledger" in text for text in reasons):
                return
