"""History by the number of rows: what a query costs beside a bare indexed SELECT, and what it costs to write them.

    pytest tests/bench/test_history.py -m bench -s -n 0 --rows 10000000     PostgreSQL; --rows 1000000 is the default

SQLite is measured up to a million rows. Rows are positions, one a second of each of 400 drones in the air, in a busy
hour a day; 1,000 drones take turns. So more rows are more days, as in life, and the map is as full at each size.
Beside each question's time stands the processor's (ours and the database server's), because other work may share it.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import random
import time
from pathlib import Path

import pytest
from bench.bench_tools import p50, p95, show
from sqlalchemy import insert, select, text

from wonderland_backend.db import bulk, partitions
from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.db.tables.reported import LatestTrackRow, TrackRow
from wonderland_backend.person import ALL, Person
from wonderland_backend.replay.queries.events import Span, _tracks
from wonderland_backend.replay.queries.moment import Moment, contents_at
from wonderland_backend.tracks import queries

pytestmark = [pytest.mark.bench, pytest.mark.timeout(7_200)]
DAY_MS = 86_400_000
WEEK_MS = 7 * DAY_MS
START_MS = 1_800_000_000_000 // DAY_MS * DAY_MS
HOUR_S = 3_600
DRONES = 1_000
IN_THE_AIR = 400
QUERIES = 100
CHUNK = 20_000
MINUTES = 10
PERSON = Person("bench", "Bench", ("admin",), "", "link", 0, 0, "")


def time_of(second):
    """When the busy hours' second of this number is."""
    day, rest = divmod(second, HOUR_S)
    return START_MS + day * DAY_MS + 12 * HOUR_S * 1_000 + rest * 1_000


def drone_of(second, place):
    """Who is in the air then, at one of so many places."""
    return f"uav-{(second // HOUR_S * 150 + place) % DRONES}"


def row(number):
    second, place = divmod(number, IN_THE_AIR)
    t_ms = time_of(second) + place * 2
    uav_id = drone_of(second, place)
    body = {
        "uav_id": uav_id, "lat_e7": 604_518_000 + number % 9_999, "lon_e7": 222_666_000, "height_mm": 42_000,
        "accuracy_mm": 3_000, "speed_mm_s": 12_000, "track_cdeg": 9_000, "transport": "wifi_beacon", "t_ms": t_ms,
        "pad_id": f"pad-{number % 7}", "verified": False,
    }  # fmt: skip
    shown = {"uav_id": uav_id, "pad_id": body["pad_id"], "t_ms": t_ms, "received_ms": t_ms + 40}
    return shown | {"body": json.dumps(body, separators=(",", ":"))}


async def fill(database, before, total):
    """Rows up to a total, as the intake writes them; the seconds that writing took, and the bare insert's."""
    writing = 0.0
    for begin in range(before, total, CHUNK):
        rows = [row(number) for number in range(begin, min(total, begin + CHUNK))]
        started = time.perf_counter()
        async with database.write() as connection:
            await bulk.append(connection, TrackRow, rows)
        writing += time.perf_counter() - started
    return writing


async def bare_insert(database, count=CHUNK):
    """Seconds of the same rows into a table without any index."""
    rows = [row(number) for number in range(count)]
    async with database.write() as connection:
        await connection.exec_driver_sql("DROP TABLE IF EXISTS bare_tracks")
        await connection.exec_driver_sql(
            "CREATE TABLE bare_tracks (uav_id varchar(128), pad_id varchar(128), t_ms bigint, received_ms bigint, body text)"
        )
    bare = TrackRow.__table__.to_metadata(type(TrackRow.metadata)(), name="bare_tracks")
    started = time.perf_counter()
    async with database.write() as connection:
        if database.is_sqlite:
            await connection.execute(insert(bare), rows)
        else:
            await bulk._copy(connection, "bare_tracks", rows)
    return time.perf_counter() - started


