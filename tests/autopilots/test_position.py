"""Claims from a real ArduPilot and a real PX4: the place that the simulation has, their accuracies, their time."""

from __future__ import annotations

import asyncio
import time

import pytest
from kit.ground_station import dialect
from kit.sitl import metres_between

from wonderland_uav_agent.position.mavlink import TcpAddress
from wonderland_uav_agent.position.receiver import GRID_95_MM, horizontal_95_mm, vertical_95_mm

pytestmark = pytest.mark.timeout(240)

UTC_OFF_MS = 1_000
"""ArduPilot's simulated receiver counts whole seconds from its start, and steps of 200 ms."""


async def test_a_claim_is_where_the_simulation_has_the_vehicle(vehicle, companion, geoid):
    async with vehicle.ground_station() as station, companion() as computer:
        await computer.locked()
        lat, lon, alt_m = await vehicle.true_place(station)
        claim = computer.claim()
        raised_m = geoid.undulation_mm(claim.lat_e7, claim.lon_e7) / 1e3
        off = metres_between(
            (lat, lon, alt_m + raised_m), (claim.lat_e7 / 1e7, claim.lon_e7 / 1e7, claim.height_mm / 1e3)
        )
        assert max(map(abs, off)) < 0.5, off
        assert abs(claim.t_ms - time.time() * 1e3) < UTC_OFF_MS
        gps = await station.next("GPS_RAW_INT") if vehicle.name == "px4" else await asked(station, "GPS_RAW_INT")
        assert claim.accuracy_mm == horizontal_95_mm(gps.h_acc)
        assert claim.height_accuracy_mm == vertical_95_mm(gps.v_acc) + GRID_95_MM


async def asked(station, name):
    await station.every(getattr(dialect, f"MAVLINK_MSG_ID_{name}"), 200)
    return await station.next(name)


async def test_without_a_geoids_grid_it_says_that_the_simulated_receiver_has_none(vehicle, companion):
    async with companion() as computer:
        computer.source.navigator._geoid = None
        await computer.until(lambda: "no height" in computer.source.why_not(computer.clock()), "said")
        assert computer.claim() is None


async def test_it_comes_as_often_as_it_is_asked_for(vehicle, companion):
    async with companion() as computer:
        await computer.locked()
        computer.arrived.clear()
        began = computer.clock()
        await asyncio.sleep(5)
        took_s = (computer.clock() - began) / 1e3
        rates = {name: len(times) / took_s for name, times in computer.arrived.items()}
        print(vehicle.name, {name: round(rate, 1) for name, rate in rates.items()})
        assert rates["GlobalPosition"] > 8
        assert rates["GpsRaw"] > 3
        assert rates["SystemTime"] > 0.5
        assert computer.source.navigator.refused == 0


async def test_by_tcp_too(vehicle, companion):
    if vehicle.name != "arducopter":
        pytest.skip("PX4 has no TCP")
    async with companion(TcpAddress("127.0.0.1", vehicle.tcp_port)) as computer:
        await computer.locked()


async def test_a_ground_station_beside_it_takes_nothing_away_and_is_not_believed(vehicle, companion, caplog):
    async with companion() as computer, vehicle.ground_station() as station:
        await computer.locked()
        for number in (2, 24, 33):
            await station.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, number, -1)
        before = computer.claim()

        async def forge(system, component, pause_s=0.05):
            """As the autopilot would, 30 m aside; the places that were claimed meanwhile."""
            station._mav.srcSystem, station._mav.srcComponent = system, component
            seen = set()
            for _ in range(40):
                boot_ms = station.latest["ATTITUDE"].time_boot_ms if "ATTITUDE" in station.latest else 0
                aside = (before.lat_e7 + 2_700, before.lon_e7, 0, 0, 0, 0, 0, 0)
                station.send(dialect.MAVLink_heartbeat_message(2, vehicle.kind, 0, 0, 4, 3))
                station.send(dialect.MAVLink_global_position_int_message(boot_ms, *aside))
                await asyncio.sleep(pause_s)
                claim = computer.claim()
                seen.add(claim and abs(claim.lat_e7 - before.lat_e7) < 100)
            station._mav.srcSystem, station._mav.srcComponent = 255, 190
            return seen

        strangers = computer.source.navigator.strangers
        await station.every(dialect.MAVLINK_MSG_ID_ATTITUDE, 50)
        assert await forge(7, 1) == {True}
        assert await forge(255, 190) == {True}
        assert computer.source.navigator.strangers > strangers
        await forge(1, 1, 0.01)
        if vehicle.name == "arducopter":
            assert await forge(1, 1) == {True}, "it passes on nothing in its own name"
        else:
            assert await forge(1, 1) == {None}, "it does; no position rather than a forged one"
            assert "two speak as the autopilot" in computer.source.why_not(computer.clock())
        await computer.until(computer.claim, "for good", 10)
        assert computer.source.navigator.sender.system == 1


async def test_a_restart_in_the_middle(vehicle, companion):
    async with companion() as computer, vehicle.ground_station() as station:
        await computer.locked()
        first = computer.claim()
        await vehicle.restart(station)
        await computer.until(lambda: computer.claim() is None, "it goes on", 10)
        await computer.locked()
        claim = computer.claim()
        off = metres_between((first.lat_e7 / 1e7, first.lon_e7 / 1e7, 0), (claim.lat_e7 / 1e7, claim.lon_e7 / 1e7, 0))
        assert max(map(abs, off)) < 0.5
        assert abs(claim.t_ms - time.time() * 1e3) < UTC_OFF_MS
