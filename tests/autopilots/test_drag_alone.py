"""What an autopilot says of itself while its GPS is dragged away, without a pad: nothing, where it goes slowly.

The autopilot stays where its receiver says that it is, so it flies away; nothing that it tells of itself changes, and
neither does the claim. `WONDERLAND_FLIGHTS=DIR` keeps what was seen, as CSV.
"""

from __future__ import annotations

import asyncio
import csv
import os
import time
from pathlib import Path

import pytest
from kit import px4_receiver
from kit.ground_station import dialect
from kit.px4_receiver import Receiver
from kit.sitl import HEAD_START_S, METRES_PER_DEGREE, ArduCopter, Px4, drag_gps, metres_between, own_network

pytestmark = pytest.mark.timeout(180)

HEIGHT_M = 10.0
GUIDED = 4
HEALTHY = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
    | dialect.EKF_POS_VERT_ABS
)


@pytest.fixture
def vehicle(tmp_path):
    with own_network(), ArduCopter(tmp_path, head_start_s=HEAD_START_S) as vehicle:
        yield vehicle


async def hovers(station, vehicle):
    await vehicle.in_time(station)
    await station.done(dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED)
    async with asyncio.timeout(60):
        while await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED:
            await asyncio.sleep(0.5)
    await station.done(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
    async with asyncio.timeout(60):
        while (await vehicle.true_place(station))[2] < vehicle.home.alt_m + HEIGHT_M - 0.3:
            pass
    for number in (dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, dialect.MAVLINK_MSG_ID_GPS_RAW_INT):
        await station.every(number, 200)
    for name in ("EKF_STATUS_REPORT", "GPS_RAW_INT"):
        await station.next(name)


class Flight:
    """What the autopilot says of itself, what is claimed, and where it is: a row for each step of the drag."""

    def __init__(self, station, computer):
        self.station, self.computer = station, computer
        self.rows = []
        self._began = time.monotonic()

    def look(self, dragged_m):
        latest, claim = self.station.latest, self.computer.claim()
        gps, filters, truth = latest["GPS_RAW_INT"], latest["EKF_STATUS_REPORT"], latest["SIM_STATE"]
        row = {
            "t_s": round(time.monotonic() - self._began, 2),
            "dragged_m": round(dragged_m, 2),
            "claimed": bool(claim),
        }
        if claim is not None:
            place = (truth.lat_int / 1e7, truth.lon_int / 1e7, 0)
            north, east, _ = metres_between(place, (claim.lat_e7 / 1e7, claim.lon_e7 / 1e7, 0))
            row |= {"north_m": round(north, 2), "east_m": round(east, 2), "accuracy_mm": claim.accuracy_mm}
        row |= {"fix_type": gps.fix_type, "h_acc_mm": gps.h_acc, "satellites": gps.satellites_visible}
        row |= {"ekf_flags": filters.flags, "ekf_pos_variance": round(filters.pos_horiz_variance, 3)}
        self.rows.append(row)

    def said(self, *names):
        return {tuple(row[name] for name in names) for row in self.rows}

    def keep(self, name):
        if directory := os.environ.get("WONDERLAND_FLIGHTS"):
            with Path(directory, f"{name}.csv").open("w", newline="") as file:
                writer = csv.DictWriter(file, list(self.rows[0]))
                writer.writeheader()
                writer.writerows(self.rows)


async def test_a_jump_it_notices_and_the_claim_stays_where_it_is(vehicle, companion):
    """The control: what is seen below is no blindness of this test's."""
    async with vehicle.ground_station() as station:
        await hovers(station, vehicle)
        async with companion() as computer:
            await computer.locked()
            station.set_quickly("SIM_GPS1_GLTCH_X", 220 / METRES_PER_DEGREE)
            flight = Flight(station, computer)
            flight.look(220)
            async with asyncio.timeout(20):
                while not flight.rows[-1]["ekf_flags"] & dialect.EKF_GPS_GLITCHING:
                    await asyncio.sleep(0.1)
                    flight.look(220)
                while not any("Glitch" in text for text in station.texts):
                    await asyncio.sleep(0.1)
            assert all(abs(row["north_m"]) < 2 for row in flight.rows)


@pytest.mark.parametrize(("metres_per_s", "for_s"), [(0.3, 20), (1.0, 20), (2.0, 10)])
async def test_nothing_that_the_autopilot_says_tells_of_a_slow_drag(vehicle, companion, metres_per_s, for_s):
    async with vehicle.ground_station() as station:
        await hovers(station, vehicle)
        async with companion() as computer:
            await computer.locked()
            still = Flight(station, computer)
            await drag_gps(station, 0, 2, look=still.look)
            assert all(abs(row["north_m"]) < 0.5 for row in still.rows)

            station.texts.clear()
            flight = Flight(station, computer)
            await drag_gps(station, metres_per_s, for_s, look=flight.look)
            flight.keep(f"dragged-{metres_per_s:g}-m-per-s")
            assert flight.rows[-1]["north_m"] > 0.7 * metres_per_s * for_s, "claimed to be so far from where it is"
            own_words = ("claimed", "accuracy_mm", "fix_type", "h_acc_mm", "satellites", "ekf_flags")
            assert flight.said(*own_words) == still.said(*own_words), "and says the same as before"
            (flags,) = {row["ekf_flags"] for row in flight.rows}
            assert flags & HEALTHY == HEALTHY
            assert max(row["ekf_pos_variance"] for row in flight.rows) < 1, "of its own limit"
            assert station.texts == []


async def test_px4_goes_along_as_well(tmp_path, companion):
    parameters = px4_receiver.PARAMETERS
    with own_network(), Px4(tmp_path, parameters=parameters) as vehicle:
        async with vehicle.ground_station() as station, Receiver(station) as receiver, companion() as computer:
            await computer.locked()
            await station.set("MIS_TAKEOFF_ALT", HEIGHT_M)
            nan = float("nan")
            await station.done(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, nan, nan, nan, vehicle.home.alt_m + HEIGHT_M)
            async with asyncio.timeout(60):
                while await station.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1) != dialect.MAV_RESULT_ACCEPTED:
                    await asyncio.sleep(0.5)
                while receiver.truth.alt < 1e3 * (vehicle.home.alt_m + HEIGHT_M - 0.5):
                    await asyncio.sleep(0.1)
            await station.next("ESTIMATOR_STATUS")
            calm, claim = station.latest["ESTIMATOR_STATUS"], computer.claim()
            station.texts.clear()
            began = time.monotonic()
            while receiver.north_m < 15:
                receiver.north_m = time.monotonic() - began
                assert computer.claim().accuracy_mm == claim.accuracy_mm
                assert station.latest["ESTIMATOR_STATUS"].flags == calm.flags
                await asyncio.sleep(0.1)
            place = (receiver.truth.lat / 1e7, receiver.truth.lon / 1e7, 0)
            claim = computer.claim()
            assert metres_between(place, (claim.lat_e7 / 1e7, claim.lon_e7 / 1e7, 0))[0] > 10
            assert station.latest["ESTIMATOR_STATUS"].pos_horiz_ratio < 1, "of its own limit"
            assert station.texts == []
