"""Two backends on one database, as processes on a real ledger: one is the leader, the other one takes over."""

from __future__ import annotations

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import replace

import httpx
import psycopg
import pytest
from kit.backend_process import ledger, ready, run, signed_in, start, stop
from kit.proof_actors import HERE, ROUNDS, Actors
from kit.proof_world import World
from sqlalchemy.engine import make_url

from wonderland_backend.http.times import now_ms
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration

__all__ = ["ledger"]

ELSEWHERE = (HERE[0] + 4_200, HERE[1], HERE[2])
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
pytestmark = [
    pytest.mark.timeout(120),
    pytest.mark.parametrize("database_url", BOTH, indirect=True),
]


@pytest.fixture
def database(database_url):
    """Where both of them work; made by the first."""
    return database_url


@asynccontextmanager
async def served(tmp_path, database):
    process = await start(tmp_path, database=database)
    try:
        yield process, await ready(process)
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def eventually(http, path, is_so):
    async with asyncio.timeout(60):
        while True:
            answer = await http.get(path)
            if answer.status_code == 200 and (found := is_so(answer.json())):
                return found
            await asyncio.sleep(0.05)


@pytest.fixture
async def liars(ledger, tmp_path):
    """Proves drone after drone, each 4.2 m from where it says."""
    names = ("uav-0", "uav-1")
    administration = DirectoryAdministration(ledger.directory)
    for name, role in (("pad-0", "pad"), *((name, "uav") for name in names)):
        administration.enrol(name, role=role, pol_id=name)
    known = Connection.load(tmp_path / "ledger" / "connection.json")
    async with ledger.connection.open_channel() as channel:
        actors = Actors(replace(ledger.connection, identities=known.identities), channel)
        lie = World(seed=5).evidence(lambda _: ELSEWHERE, lambda _: HERE, rounds=ROUNDS, broadcast=lambda _: HERE)
        actors.evidence = [lie]
        await actors.register(now_ms(), pads=1, drones=len(names))
        prepared = iter(await actors.prepare(len(names), pads=1, drones=len(names)))

        async def prove():
            drone = next(prepared)
            _, verdict = await actors.prove(drone, 0)
            assert verdict["outcome"] == "refuted"
            return drone.uav_id

        yield prove


async def test_alerts_outlive_the_backend_that_raised_them(tmp_path, liars, database):
    """Acknowledged on one, there on the other; what the ledger said in between is missing on none."""

    def of(uav_id):
        return lambda page: next((each for each in page["items"] if each["uav_id"] == uav_id), None)

    async with served(tmp_path, database) as (first, told), served(tmp_path, database) as (second, waits):
        assert told["ready"] is True
        assert waits["standby"] is True
        async with signed_in(told) as http:
            alert = await eventually(http, "/api/v1/alerts", of(await liars()))
            act = {"act": "acknowledge", "revision": alert["revision"], "note": "called the pilot"}
            noted = await http.post(f"/api/v1/alerts/{alert['alert_id']}/acts", json=act)
            assert noted.status_code == 200, noted.text

        async with httpx.AsyncClient(base_url=waits["url"], trust_env=False) as http:
            for path in ("/", "/api/v1/health", "/api/v1/alerts"):
                answer = await http.get(path)
                assert (answer.status_code, answer.json()["type"]) == (503, "urn:wonderland:problem:standby")
                assert int(answer.headers["retry-after"]) > 0
        code, out, _ = await run("health", "--at", waits["url"])
        assert (code, "standby" in out) == (0, True)

        first.kill()
        after = await liars()
        took_over = await ready(second)
        assert took_over["url"] == waits["url"]
        async with signed_in(took_over) as http:
            kept = (await http.get(f"/api/v1/alerts/{alert['alert_id']}")).json()
            assert [act["note"] for act in kept["acts"] if act["act"] == "acknowledge"] == ["called the pilot"]
            assert await eventually(http, "/api/v1/alerts", of(after))
            status = (await http.get("/api/v1/status")).json()
            assert status["ledger"]["halted"] is None


async def test_who_stands_by_stops_when_told(tmp_path, ledger, database):
    async with served(tmp_path, database) as (first, _), served(tmp_path, database) as (second, _):
        assert await stop(second) == 0
        assert await stop(first) == 0


async def test_nobody_rebuilds_beneath_a_running_backend(tmp_path, ledger, database):
    connection = str(tmp_path / "ledger" / "connection.json")
    async with served(tmp_path, database) as (process, _):
        code, _, said = await run("rebuild", "--database", database, "--connection", connection)
        assert code == 1
        assert "stop it" in said
        assert await stop(process) == 0
    assert (await run("rebuild", "--database", database, "--connection", connection))[0] == 0


async def test_who_lost_the_lock_ends_and_says_so(tmp_path, ledger, database):
    url = make_url(database)
    if url.get_backend_name() == "sqlite":
        pytest.skip("a locked file is lost with its process only")
    async with served(tmp_path, database) as (first, _), served(tmp_path, database) as (second, _):
        async with await psycopg.AsyncConnection.connect(
            url.render_as_string(hide_password=False), autocommit=True
        ) as connection:
            await connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_locks WHERE locktype = 'advisory' AND granted "
                "AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
            )
        assert json.dumps((await ready(second))["ready"]) == "true"
        _, said = await asyncio.wait_for(first.communicate(), 30)
        assert first.returncode == 1
        assert "not the leader" in said.decode()
