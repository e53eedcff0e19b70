"""How fast the mirror reads a ledger anew, beside the same rows written raw (COPY, executemany) in the same run.

The blocks are whole ones as a ledger makes them; parsing, checking and deriving are part of the replay, not of the floor.
"""

from __future__ import annotations

import sqlite3
import time
from collections import Counter

import pytest
from bench.bench_tools import Replay, show
from kit.chain import START_MS, Authorities, ChainBuilder
from kit.facts import Facts
from msgspec.structs import asdict

from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.mirror import derive as deriving
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.rebuild import digest
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.subscriber import AfterCommit
from wonderland_fabric_gateway.blocks import parse_block

PROOFS = 3_000
PER_BLOCK = 30
ROUNDS = 20
BATCH = 2_000

pytestmark = pytest.mark.bench


@pytest.fixture
def blocks(tmp_path):
    """A chain of whole proofs: request, verdict with its evidence, completion."""
    chain = ChainBuilder(Authorities(tmp_path))
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_uav(), facts.grant())
    waiting = []
    for number in range(PROOFS):
        t_ms = START_MS + 1_000 * number
        waiting += [
            facts.request(number, t_ms=t_ms),
            facts.decide(number, t_ms=t_ms, rounds=ROUNDS),
            facts.complete(number, t_ms=t_ms),
        ]
        if len(waiting) >= PER_BLOCK:
            chain.add(*waiting)
            waiting = []
    if waiting:
        chain.add(*waiting)
    return chain.blocks


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def new_url(request, tmp_path):
    """Names of fresh databases."""
    count = 0

    def new():
        nonlocal count
        count += 1
        if request.param == "sqlite":
            return f"sqlite:///{tmp_path / f'bench-{count}.db'}"
        return request.getfixturevalue("postgres").new_database()

    return new


async def test_replay(blocks, new_url, keep):
    database = Database(new_url())
    await migrate(database)
    status = MirrorStatus()
    rows = []
    mirror = Mirror(
        database,
        Replay(blocks),
        channel="wonderland",
        chaincode="pol",
        status=status,
        clock=lambda: 0,
        batch_transactions=BATCH,
        subscribers=[AfterCommit(rows.append)],
    )
    start = time.perf_counter()
    await mirror.run_until(len(blocks))
    replay_s = time.perf_counter() - start
    transactions = status.transactions
    assert transactions == 3 * PROOFS + 4
    assert status.unread == 0
    start = time.perf_counter()
    parsed = [parse_block(raw) for raw in blocks]
    parse_s = time.perf_counter() - start
    start = time.perf_counter()
    changes = deriving.Changes()
    for block in parsed:
        deriving.derive(block, "pol", changes)
    derive_s = time.perf_counter() - start

    floor = Database(new_url())
    await migrate(floor)
    batches = [tables_of(each) for each in rows]
    start = time.perf_counter()
    await (write_sqlite if floor.is_sqlite else write_postgresql)(floor, batches)
    floor_s = time.perf_counter() - start
    written = Counter({name: len(values) for name, values in final_rows(batches).items()})
    found = {name: each.rows for name, each in (await digest(floor)).tables.items()}
    assert {name: found[name] for name in written} == written
    assert (await digest(database)).tables["verdicts"] == (await digest(floor)).tables["verdicts"]
    await database.close()
    await floor.close()
    kind = "SQLite" if floor.is_sqlite else "PostgreSQL"
    show(
        f"Replay of {transactions} transactions ({ROUNDS} rounds in a proof, {PER_BLOCK} in a block) into {kind}",
        ("what", "transactions/s", "of the replay"),
        [
            (f"the mirror (goal ≥ {'2,000' if floor.is_sqlite else '3,000'})", f"{transactions / replay_s:,.0f}", ""),
            ("floor: the same rows, written raw", f"{transactions / floor_s:,.0f}", f"{floor_s / replay_s:.0%}"),
            ("parsing blocks alone", f"{transactions / parse_s:,.0f}", f"{parse_s / replay_s:.0%}"),
            ("deriving rows alone", f"{transactions / derive_s:,.0f}", f"{derive_s / replay_s:.0%}"),
        ],
    )
    keep(database=kind, tx_per_s=transactions / replay_s, floor_tx_per_s=transactions / floor_s)


def tables_of(changes):
    """One batch: (table, rows, whether rows replace earlier ones)."""
    out = [(rows[0].table, rows, False) for rows in changes.grown if rows]
    out += [(kind.table, list(rows.values()), True) for kind, rows in changes.upserts.items() if rows]
    return [(model.__table__, [asdict(row) for row in rows], replaces) for model, rows, replaces in out]


def final_rows(batches):
    found = {}
    for batch in batches:
        for table, rows, _ in batch:
            keys = [column.name for column in table.primary_key]
            found.setdefault(table.name, {}).update({tuple(row[key] for key in keys): row for row in rows})
    return found


def names_of(table):
    return [column.name for column in table.columns]


def quoted(names):
    return ",".join(f'"{name}"' for name in names)


async def write_sqlite(database, batches):
    """sqlite3's executemany, one transaction a batch, with the durability of ours."""
    await database.close()
    with sqlite3.connect(database.url.database, isolation_level=None) as raw:
        raw.execute("PRAGMA journal_mode=WAL")
        raw.execute("PRAGMA synchronous=FULL")
        for batch in batches:
            raw.execute("BEGIN IMMEDIATE")
            for table, rows, replaces in batch:
                names = names_of(table)
                raw.executemany(
                    f"INSERT {'OR REPLACE' if replaces else ''} INTO {table.name} VALUES ({','.join('?' * len(names))})",
                    [[row[name] for name in names] for row in rows],
                )
            raw.execute("COMMIT")
    raw.close()


async def write_postgresql(database, batches):
    """COPY, one transaction a batch; rows that are written again are copied aside and merged."""
    async with database.engine.connect() as connection:
        driver = (await connection.get_raw_connection()).driver_connection
        for batch in batches:
            async with driver.cursor() as cursor:
                for table, rows, replaces in batch:
                    names = names_of(table)
                    target = f"floor_{table.name}" if replaces else table.name
                    if replaces:
                        await cursor.execute(f"CREATE TEMP TABLE {target} (LIKE {table.name}) ON COMMIT DROP")
                    async with cursor.copy(f"COPY {target} ({quoted(names)}) FROM STDIN") as copy:
                        for row in rows:
                            await copy.write_row([row[name] for name in names])
                    if replaces:
                        keys = [column.name for column in table.primary_key]
                        changed = ",".join(f'"{name}"=excluded."{name}"' for name in names if name not in keys)
                        await cursor.execute(
                            f"INSERT INTO {table.name} SELECT * FROM {target} "
                            f"ON CONFLICT ({quoted(keys)}) DO UPDATE SET {changed}"
                        )
            await driver.commit()
