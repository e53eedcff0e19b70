"""How soon the demo shows something: from ``wonderland demo`` to its first verdict, on a machine that has run it before."""

from __future__ import annotations

import asyncio
import json
import sys
import time

import pytest
from bench.bench_tools import p50, show

RUNS = 3

pytestmark = pytest.mark.bench


async def first_verdict():
    """Seconds until the first verdict, seconds until the drones set out, and the verdict."""
    start = time.perf_counter()
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "wonderland.cli",
        "demo",
        "--headless",
        "--json",
        "--until",
        "1",
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    set_out = None
    verdict = None

    async def listen():
        nonlocal set_out
        async for line in process.stderr:
            if b"on their way" in line:
                set_out = time.perf_counter() - start

    listening = asyncio.create_task(listen())
    took_s = None
    async for line in process.stdout:
        took_s = took_s or time.perf_counter() - start
        verdict = verdict or json.loads(line)
    await listening
    assert await process.wait() == 0
    process._transport.close()
    return took_s, set_out, verdict


async def test_first_verdict(keep):
    runs = [await first_verdict() for _ in range(RUNS)]
    assert all(verdict["outcome"] == "verified" for _, _, verdict in runs)
    first, out = p50([run[0] for run in runs]), p50([run[1] for run in runs])
    flight_and_proof = first - out
    show(
        f"wonderland demo, {RUNS} runs, p50",
        ("what", "s", "goal"),
        [
            ("start → everything runs, drones set out", f"{out:.1f}", ""),
            ("flight to the pad and proof", f"{flight_and_proof:.1f}", ""),
            ("start → first verdict", f"{first:.1f}", "≤ 20"),
        ],
    )
    keep(first_verdict_s=first, set_out_s=out)
