"""How long there is no leader after the leader was killed, beside what a start of the same backend takes.

pytest tests/bench/test_takeover.py -m bench -s -n 0
"""

from __future__ import annotations

import asyncio
import time

import pytest
from bench.bench_tools import p50, show
from kit import backend_process as processes
from kit.backend_process import ledger

__all__ = ["ledger"]

pytestmark = [pytest.mark.bench, pytest.mark.timeout(600)]
TURNS = 7


async def taken_over(tmp_path, database):
    """(start, outage) in seconds, the one that was killed last followed by a fresh one each time."""
    started, outages = [], []
    began = time.perf_counter()
    leader = await processes.start(tmp_path, database=database)
    running = [leader]
    try:
        await processes.ready(leader)
        started.append(time.perf_counter() - began)
        for turn in range(TURNS):
            standby = await processes.start(tmp_path, database=database)
            running.append(standby)
            assert (await processes.ready(standby))["standby"] is True
            # Not always at the same time of its second.
            await asyncio.sleep(turn / TURNS)
            leader.kill()
            killed = time.perf_counter()
            await processes.ready(standby)
            outages.append(time.perf_counter() - killed)
            leader = standby
    finally:
        for process in running:
            if process.returncode is None:
                process.kill()
            await process.communicate()
    return started, outages


@pytest.mark.parametrize("kind", ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
async def test_how_long_there_is_no_leader(tmp_path, ledger, kind, request, keep):
    if kind == "sqlite":
        database = f"sqlite:///{tmp_path / 'leader.db'}"
    else:
        database = request.getfixturevalue("postgres").new_database()
    started, outages = await taken_over(tmp_path, database)
    row = (kind, f"{started[0]:.1f} s", f"{p50(outages):.1f} s", f"{max(outages):.1f} s")
    show(f"No leader after kill -9, {TURNS} times", ("database", "a first start", "median", "longest"), [row])
    keep(database=kind, start_s=started[0], median_s=p50(outages), longest_s=max(outages))
