"""A drone's agent tells the backend where it is, over its real connection, until it is a flight."""

from __future__ import annotations

import asyncio

from kit.backend import credentials_of

from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.requests import Requests


async def test_where_a_drone_is_by_its_own_agent(running, authorities, clock):
    async def decide(_wish):
        return "no"

    claims = [
        None,
        Claim(
            lat_e7=604_518_000, lon_e7=222_666_000, height_mm=41_500, accuracy_mm=700, height_accuracy_mm=1_400,
            t_ms=clock.now_ms,
        ),
    ]  # fmt: skip
    enrolment = authorities.enrol("uav-1", "FleetMSP", role="uav", id="uav-1")
    url = running.url.replace("http", "ws", 1) + "/ingest"
    requests = Requests(
        url, credentials_of(enrolment), decide, lambda: claims[0] if len(claims) == 1 else claims.pop(0)
    )
    listening = asyncio.create_task(requests.run())
    try:
        async with asyncio.timeout(15):
            while not (found := list(running.parts.uspace.flights)):
                await asyncio.sleep(0.05)
        (flight,) = found
        assert flight.drone == "uav-1"
        assert (flight.current.lat, flight.current.altitude_m) == (604_518_000, 41.5)
        assert list(running.parts.uspace.provider.served()) == [flight]
    finally:
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)
