"""What a pad spends on what it hears and keeps: Remote ID messages decoded, records made durable."""

from __future__ import annotations

import asyncio
import time

import pytest
from bench_tools import show

from edge_agent.spool import Spool
from wonderland.remote_id import (
    BasicId,
    HorizontalAccuracy,
    Location,
    OperatorId,
    Pack,
    System,
    decode,
    encode,
)

pytestmark = pytest.mark.bench

MESSAGES = (
    BasicId(uas_id="1581F5FKD229400A1234"),
    Location(
        lat_e7=604_518_000,
        lon_e7=222_666_000,
        track_cdeg=21_500,
        speed_mm_s=5_500,
        vertical_mm_s=-500,
        altitude_mm=40_000,
        horizontal_accuracy=HorizontalAccuracy.M_3,
        after_hour_ms=1_234_500,
    ),
    System(operator_lat_e7=604_518_000, operator_lon_e7=222_666_000, t_ms=1_800_000_000_000),
    OperatorId(operator_id="FIN87astrdge12k8"),
)
TRACK = {"uav_id": "1581F5FKD229400A1234", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "udp"}


def per_second(work, value, count=50_000):
    best = 0.0
    for _ in range(3):
        started = time.perf_counter()
        for _ in range(count):
            work(value)
        best = max(best, count / (time.perf_counter() - started))
    return best


def test_remote_id(keep):
    rows, figures = [], {}
    for message in MESSAGES:
        frame = encode(message)
        assert decode(frame) == message
        decoded, encoded = per_second(decode, frame), per_second(encode, message)
        name = type(message).__name__
        rows.append((name, f"{decoded:,.0f}/s", f"{encoded:,.0f}/s"))
        figures[f"{name.lower()}_decoded_per_s"] = round(decoded)
    pack = encode(Pack(messages=MESSAGES))
    packs = per_second(decode, pack, 20_000)
    rows.append(("Pack of these four", f"{packs:,.0f}/s", f"= {4 * packs:,.0f} messages/s (goal 150,000)"))
    show("Remote ID, one core", ("message", "decoded", "encoded"), rows)
    keep(pack_messages_per_s=round(4 * packs), **figures)


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
