"""Rows that somebody changed behind the ledger's back are found and named, and nothing stops."""

from __future__ import annotations

import re

import pytest
from kit.chain import Source
from kit.facts import Facts
from sqlalchemy import text

from wonderland_backend.alerts.watch import row_conditions
from wonderland_backend.mirror import row_check
from wonderland_backend.mirror.follow import Mirror
from wonderland_backend.mirror.row_check import RowCheck, Unhurried
from wonderland_backend.mirror.status import MirrorStatus

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)


@pytest.fixture
async def checked(database, chain, clock):
    """A mirrored chain with a proof, and its check."""
    facts = Facts()
    chain.add(facts.put_pad(), facts.put_uav(), facts.grant())
    chain.add(facts.request(1), facts.request(2))
    chain.add(facts.decide(1, rounds=20), facts.decide(2, rounds=20))
    chain.add(facts.complete(1))
    status = MirrorStatus()
    named = {"channel": "wonderland", "chaincode": "pol", "status": status, "clock": clock}
    await Mirror(database, Source(chain), **named).run_until(chain.height)
    return RowCheck(database, Source(chain), **named, transactions_per_s=10_000), status


async def change(database, statement):
    async with database.write() as connection:
        found = await connection.execute(text(statement))
        assert found.rowcount == 1, statement


@both
async def test_what_nobody_touched_is_equal_and_when_is_said(checked, database, chain, clock):
    check, status = checked
    await check.once()
    assert (status.rows_differ, status.rows_checked_height) == ((), chain.height)
    assert status.rows_checked_ms == clock()
    assert not list(row_conditions(status, clock()))


ONE = "(SELECT session_id FROM verdicts ORDER BY session_id LIMIT 1)"

ONE_MORE = """
INSERT INTO blocks
SELECT number + 100, header_hash, previous_hash, data_hash, t_ms, transactions, valid, size_bytes
FROM blocks WHERE number = 1
"""


@both
@pytest.mark.parametrize(
    ("statement", "said"),
    [
        (f"UPDATE verdicts SET outcome = 'refuted' WHERE session_id = {ONE}", "verdicts .*: another outcome"),
        (f"UPDATE verdicts SET record = '{{}}' WHERE session_id = {ONE}", "verdicts .*: another record"),
        (f"DELETE FROM verdicts WHERE session_id = {ONE}", "verdicts .*: missing here"),
        (ONE_MORE, "blocks 101: not on the ledger"),
        ("UPDATE transactions SET validation_code = 11 WHERE block = 3 AND tx_index = 0", "transactions 3/0: another"),
        ("DELETE FROM events WHERE block = 3 AND tx_index = 1", "events 3/1: missing here"),
        ("UPDATE pads SET record = record || ' '", "pads .*: another record"),
    ],
)
async def test_a_changed_row_is_found_and_named(checked, database, clock, statement, said):
    check, status = checked
    await change(database, statement)
    await check.once()
    (row,) = status.rows_differ
    assert pytest.approx(status.rows_checked_ms) == clock()
    assert re.match(said, row), row
    (condition,) = row_conditions(status, clock())
    assert (condition.kind, condition.facts) == ("rows_differ", {"row": row})


async def test_the_mirror_goes_on_meanwhile(checked, database, chain, clock):
    check, status = checked
    await change(database, f"UPDATE verdicts SET outcome = 'refuted' WHERE session_id = {ONE}")
    facts = Facts()
    chain.add(facts.request(9))
    named = {"channel": "wonderland", "chaincode": "pol", "status": status, "clock": clock}
    await Mirror(database, Source(chain), **named).run_until(chain.height)
    await check.once()
    assert len(status.rows_differ) == 1
    assert status.halted is None
    assert status.rows_checked_height == chain.height


async def test_before_the_first_block_there_is_nothing_to_compare(database, chain, clock):
    status = MirrorStatus()
    check = RowCheck(
        database, Source(chain), channel="wonderland", chaincode="pol", status=status, clock=clock, transactions_per_s=1
    )
    await check.once()
    assert status.rows_checked_ms is None


async def test_a_long_ledger_is_read_at_an_easy_pace_before_the_snapshot_is_taken(
    checked, database, chain, clock, monkeypatch
):
    """What came meanwhile, too, until little is left: a snapshot that is held for long is a burden to a database."""
    check, status = checked
    monkeypatch.setattr(row_check, "FEW_BLOCKS", 0)
    paced, real = [], Unhurried.blocks

    async def blocks(self, start):
        paced.append(start)
        if len(paced) == 1:
            chain.add(Facts().request(9))
            named = {"channel": "wonderland", "chaincode": "pol", "status": status, "clock": clock}
            await Mirror(database, Source(chain), **named).run_until(chain.height)
        async for block in real(self, start):
            yield block

    monkeypatch.setattr(Unhurried, "blocks", blocks)
    before = chain.height
    await check.once()
    assert paced == [0, before - 1]
    assert (status.rows_differ, status.rows_checked_height) == ((), before + 1)
