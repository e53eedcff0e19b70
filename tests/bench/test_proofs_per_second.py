"""Whole proofs, many at a time: request, countersignature, verdict, mirrored into the database; and what memory does.

Ledger, backend and the clients are three processes, as in life, on the cores that this machine has. Prepared are only
the drones, the pads, their prekeys and the ranges; every signature, endorsement and commit is made while the clock runs.
"""

from __future__ import annotations

import asyncio
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

import httpx
import psutil
import pytest
from bench_tools import p50, p95, show
from cryptography.hazmat.primitives.asymmetric import ec
from tests_world import START_MS, World

from edge_agent.geodesy import frame_at
from wonderland.ledger.embedded.administration import DirectoryAdministration
from wonderland.ledger.embedded.directory import LedgerDirectory
from wonderland.ledger.gateway import Gateway
from wonderland.ledger.signing import raw_from_der
from wonderland.proofs import encoding
from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.keys import public_bytes
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.pads import OfferedPrekey
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.statement import statement

FULL = os.environ.get("WONDERLAND_BENCH_FULL") == "1"
PROOFS = 10_000 if FULL else 1_500
PADS = 4
DRONES = 8
AT_ONCE = 32
ROUNDS = 20
FRAME = frame_at(604_518_000, 222_666_000, 30_000)
HERE = (3_000, 6_000, 4_000)
DAY_MS = 86_400_000
SAMPLES = 20

pytestmark = pytest.mark.bench


@dataclass(frozen=True)
class Prepared:
    """A session that only has to be asked for: which prekey of which pad, and the drone's own key."""

    pad_id: str
    prekey_id: str
    uav_id: str
    uav_key: str


class Actors:
    """Pads and drones with their contracts and the ranges that they will bring."""

    def __init__(self, connection, channel):
        self._connection = connection
        self._channel = channel
        self._contracts = {}
        world = World(seed=11)
        self.commissioning = replace(world.commissioning, frame=FRAME)
        lat_e7, lon_e7, height_mm = to_wgs84(FRAME, *HERE)
        self.here = {"lat_e7": lat_e7, "lon_e7": lon_e7, "height_mm": height_mm}
        self.claim = replace(world.claim(HERE, START_MS), **self.here)
        self.evidence = [
            world.evidence(lambda t: HERE, lambda t: HERE, rounds=ROUNDS, broadcast=lambda t: HERE) for _ in range(16)
        ]
        self.signers = {}

    def contract(self, name):
        if name not in self._contracts:
            gateway = Gateway(self._channel, self._connection.identity(name), self._connection.signer(name))
            self._contracts[name] = gateway.network(self._connection.channel).contract(self._connection.chaincode)
            self.signers[name] = self._connection.signer(name)
        return self._contracts[name]

    async def submit(self, name, function, argument):
        return await self.contract(name).submit_with_retry(function, argument.encode())

    async def register(self, now_ms):
        for index in range(PADS):
            pad_id = f"pad-{index}"
            await self.submit(
                "pad_operator",
                "RegisterPad",
                tx.RegisterPad(
                    pad_id=pad_id,
                    name=pad_id,
                    operator_id="bench",
                    lat_e7=FRAME.lat_e7,
                    lon_e7=FRAME.lon_e7,
                    height_mm=FRAME.height_mm,
                ),
            )
            await self.submit(
                "pad_operator", "CommissionPad", tx.CommissionPad(pad_id=pad_id, commissioning=self.commissioning)
            )
        await self.submit(
            "admin",
            "SetPolicy",
            tx.SetPolicy(pad_id="*", action="*", policy=Policy(min_assurance=2, max_claim_age_ms=60_000)),
        )
        for index in range(DRONES):
            uav_id = f"uav-{index}"
            await self.submit(
                "fleet_operator",
                "RegisterUav",
                tx.RegisterUav(uav_id=uav_id, operator_id="bench", registration="FIN87astrdge12k8", model="Bench"),
            )
            await self.submit(
                "fleet_operator",
                "RecordMaintenance",
                tx.RecordMaintenance(
                    uav_id=uav_id, performed_ms=now_ms - DAY_MS, valid_until_ms=now_ms + DAY_MS, work="Inspection"
                ),
            )
            await self.submit(
                "admin",
                "GrantAuthorisation",
                tx.GrantAuthorisation(
                    authorisation_id="bench",
                    uav_id=uav_id,
                    pad_id="*",
                    actions=("land",),
                    valid_from_ms=now_ms - DAY_MS,
                    valid_until_ms=now_ms + DAY_MS,
                ),
            )

    async def prepare(self, count):
        """Prekeys on the ledger, a hundred a transaction, and a key for each drone's session."""
        # A few keys serve for all: what is new on the ledger is the prekey's id, and points cost time to make.
        points = [encoding.to_base64url(public_bytes(ec.generate_private_key(ec.SECP256R1()))) for _ in range(100)]
        each = -(-count // PADS)
        for pad in range(PADS):
            for first in range(0, each, 100):
                keys = tuple(
                    OfferedPrekey(prekey_id=f"k{number}", public_key=points[number % 100])
                    for number in range(first, min(first + 100, each))
                )
                await self.submit(f"pad-{pad}", "PublishPrekeys", tx.PublishPrekeys(pad_id=f"pad-{pad}", prekeys=keys))
        return [
            Prepared(f"pad-{number % PADS}", f"k{number // PADS}", f"uav-{number % DRONES}", points[number % 100])
            for number in range(count)
        ]

    async def prove(self, prepared, number):
        """Steps 1, 6 and 7; returns milliseconds and the verdict."""
        start = time.perf_counter()
        now_ms = time.time_ns() // 1_000_000
        request = tx.RequestProof(
            pad_id=prepared.pad_id,
            action="land",
            prekey_id=prepared.prekey_id,
            uav_key=prepared.uav_key,
            claim=replace(self.claim, t_ms=now_ms),
        )
        done = await self.contract(prepared.uav_id).submit("RequestProof", request.encode())
        session = encoding.decode(done.payload)
        evidence = self.measured(number, now_ms)
        said = statement(done.tx_id, session["transcript_sha256"], evidence.ranges, evidence.claims)
        signature = encoding.to_base64url(raw_from_der(self.signers[prepared.uav_id](said)))
        argument = tx.SubmitProof(session_id=done.tx_id, evidence=replace(evidence, uav_signature=signature))
        done = await self.contract(prepared.pad_id).submit("SubmitProof", argument.encode())
        return (time.perf_counter() - start) * 1e3, encoding.decode(done.payload)

    def measured(self, number, now_ms):
        """One of the prepared sets of ranges, as if they had just been measured."""
        evidence = self.evidence[number % len(self.evidence)]
        by_ms = now_ms - evidence.ranges.t_ms[-1]
        return replace(
            evidence,
            ranges=replace(evidence.ranges, t_ms=tuple(t_ms + by_ms for t_ms in evidence.ranges.t_ms)),
            claims=tuple(replace(self.claim, t_ms=claim.t_ms + by_ms) for claim in evidence.claims),
            broadcast=tuple(replace(each, t_ms=each.t_ms + by_ms, **self.here) for each in evidence.broadcast),
        )


class Memory:
    """Resident memory (MB) and CPU time (s) of some processes."""

    def __init__(self, **pids):
        self._processes = {name: psutil.Process(pid) for name, pid in pids.items()}
        self.rss_mb = {name: [] for name in pids}

    def sample(self):
        for name, process in self._processes.items():
            self.rss_mb[name].append(process.memory_info().rss / 1e6)

    def cpu_s(self):
        return {name: sum(process.cpu_times()[:2]) for name, process in self._processes.items()}


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def database_url(request, tmp_path):
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'bench.db'}"
    return request.getfixturevalue("postgres").new_database()


