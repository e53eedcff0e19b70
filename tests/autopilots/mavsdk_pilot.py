"""A pilot with a ground station that nobody here wrote: MAVSDK. Run by an interpreter that has it; says JSON lines.

    python mavsdk_pilot.py UDP_PORT LAT LON HEIGHT_M

It waits until the vehicle may be armed, takes off, flies to that place above a pad, and gives the order to land.
"""

import asyncio
import json
import sys

from mavsdk_grpc import System
from mavsdk_grpc.action import ActionError

CRUISE_M = 14.0


def say(**what):
    print(json.dumps(what), flush=True)


async def first(stream, wanted):
    async for each in stream:
        if wanted(each):
            return each
    raise EOFError


async def fly(port, lat, lon, height_m):
    vehicle = System()
    await vehicle.connect(f"udpin://127.0.0.1:{port}")
    await first(vehicle.core.connection_state(), lambda state: state.is_connected)
    say(did="heard it")
    await first(vehicle.telemetry.health(), lambda health: health.is_home_position_ok)
    await vehicle.telemetry.set_rate_position(5)
    await vehicle.telemetry.set_rate_in_air(5)
    await vehicle.action.set_takeoff_altitude(CRUISE_M)
    while True:
        try:
            await vehicle.action.arm()
            await vehicle.action.takeoff()
        except ActionError as refused:
            say(refused=str(refused))
            await asyncio.sleep(1)
        else:
            break
    await first(vehicle.telemetry.position(), lambda here: here.relative_altitude_m > CRUISE_M - 1)
    say(did="took off")
    await vehicle.action.goto_location(lat, lon, height_m + CRUISE_M, 0.0)

    def there(here):
        north_m, east_m = (here.latitude_deg - lat) * 111_320, (here.longitude_deg - lon) * 54_900
        return north_m**2 + east_m**2 < 1

    await first(vehicle.telemetry.position(), there)
    await vehicle.action.land()
    say(did="ordered the landing")
    await first(vehicle.telemetry.in_air(), lambda flies: not flies)
    say(did="is down")


asyncio.run(fly(int(sys.argv[1]), *map(float, sys.argv[2:])))
