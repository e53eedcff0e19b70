"""2,500 positions/s to 400 consoles: over two backends on a bus, and over one, in one run.

pytest tests/bench/test_replicas.py -m bench -s -p no:xdist
"""

from __future__ import annotations

import asyncio
import json
import sys

import psutil
import pytest
from bench.bench_tools import p50, p95, show
from bench.test_live_push import Viewer, cookie_of
from kit import environment
from kit.bus_router import written
from kit.databases import copy_migrated
from kit.replicas import Bus

pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]
RATE = 2_500
CONSOLES = 200
APART_S = 0.02
"""Consoles come one after the other: each asks the database who it is."""
WARM_S = 5
SECONDS = 12
PATH = "/api/v1/live"


class Server:
    """A backend as a process."""

    @classmethod
    async def begun(cls, role, database, bus, name):
        found = cls()
        found.process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "bench.replica_server",
            role,
            database,
            written(bus.organisations.member("AuthorityMSP", name, bus.port)),
            str(RATE),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=environment(),
        )
        found.told = json.loads(await asyncio.wait_for(found.process.stdout.readline(), 60))
        return found

    async def end(self):
        self.process.stdin.close()
        try:
            await asyncio.wait_for(self.process.wait(), 20)
        except TimeoutError:
            self.process.kill()
            await self.process.wait()


async def measured(servers, consoles, cookie):
    """[(CPU of one processor, ages in ms)] of each backend, with so many consoles each; one of them looks into it."""
    viewers = [[Viewer(looks=number == 0) for number in range(consoles)] for _ in servers]
    # The one that looks into its bytes takes text.
    paths = [PATH, *[PATH + "?packed=zlib"] * (consoles - 1)]
    tasks = []
    for server, found in zip(servers, viewers, strict=True):
        for viewer, path in zip(found, paths, strict=True):
            tasks.append(asyncio.create_task(viewer.run(server.told["port"], path, cookie)))
            await asyncio.sleep(APART_S)
    await asyncio.sleep(WARM_S)
    processes = [psutil.Process(each.process.pid) for each in servers]
    before = [sum(each.cpu_times()[:2]) for each in processes]
    for found in viewers:
        found[0].ages_ms.clear()
    await asyncio.sleep(SECONDS)
    spent = [(sum(each.cpu_times()[:2]) - was) / SECONDS for each, was in zip(processes, before, strict=True)]
    ages = [list(found[0].ages_ms) for found in viewers]
    assert not any(task.done() for task in tasks), "a console was closed"
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return list(zip(spent, ages, strict=True))


async def test_two_backends_beside_one(tmp_path, keep):
    rows, kept = [], {}
    database = f"sqlite:///{copy_migrated(tmp_path / 'replicas.db')}"
    bus = Bus(tmp_path)
    await bus.start()
    servers = []
    try:
        servers.append(first := await Server.begun("on-duty", database, bus, "backend-1"))
        cookie = await cookie_of(first.told["link"])
        servers.append(second := await Server.begun(first.told["epoch"], database, bus, "backend-2"))
        names = ("on duty, 200 consoles", "follows, 200 consoles", "alone, 400 consoles")
        for turn in range(2):
            two = await measured([first, second], CONSOLES, cookie)
            one = await measured([first], 2 * CONSOLES, cookie)
            for name, (cpu, ages) in zip(names, (*two, *one), strict=True):
                rows.append((f"{name}, {turn + 1}.", f"{100 * cpu:.0f}", f"{p50(ages):.0f}", f"{p95(ages):.0f}"))
                kept[f"{name.partition(',')[0].replace(' ', '_')}_{turn}"] = json.dumps([cpu, p50(ages), p95(ages)])
    finally:
        for each in servers:
            await each.end()
        await bus.kill()
    columns = ("backend", "CPU, % of one", "age p50 ms", "p95 ms")
    show(f"{RATE:,} positions/s to {2 * CONSOLES} consoles", columns, rows)
    keep(**kept)
