"""What a pad spends on what it keeps: records made durable."""

from __future__ import annotations

import asyncio
import time

import pytest
from bench.bench_tools import show

from wonderland_edge_agent.spool import Spool

pytestmark = pytest.mark.bench

TRACK = {"uav_id": "1581F5FKD229400A1234", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "udp"}


async def test_spool(tmp_path, keep):
    async with await Spool.open(tmp_path, owner="pad-1", quota_bytes=256 << 20) as spool:
        count, batch = 1_000, 20_000
        started = time.perf_counter()
        for _ in range(count):
            await spool.append("step", 0, TRACK, evidence=True)
        evidence = count / (time.perf_counter() - started)
        started = time.perf_counter()
        await asyncio.gather(*(spool.append("track", 0, TRACK, evidence=False) for _ in range(batch)))
        telemetry = batch / (time.perf_counter() - started)
        seconds, cpu, wall = 5, time.process_time(), time.perf_counter()
        for _ in range(20 * seconds):
            spool.offer("track", 0, TRACK)
            await asyncio.sleep(0.05)
        core = (time.process_time() - cpu) / (time.perf_counter() - wall)
        assert spool.status.records >= count + batch
    show(
        "Spool: SQLite, write-ahead log, FULL",
        ("figure", "value"),
        [
            ("evidence, one flush each, one after the other", f"{evidence:,.0f}/s"),
            ("telemetry, flushed together", f"{telemetry:,.0f}/s"),
            ("core at 20 records a second", f"{core:.1%}"),
        ],
    )
    keep(evidence_per_s=round(evidence), telemetry_per_s=round(telemetry), core_at_20_hz=core)