async def test_complete_proofs(start_ledger, processes, database_url, keep):
    connection, ledger = await start_ledger()
    home = Path(ledger.ready["connection"]).parent
    administration = DirectoryAdministration(LedgerDirectory(home))
    for index in range(PADS):
        administration.enrol(f"pad-{index}", role="pad", pol_id=f"pad-{index}")
    for index in range(DRONES):
        administration.enrol(f"uav-{index}", role="uav", pol_id=f"uav-{index}")
    connection = type(connection).load(home)
    options = ("--connection", str(home), "--database", database_url, "--listen", "127.0.0.1:0", "--json")
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
        await actors.register(time.time_ns() // 1_000_000)
        prepared = await actors.prepare(PROOFS + AT_ONCE)
        await asyncio.gather(*(actors.prove(each, 0) for each in prepared[:AT_ONCE]))
        await mirrored(http, await network.height())
        memory = Memory(ledger=ledger.handle.pid, backend=backend.handle.pid, clients=os.getpid())
        took, outcomes = [], []
        waiting = iter(list(enumerate(prepared[AT_ONCE:])))
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
        await asyncio.gather(*(work() for _ in range(AT_ONCE)))
        committed_s = time.perf_counter() - start
        height = await network.height()
        await mirrored(http, height)
        whole_s = time.perf_counter() - start
        cpu = {name: value - cpu_before[name] for name, value in memory.cpu_s().items()}
        kept = await count_verdicts(http, PROOFS + AT_ONCE)
    assert outcomes == [("verified", "granted")] * PROOFS
    assert kept == PROOFS + AT_ONCE
    kind = database_url.partition(":")[0]
    show(
        f"{PROOFS} complete proofs ({ROUNDS} rounds × 4 anchors), {AT_ONCE} at a time, {kind}",
        ("figure", "value", "goal"),
        [
            ("proofs/s until in the database", f"{PROOFS / whole_s:.0f}", "≥ 150"),
            ("proofs/s until committed", f"{PROOFS / committed_s:.0f}", ""),
            ("the mirror after the last commit", f"{(whole_s - committed_s) * 1e3:.0f} ms behind", ""),
            ("one proof, p50 / p95", f"{p50(took):.0f} / {p95(took):.0f} ms", ""),
            ("transactions in a block", f"{2 * PROOFS / (height - blocks):.1f}", ""),
            *((f"CPU of {name}", f"{value / PROOFS * 1e3:.2f} ms/proof", "") for name, value in cpu.items()),
            *(
                (
                    f"memory of {name}",
                    f"{values[0]:.0f} → {values[len(values) // 2]:.0f} → {values[-1]:.0f} MB",
                    "flat" if name != "clients" else "",
                )
                for name, values in memory.rss_mb.items()
            ),
        ],
    )
    keep(
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
