"""A real ArduPilot above a real pad and ledger; the ranges are to where its simulation has it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from pathlib import Path

import pytest

from kit.agents import ANCHORS, FRAME, Flight, World, open_ledger
from kit.ground_station import dialect
from kit.sitl import COMPANION_PORT, ArduCopter, Home, drag_gps, own_network
from wonderland.clock import SteadyClock
from wonderland.proofs.frame import to_local
from wonderland_uav_agent.flight import FlightSettings, Gate, Pilot
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.willing import Willing

LONG_S = 150.0
SAMPLE_S = 0.2
DRAG_M_S = 1.0


class SimulatedTruth(Flight):
    """The ranges are to where the simulation has the vehicle."""

    def __init__(self, geoid_mm):
        self._geoid_mm, self._truth = geoid_mm, (0.0, 0.0, 0.0)
        super().__init__()

    @property
    def truth(self):
        return self._truth

    @truth.setter
    def truth(self, _):
        """As the dataclass sets it."""

    def hear(self, message):
        if message.get_type() == "SIM_STATE":
            height_mm = round(1e3 * message.alt) + self._geoid_mm
            self._truth = tuple(map(float, to_local(FRAME, message.lat_int, message.lon_int, height_mm)))


class Scene:
    """Everything but the ledger is in the autopilot's network."""

    def __init__(self, world, station, link, pilot, clock, directory):
        self.world, self.station, self.link, self.pilot, self.clock = world, station, link, pilot, clock
        self.directory = directory
        self.samples, self.marks = [], {}

    @property
    def seen(self):
        return self.pilot.vehicle(self.clock())

    def local_m(self):
        claim = self.seen.claim
        return [mm / 1e3 for mm in to_local(FRAME, claim.lat_e7, claim.lon_e7, claim.height_mm)]

    def off_m(self):
        claimed, truth = self.local_m(), self.world.flight.truth
        return ((claimed[0] - truth[0] / 1e3) ** 2 + (claimed[1] - truth[1] / 1e3) ** 2) ** 0.5

    def aside_m(self):
        """From the pad's middle, as the simulation has it."""
        east_mm, north_mm, _ = self.world.flight.truth
        return (east_mm**2 + north_mm**2) ** 0.5 / 1e3

    def mark(self, name):
        self.marks.setdefault(name, self.clock())

    async def sample(self):
        while True:
            latest = self.station.latest
            if self.seen and "EKF_STATUS_REPORT" in latest and "GPS_RAW_INT" in latest:
                ekf, gps = latest["EKF_STATUS_REPORT"], latest["GPS_RAW_INT"]
                self.samples.append(
                    {
                        "t_ms": self.clock(),
                        "off_m": round(self.off_m(), 3),
                        "aside_m": round(self.aside_m(), 3),
                        "height_m": round(self.world.flight.truth[2] / 1e3, 2),
                        "ekf_flags": ekf.flags,
                        "fix_type": gps.fix_type,
                        "h_acc_mm": gps.h_acc,
                        "phase": self.pilot.gatekeeper.phase.value,
                    }
                )
            await asyncio.sleep(SAMPLE_S)

    async def until(self, condition, what):
        try:
            async with asyncio.timeout(LONG_S):
                while not (self.seen and condition()):
                    await asyncio.sleep(0.05)
        except TimeoutError:
            pytest.fail(f"{what}: {self.seen}, {self.pilot.gatekeeper.phase}, {self.link.why_not(self.clock())}")

    async def take_off(self, height_m):
        """Guided, armed as soon as it can be, and up."""
        await self.station.done(dialect.MAV_CMD_DO_SET_MODE, 1, 4)
        async with asyncio.timeout(LONG_S):
            while await self.station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED:
                await asyncio.sleep(0.5)
        await self.station.done(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)
        await self.until(lambda: self.local_m()[2] > height_m - 1, "it takes off")

    async def drag(self):
        """The simulated receiver is led north, until cancelled."""
        self.mark("drag")
        await drag_gps(self.station, DRAG_M_S, LONG_S)

    def keep(self, name):
        """For the figure in the documentation (WONDERLAND_FLIGHTS=DIR)."""
        folder = os.environ.get("WONDERLAND_FLIGHTS")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            record = {"marks": self.marks, "samples": self.samples, "drag_m_s": DRAG_M_S}
            Path(folder, f"{name}.json").write_text(json.dumps(record, indent=1) + "\n")


@contextlib.asynccontextmanager
async def above_a_pad(directory, geoid, *, precision=True, parameters=None, height_m=12, attempts=1):
    """It hovers above a pad (0: it stands there); the embedded ledger and the pad's agent are at work."""
    ledger_folder, clock = directory / "pad", SteadyClock()
    ledger_folder.mkdir()
    geoid_mm = round(geoid.undulation_mm(FRAME.lat_e7, FRAME.lon_e7))
    home = Home(FRAME.lat_e7 / 1e7, FRAME.lon_e7 / 1e7, (FRAME.height_mm - geoid_mm) / 1e3)
    pilot = Pilot(FlightSettings(gate_m=6.0, attempts=attempts, precision=precision), clock=clock)
    link = MavlinkPosition(UdpAddress("127.0.0.1", COMPANION_PORT), clock, geoid)
    pilot.board(link)
    pilot.gatekeeper.know([Gate("pad-1", FRAME)])
    async with contextlib.AsyncExitStack() as stack:
        with own_network():  # sockets stay in the network in which they were made
            vehicle = ArduCopter(directory, home, parameters)
            stack.enter_context(vehicle)
            station = await stack.enter_async_context(vehicle.ground_station())
            await stack.enter_async_context(link)
        ledger = open_ledger(ledger_folder)
        await ledger.start()
        stack.push_async_callback(ledger.stop)
        channel = await stack.enter_async_context(ledger.connection.open_channel())
        world = World(ledger_folder, ledger, channel)
        await world.set_up()
        for name in (*ANCHORS, "uav"):
            world.add_node(name)
        stack.callback(world.close)
        world.flight = SimulatedTruth(geoid_mm)
        station.heard.append(world.flight.hear)
        await station.next("HEARTBEAT")
        for number in (dialect.MAVLINK_MSG_ID_SIM_STATE, dialect.MAVLINK_MSG_ID_GPS_RAW_INT):
            await station.every(number, 50)
        await station.every(dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 200)
        await stack.enter_async_context(world.pad())
        agent = await stack.enter_async_context(world.uav(act=pilot.act, position=link, on_range=pilot.on_range))
        willing = Willing(agent, frozenset({"pad-1"}))
        stack.push_async_callback(willing.stop)
        pilot.prove_with(willing.begin)
        made = Scene(world, station, link, pilot, clock, directory)
        sampling = asyncio.create_task(made.sample())
        stack.callback(sampling.cancel)
        await made.until(lambda: True, "mode, place and state are known")
        if height_m:
            await made.take_off(height_m)
        yield made
