"""How fast the mirror reads a ledger whose every signature it checks, beside the same without."""

from __future__ import annotations

import asyncio
import time
from functools import partial

import pytest
from bench.bench_tools import Replay, show
from kit.embedded import open_world

from wonderland_backend.db.engine import Database
from wonderland_backend.db.migrate import migrate
from wonderland_backend.mirror import store
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.status import MirrorStatus
from wonderland_backend.mirror.verified import VerifiedSource
from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.verification.light_client import LightClient

TRANSACTIONS = 9_000
PER_BLOCK = 30
VALUE = "v" * 2_000

pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]


async def fill(directory):
    """Blocks of a ledger that signs everything."""
    async with open_world(directory, limits=BatchLimits(time_ms=200, count=PER_BLOCK)) as world:
        contract = world.contract()
        for first in range(0, TRANSACTIONS, PER_BLOCK):
            await asyncio.gather(*(contract.submit("put", f"k{first + number}", VALUE) for number in range(PER_BLOCK)))
        height = await world.network().height()
        async with await world.network("mirror").blocks(start_block=0) as stream:
            return [(await anext(stream)).to_bytes() for _ in range(height)]


async def replayed(url, blocks, *, verified):
    database = Database(url)
    await migrate(database)
    source, status = Replay(blocks), MirrorStatus()
    if verified:
        source = VerifiedSource(source, partial(store.endorsement_policies, database))
    mirror = Mirror(
        database,
        source,
        channel="wonderland",
        chaincode="pol",
        status=status,
        clock=lambda: 0,
        batch_transactions=2_000,
    )
    start = time.perf_counter()
    await mirror.run_until(len(blocks))
    took_s = time.perf_counter() - start
    await database.close()
    return status.transactions / took_s


async def test_replay_with_every_signature_checked(tmp_path):
    blocks = await fill(tmp_path / "ledger")
    plain = await replayed(f"sqlite:///{tmp_path}/plain.db", blocks, verified=False)
    verified = await replayed(f"sqlite:///{tmp_path}/verified.db", blocks, verified=True)
    parsed = [parse_block(raw) for raw in blocks[:60]]
    client = LightClient.begin(parsed[0])
    start = time.perf_counter()
    for block in parsed[1:]:
        client.take(block)
    alone = sum(len(block.transactions) for block in parsed[1:]) / (time.perf_counter() - start)
    show(
        f"Replay of {TRANSACTIONS} signed transactions ({PER_BLOCK} in a block) into SQLite",
        ("what", "transactions/s", "of the mirror without"),
        [
            ("the mirror, nothing checked", f"{plain:,.0f}", ""),
            ("every signature checked, in other processes", f"{verified:,.0f}", f"{verified / plain:.0%}"),
            ("checking alone, in one process", f"{alone:,.0f}", f"{alone / plain:.0%}"),
        ],
    )
    assert verified > 500
