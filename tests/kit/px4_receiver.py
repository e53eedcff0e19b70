"""A GPS receiver for PX4's own simulation, from outside: with its own off, it flies by what a test says."""

from __future__ import annotations

import asyncio
import time

from kit.ground_station import GroundStation, dialect
from kit.sitl import METRES_PER_DEGREE

PARAMETERS = {"SENS_EN_GPSSIM": 0, "MAV_USEHILGPS": 1, "SDLOG_MODE": -1}
"""For `Px4(directory, parameters=PARAMETERS)`."""
EPH_CM, EPV_CM = 90, 178
"""As its own receiver states them."""


class Receiver:
    """`async with Receiver(station)`: eight fixes a second where the simulation has the vehicle, `north_m` off it."""

    def __init__(self, station):
        self._station = station
        self._mav = dialect.MAVLink(None, srcSystem=1, srcComponent=dialect.MAV_COMP_ID_GPS)
        self._simulation = GroundStation.by_udp(19_410, 19_450)
        self.north_m = 0.0

    async def __aenter__(self):
        await self._simulation.__aenter__()
        self.truth = await self._simulation.next("HIL_STATE_QUATERNION")
        self._feeding = asyncio.create_task(self._feed())
        return self

    async def __aexit__(self, *_):
        self._feeding.cancel()
        await asyncio.gather(self._feeding, return_exceptions=True)
        await self._simulation.__aexit__()

    async def _feed(self):
        while True:
            self.truth = truth = self._simulation.latest["HIL_STATE_QUATERNION"]
            lat = truth.lat + round(1e7 * self.north_m / METRES_PER_DEGREE)
            speed = round((truth.vx**2 + truth.vy**2) ** 0.5)
            velocity = (speed, truth.vx, truth.vy, truth.vz)
            place = (lat, truth.lon, truth.alt, EPH_CM, EPV_CM)
            fix = dialect.MAVLink_hil_gps_message(int(time.time() * 1e6), 3, *place, *velocity, 65_535, 12)
            self._mav.seq = (self._mav.seq + 1) % 256
            self._station.write(bytes(fix.pack(self._mav)))
            await asyncio.sleep(0.12)
