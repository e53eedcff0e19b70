"""What a record takes from a pad's spool until it is acknowledged: over the bus beside a WebSocket, in turns.

The router and the backend are processes, TLS with certificates on both sides on either way; the pad is this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest
from bench.bench_tools import p50, p95, show
from kit.bus import HOST
from kit.bus_processes import Bus

from wonderland.telemetry import tls_of
from wonderland_edge_agent.spool import Spool
from wonderland_edge_agent.uplink import Uplink, WebSocketTransport
from wonderland_fabric_gateway.connection import ClientTls

pytestmark = pytest.mark.bench

TRACK = {"uav_id": "uav-1", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "height_mm": 42_000, "transport": "wifi"}
TURNS, EACH, MANY = 5, 40, 20_000


@contextlib.asynccontextmanager
async def connected(way, bus, directory):
    """A pad's spool with its uplink, and how to wait for an acknowledgement."""
    changed = asyncio.Event()
    async with await Spool.open(directory, owner="pad-1", reserve_bytes=0, linger_s=0.001) as spool:
        uplink = Uplink(way, bus.credentials(), spool, on_status=lambda _status: changed.set())

        async def acknowledged(seq):
            while uplink.status.acknowledged_seq < seq:
                changed.clear()
                await changed.wait()

        await uplink.start()
        try:
            yield spool, acknowledged, uplink
        finally:
            await uplink.close()


async def test_record_to_acknowledgement(tmp_path, keep):
    bus = Bus(tmp_path, listener=True)
    await bus.router.start()
    await bus.backend.start()
    tls = bus.organisations.tls("PadMSP", "pad-1")
    context = tls_of(tls.ca, ClientTls(tls.certificate, tls.key))
    url = f"wss://{HOST}:{bus.backend.told['port']}/ingest"
    ways = {
        "WebSocket": lambda: WebSocketTransport(url, ssl_context=context),
        "Zenoh": lambda: bus.way(ping_s=10, open_timeout_s=10),
    }
    latency = {name: [] for name in ways}
    rates = {name: [] for name in ways}
    processor = {name: [] for name in ways}
    opened = {name: [] for name in ways}
    try:
        async with asyncio.timeout(600):
            for turn in range(TURNS):
                for name, way in ways.items():
                    now_ms = time.time_ns() // 1_000_000
                    started = time.perf_counter()
                    async with connected(way(), bus, tmp_path / f"{name}-{turn}") as (spool, acknowledged, uplink):
                        while not uplink.status.connected:
                            await asyncio.sleep(0.001)
                        opened[name].append(1_000 * (time.perf_counter() - started))
                        for _ in range(EACH):
                            started = time.perf_counter()
                            seq = await spool.append("track", now_ms, TRACK, evidence=False)
                            await acknowledged(seq)
                            latency[name].append(1_000 * (time.perf_counter() - started))
                            await asyncio.sleep(0.01)
                        started, worked = time.perf_counter(), time.process_time()
                        seqs = await asyncio.gather(
                            *(spool.append("track", now_ms, TRACK, evidence=False) for _ in range(MANY))
                        )
                        await acknowledged(max(seqs))
                        rates[name].append(MANY / (time.perf_counter() - started))
                        processor[name].append(1e6 * (time.process_time() - worked) / MANY)
    finally:
        await bus.backend.kill()
        await bus.router.kill()
    show(
        "A record: spool (durable), pad → backend (durable, SQLite) → acknowledged",
        ("", *ways),
        [
            ("p50, ms", *(f"{p50(latency[name]):.1f}" for name in ways)),
            ("p95, ms", *(f"{p95(latency[name]):.1f}" for name in ways)),
            (f"{MANY:,} at once, records/s, median", *(f"{p50(rates[name]):,.0f}" for name in ways)),
            ("processor of the pad, µs each", *(f"{p50(processor[name]):.0f}" for name in ways)),
            ("connected and greeted, ms, median", *(f"{p50(opened[name]):.0f}" for name in ways)),
        ],
    )
    keep(bus_p50_ratio=p50(latency["Zenoh"]) / p50(latency["WebSocket"]))
