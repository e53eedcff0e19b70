"""Autopilots that nobody here wrote, each on a network of its own with the test that meets it."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from kit.geoids import write_geoid
from kit.sitl import COMPANION_PORT, ArduCopter, Px4, own_network

from wonderland.clock import SteadyClock
from wonderland.geoid import Geoid
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress

LOCK_S = 90.0
"""Until the filter uses GPS: some 40 s with ArduPilot, 4 s with PX4, on an idle machine."""


@pytest.fixture(scope="module", params=[ArduCopter, Px4], ids=lambda kind: kind.name)
def vehicle(request, tmp_path_factory):
    """One process for all tests of a module."""
    with own_network(), request.param(tmp_path_factory.mktemp(request.param.name)) as vehicle:
        yield vehicle


@pytest.fixture(scope="session")
def geoid(tmp_path_factory):
    return Geoid(write_geoid(tmp_path_factory.mktemp("geoid") / "WW15MGH.DAC"))


class Companion:
    """What a computer on board makes of it: our source, and how often each kind of message came."""

    def __init__(self, source, clock):
        self.source, self.clock = source, clock
        self.arrived = {}
        take = source.navigator.take

        def counted(message, sender, now_ms):
            self.arrived.setdefault(type(message).__name__, []).append(now_ms)
            take(message, sender, now_ms)

        source.navigator.take = counted

    def claim(self):
        return self.source.claim(self.clock())

    async def until(self, condition, what, timeout_s=LOCK_S):
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    await asyncio.sleep(0.02)
        except TimeoutError:
            pytest.fail(f"{what}; {self.source.why_not(self.clock())}")

    async def locked(self):
        """Until there are claims, by the autopilot's own time."""
        await self.until(lambda: self.claim() and self.source.navigator.skew_ms is not None, "no position")
        return self


@pytest.fixture
def companion(geoid):
    """`async with companion(vehicle) as computer`."""

    @contextlib.asynccontextmanager
    async def opened(where=None):
        clock = SteadyClock()
        async with MavlinkPosition(where or UdpAddress("127.0.0.1", COMPANION_PORT), clock, geoid) as source:
            yield Companion(source, clock)

    return opened
