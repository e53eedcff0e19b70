"""Whole proofs, many at a time: request, countersignature, verdict, mirrored into the database; and what memory does.

Ledger, backend and the clients are three processes, as in life, on the cores that this machine has. Prepared are only
the drones, the pads, their prekeys and the ranges; every signature, endorsement and commit is made while the clock runs.
"""

from __future__ import annotations

import asyncio
import os
import time
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from bench.bench_fabric import fabric_network
from bench.bench_tools import p50, p95, show
from kit.proof_actors import DRONES, PADS, ROUNDS, Actors

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_fabric_network import enrolment, taking_down

FULL = os.environ.get("WONDERLAND_BENCH_FULL") == "1"
PROOFS = 10_000 if FULL else 1_500
SAMPLES = 20
# Fabric by the settings that docs/operate/capacity.md recommends for many proofs rather than for quick ones.
FABRIC_BATCH_TIMEOUT_MS = 200

pytestmark = pytest.mark.bench


class Memory:
    """Resident memory (MB) and CPU time (s) of groups of processes."""

    def __init__(self, **pids):
        self._groups = {
            name: [psutil.Process(pid) for pid in ([pids[name]] if isinstance(pids[name], int) else pids[name])]
            for name in pids
        }
        self.rss_mb = {name: [] for name in pids}

    def sample(self):
        for name, group in self._groups.items():
            self.rss_mb[name].append(sum(process.memory_info().rss for process in group) / 1e6)

    def cpu_s(self):
        return {name: sum(sum(each.cpu_times()[:2]) for each in group) for name, group in self._groups.items()}


@dataclass(frozen=True)
class Place:
    """A ledger that runs, with identities for all actors, and its processes by what they are."""

    kind: str
    connection_file: Path
    pids: dict
    at_once: int
    goal: str


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def database_url(request, tmp_path):
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'bench.db'}"
    return request.getfixturevalue("postgres").new_database()


@pytest.fixture(params=["embedded", pytest.param("fabric", marks=pytest.mark.fabric)])
async def place(request, tmp_path, start_ledger):
    """The embedded ledger in a process of its own; or Fabric with three organisations, one peer each, one orderer."""
    if request.param == "embedded":
        _, ledger = await start_ledger()
        home = Path(ledger.ready["connection"]).parent
        administration = DirectoryAdministration(LedgerDirectory(home))
        for index in range(PADS):
            administration.enrol(f"pad-{index}", role="pad", pol_id=f"pad-{index}")
        for index in range(DRONES):
            administration.enrol(f"uav-{index}", role="uav", pol_id=f"uav-{index}")
        yield Place("embedded", home / "connection.json", {"ledger": ledger.handle.pid}, 32, "≥ 150")
        return
    network = await fabric_network(tmp_path / "net", ordering={"batch_timeout_ms": FABRIC_BATCH_TIMEOUT_MS})
    try:
        requests = [enrolment.Request(f"pad-{index}", "pad", f"pad-{index}") for index in range(PADS)]
        requests += [enrolment.Request(f"uav-{index}", "uav", f"uav-{index}") for index in range(DRONES)]
        await enrolment.enrol(network, requests)
        pids = {}
        for name in network.processes.names():
            if (pid := network.processes.pid(name)) is not None:
                group = name.partition(".")[2].partition("-")[0].rstrip("0123456789")
                pids.setdefault({"contract": "contract servers"}.get(group, f"{group}s"), []).append(pid)
        yield Place("Fabric (Raft)", network.directory.connection_file, pids, 96, "≥ 60")
    finally:
        await taking_down.take_down(network, lambda *_: None)


