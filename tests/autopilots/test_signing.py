"""A link that a real ArduPilot signs, once a ground station gave it the key."""

from __future__ import annotations

import asyncio
import time

import pytest
from kit.ground_station import dialect
from kit.sitl import COMPANION_PORT, ArduCopter, own_network

from wonderland.clock import SteadyClock
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.position.mavlink.signing import SINCE_MS

pytestmark = pytest.mark.timeout(240)

KEY = bytes(range(1, 33))
LONG_S = 90.0


@pytest.fixture
def vehicle(tmp_path):
    with own_network(), ArduCopter(tmp_path) as vehicle:
        yield vehicle


async def sends_signed(station):
    """The key, on the ground station's own link; from now on it signs there, too."""
    now = 100 * (time.time_ns() // 1_000_000 - SINCE_MS)
    station.send(dialect.MAVLink_setup_signing_message(1, 1, list(KEY), now))
    await asyncio.sleep(0.2)
    for mav in (station._mav, station._reader):
        mav.signing.secret_key, mav.signing.timestamp, mav.signing.link_id = KEY, now, 1
        mav.signing.sign_outgoing = True


async def test_with_the_key_it_is_heard_and_obeyed_without_it_neither(vehicle, geoid):
    clock = SteadyClock()
    where = UdpAddress("127.0.0.1", COMPANION_PORT)
    async with vehicle.ground_station() as station:
        await station.next("HEARTBEAT")
        await sends_signed(station)
        async with MavlinkPosition(where, clock, geoid) as link:
            async with asyncio.timeout(LONG_S):
                while link.navigator.sender is None:
                    await asyncio.sleep(0.05)
            await asyncio.sleep(5)
            assert "no GLOBAL_POSITION_INT" in link.why_not(clock()), "what is asked for unsigned does not come"
        async with MavlinkPosition(where, clock, geoid, key=bytes(32)) as link:
            async with asyncio.timeout(LONG_S):
                while "not signed with this key" not in link.why_not(clock()):
                    await asyncio.sleep(0.05)
            assert link.navigator.sender is None
        async with MavlinkPosition(where, clock, geoid, key=KEY) as link:
            await link.wait(LONG_S)
            assert link._signing.refused == 0