def worked_s(server):
    """Processor time of this process and of the database's server, with what it has started (Linux)."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat") if server else ():
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if server in {stat.parent.name, fields[1]}:
                ticks += int(fields[11]) + int(fields[12])
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


async def measured(ask, server):
    """Milliseconds of each of so many questions, and of the processor for one of them."""
    times = []
    began = worked_s(server)
    for _ in range(QUERIES):
        started = time.perf_counter()
        await ask()
        times.append((time.perf_counter() - started) * 1_000)
    return times, (worked_s(server) - began) * 1_000 / QUERIES


async def questions(database, total, dice, server=None):
    """Each question's times: the floor, a drone's ten minutes, the map at a moment, ten steps of a film."""

    def second():
        return dice.randrange(total // IN_THE_AIR)

    async def bare():
        # What an index costs at all: one row by the same index, without any of ours around it.
        then = second()
        t_ms = time_of(then)
        async with database.read() as session:
            uav_id = drone_of(then, dice.randrange(IN_THE_AIR))
            query = select(TrackRow.body).where(TrackRow.uav_id == uav_id, TrackRow.t_ms >= t_ms)
            query = query.where(TrackRow.received_ms.between(t_ms, t_ms + 3_600_000)).order_by(TrackRow.t_ms).limit(1)
            await session.execute(query)

    async def history():
        then = second()
        t_ms = time_of(then)
        async with database.read() as session:
            await queries.history(
                session,
                ALL,
                drone_of(then, dice.randrange(IN_THE_AIR)),
                since_ms=t_ms,
                until_ms=t_ms + MINUTES * 60_000,
                limit=501,
            )

    found = []

    async def state():
        t_ms = time_of(second())
        async with database.read() as session:
            found.append(len((await contents_at(session, Moment(t_ms, -1), PERSON)).tracks))

    async def film():
        t_ms = time_of(second())
        async with database.read() as session:
            await _tracks(session, Span(t_ms, t_ms + 10_000, 1_000), ALL)

    results = {}
    for name, ask in (("bare row", bare), ("drone, 10 min", history), ("map at a moment", state), ("film, 10 s", film)):
        await ask()
        results[name] = await measured(ask, server)
    return results, p50(found)


async def run(url, sizes, server=None):
    database = Database(url)
    rows, before = [], 0
    try:
        await migrate(database)
        async with database.write() as connection:
            for day in range(8):
                await partitions.make_ahead(connection, START_MS + day * DAY_MS)
            await bulk.append(connection, LatestTrackRow, [
                {"uav_id": f"uav-{number}", "pad_id": "pad-0", "t_ms": START_MS + WEEK_MS, "body": "{}"}
                for number in range(DRONES)
            ])  # fmt: skip
        bare_s = await bare_insert(database)
        for total in sizes:
            async with database.write() as connection:
                await connection.execute(text("DELETE FROM tracks" if database.is_sqlite else "TRUNCATE tracks"))
            before = 0
            writing = await fill(database, before, total)
            async with database.engine.connect() as connection:
                await connection.execution_options(isolation_level="AUTOCOMMIT")
                await connection.exec_driver_sql("ANALYZE" if database.is_sqlite else "VACUUM ANALYZE tracks")
            # As the backend does when it is ready: what was imported is not collected again and again.
            gc.collect()
            gc.freeze()
            results, shown = await questions(database, total, random.Random(7), server)
            asked = [f"{p50(times):.1f} / {p95(times):.1f} ({work:.1f})" for times, work in results.values()]
            per_track = f"{results['map at a moment'][1] / max(1, shown) * 1_000:.0f} µs of {shown}"
            written = (f"{writing / total * 1e6:.1f}", f"{writing / total / (bare_s / CHUNK):.2f}")
            rows.append((f"{total:,}", *written, *asked, per_track))
            assert all(len(times) == QUERIES for times, _ in results.values())
    finally:
        await database.close()
    return rows


HEADER = (
    "rows", "write µs/row", "× no index", "bare row p50/p95 ms (processor)", "drone 10 min", "map at a moment",
    "film 10 s", "processor per track on the map",
)  # fmt: skip


def sizes_up_to(most):
    return [size for size in (100_000, 1_000_000, 10_000_000) if size <= most] or [most]


def test_sqlite(tmp_path, pytestconfig):
    """Up to a million rows."""
    most = min(1_000_000, pytestconfig.getoption("--rows"))
    show("History, SQLite", HEADER, asyncio.run(run(f"sqlite:///{tmp_path / 'history.db'}", sizes_up_to(most))))


def test_postgresql(postgres, pytestconfig):
    """Partitioned by day."""
    server = (postgres.data / "postmaster.pid").read_text().split()[0]
    sizes = sizes_up_to(pytestconfig.getoption("--rows"))
    rows = asyncio.run(run(postgres.new_database(), sizes, server))
    show("History, PostgreSQL, partitioned by day", HEADER, rows)
