from __future__ import annotations

import asyncio
import time
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from kit.backend_process import ledger
from kit.proof_actors import HERE, ROUNDS, Actors
from kit.proof_world import World
from kit.replicas import pair

from wonderland.telemetry import Credentials
from wonderland.telemetry.bodies import Health, Track
from wonderland_backend.http.times import now_ms
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Uplink, UplinkTimings
from wonderland_edge_agent.uplink.websocket import WebSocketTransport
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration

__all__ = ["ledger"]

DRONES = 40
FLYING = 6
ELSEWHERE = (HERE[0] + 4_200, HERE[1], HERE[2])


class Field:
    """A pad whose agent reports what it hears, and drones that prove where they are, or lie."""

    def __init__(self, directory, actors, credentials):
        self.directory = directory
        self.actors = actors
        self.credentials = credentials
        self.prepared = []
        self.proved = []
        self.reported = 0
        self.uplink = None

    async def prove(self):
        """One more verdict on the ledger."""
        drone = self.prepared.pop()
        _, verdict = await self.actors.prove(drone, 0)
        self.proved.append(verdict["session_id"])
        return drone, verdict

    @asynccontextmanager
    async def reporting(self, url, each_s=0.02):
        """The pad's real spool and uplink, towards a backend or whatever stands in front; drones fly meanwhile."""
        timings = UplinkTimings(backoff_s=0.2, backoff_max_s=0.5, stall_timeout_s=5)
        async with await Spool.open(self.directory / "spool", owner="pad-0") as spool:
            self.uplink = Uplink(
                WebSocketTransport(url.replace("http", "ws") + "/ingest"), self.credentials, spool, timings=timings
            )
            await self.uplink.start()
            flying = asyncio.create_task(self._fly(SpoolReporter(spool), each_s))
            try:
                yield self
            finally:
                flying.cancel()
                await asyncio.gather(flying, return_exceptions=True)
                await self.uplink.close()

    async def _fly(self, reporter, each_s):
        reporter.offer(time.time_ns() // 1_000_000, Health(prekeys=DRONES))
        while True:
            self.reported += 1
            number = self.reported % FLYING
            t_ms = time.time_ns() // 1_000_000
            place = {"lat_e7": 604_518_000 + self.reported % 1_000, "lon_e7": 222_666_000, "height_mm": 42_000}
            reporter.offer(t_ms, Track(uav_id=f"FLY-{number}", transport="wifi_beacon", accuracy_mm=3_000, **place))
            await asyncio.sleep(each_s)


@pytest.fixture
async def field(ledger, tmp_path):
    names = [f"uav-{number}" for number in range(4)]
    administration = DirectoryAdministration(ledger.directory)
    for name, role in (("pad-0", "pad"), *((name, "uav") for name in names)):
        administration.enrol(name, role=role, pol_id=name)
    known = Connection.load(tmp_path / "ledger" / "connection.json")
    async with ledger.connection.open_channel() as channel:
        actors = Actors(replace(ledger.connection, identities=known.identities), channel)
        lie = World(seed=5).evidence(lambda _: ELSEWHERE, lambda _: HERE, rounds=ROUNDS, broadcast=lambda _: HERE)
        actors.evidence = [lie]
        await actors.register(now_ms(), pads=1, drones=len(names))
        identity = known.identity("pad-0")
        credentials = Credentials(
            agent="pad", id="pad-0", msp_id=identity.msp_id, certificate_pem=identity.certificate_pem.decode(),
            sign=known.signer("pad-0"),
        )  # fmt: skip
        found = Field(tmp_path, actors, credentials)
        found.prepared = list(await actors.prepare(DRONES, pads=1, drones=len(names)))
        yield found


@pytest.fixture
async def replicas(field, tmp_path, database_url):
    async with pair(tmp_path, database_url) as found:
        yield found
        log = found.errors.read_text()
        assert "Traceback" not in log, log[-6000:]