async def test_complete_proofs(place, processes, database_url, keep):
    connection = Connection.load(place.connection_file)
    options = (
        "--connection",
        str(place.connection_file),
        "--database",
        database_url,
        "--listen",
        "127.0.0.1:0",
        "--demo",
        "--json",
    )
    backend = await processes.start("backend", "backend", "serve", *options)
    async with (
        connection.open_channel() as channel,
        httpx.AsyncClient(base_url=backend.ready["url"], trust_env=False) as http,
    ):
        (await http.post("/api/v1/session", json={"token": backend.ready["token"]})).raise_for_status()
        network = Gateway(channel, connection.identity("mirror"), connection.signer("mirror")).network(
            connection.channel
        )
        actors = Actors(connection, channel)
        at_once = place.at_once
        await actors.register(time.time_ns() // 1_000_000)
        prepared = await actors.prepare(PROOFS + at_once)
        await asyncio.gather(*(actors.prove(each, 0) for each in prepared[:at_once]))
        await mirrored(http, await network.height())
        memory = Memory(**place.pids, backend=backend.handle.pid, clients=os.getpid())
        took, outcomes = [], []
        waiting = iter(list(enumerate(prepared[at_once:])))
        cpu_before = memory.cpu_s()
        memory.sample()
        blocks = await network.height()

        async def work():
            for number, each in waiting:
                milliseconds, verdict = await actors.prove(each, number)
                took.append(milliseconds)
                outcomes.append((verdict["outcome"], verdict["permission"]))
                if len(took) % max(1, PROOFS // SAMPLES) == 0:
                    memory.sample()

        start = time.perf_counter()
        await asyncio.gather(*(work() for _ in range(at_once)))
        committed_s = time.perf_counter() - start
        height = await network.height()
        await mirrored(http, height)
        whole_s = time.perf_counter() - start
        cpu = {name: value - cpu_before[name] for name, value in memory.cpu_s().items()}
        kept = await count_verdicts(http, PROOFS + at_once)
    assert outcomes == [("verified", "granted")] * PROOFS
    assert kept == PROOFS + at_once
    kind = database_url.partition(":")[0]
    show(
        f"{PROOFS} complete proofs ({ROUNDS} rounds × 4 anchors), {at_once} at a time, {place.kind}, {kind}",
        ("figure", "value", "goal"),
        [
            ("proofs/s until in the database", f"{PROOFS / whole_s:.0f}", place.goal),
            ("proofs/s until committed", f"{PROOFS / committed_s:.0f}", ""),
            ("the mirror after the last commit", f"{(whole_s - committed_s) * 1e3:.0f} ms behind", ""),
            ("one proof, p50 / p95", f"{p50(took):.0f} / {p95(took):.0f} ms", ""),
            ("transactions in a block", f"{2 * PROOFS / (height - blocks):.1f}", ""),
            *((f"CPU of {name}", f"{value / PROOFS * 1e3:.2f} ms/proof", "") for name, value in cpu.items()),
            *(
                (
                    f"memory of {name}",
                    f"{values[0]:.0f} → {values[len(values) // 2]:.0f} → {values[-1]:.0f} MB",
                    "flat" if name in {"ledger", "backend", "contract servers"} else "",
                )
                for name, values in memory.rss_mb.items()
            ),
        ],
    )
    keep(
        ledger=place.kind,
        database=kind,
        proofs=PROOFS,
        proofs_per_s=PROOFS / whole_s,
        cpu_ms_per_proof={name: value / PROOFS * 1e3 for name, value in cpu.items()},
        rss_mb={name: [round(value, 1) for value in values] for name, values in memory.rss_mb.items()},
    )


async def mirrored(http, height):
    """Until the backend has so many blocks."""
    async with asyncio.timeout(60):
        while True:
            status = (await http.get("/api/v1/status")).json()["ledger"]
            assert not status["halted"]
            if status["mirrored"] >= height:
                return
            await asyncio.sleep(0.02)


async def count_verdicts(http, expected):
    """How many verdicts REST has, page by page."""
    count, cursor = 0, ""
    while count <= expected:
        page = (
            await http.get("/api/v1/verdicts", params={"limit": 200, **({"cursor": cursor} if cursor else {})})
        ).json()
        count += len(page["items"])
        cursor = page.get("next") or ""
        if not cursor:
            break
    return count
