"""Rows edited in the file while the ledger runs, and put back: nothing is signed or committed on their word."""

import asyncio
import contextlib
import sqlite3
import threading

import pytest

from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import CommitError

KEEP = "CREATE TABLE IF NOT EXISTS kept AS SELECT * FROM state WHERE key = CAST('a' AS BLOB);"
GONE = "DELETE FROM state WHERE key = CAST('a' AS BLOB);"
BACK = f"{GONE} INSERT INTO state SELECT * FROM kept; DROP TABLE kept;"
OLDER = """UPDATE state SET (value, block, position) =
    (SELECT value, block, position FROM history WHERE key = state.key ORDER BY block LIMIT 1)
    WHERE key = CAST('a' AS BLOB);"""
MORE = """INSERT INTO state
    SELECT namespace, CAST('new' AS BLOB), x'31', block, position, NULL FROM state LIMIT 1;"""
SWAP = """UPDATE state SET key = CAST('x' AS BLOB) WHERE key = CAST('a' AS BLOB);
    UPDATE state SET key = CAST('a' AS BLOB) WHERE key = CAST('b' AS BLOB);
    UPDATE state SET key = CAST('b' AS BLOB) WHERE key = CAST('x' AS BLOB);"""
EDITS = {
    "a value": ("a", "UPDATE state SET value = x'39' WHERE key = CAST('a' AS BLOB)", ("increment", "a")),
    "an older row": ("a", OLDER, ("increment", "a")),
    "an older row in a range": ("a", OLDER, ("count_into", "a", "c", "sum")),
    "a row less": ("a", GONE, ("increment", "a")),
    "a row less in a range": ("a", GONE, ("count_into", "a", "c", "sum")),
    "the last row of a range less": ("b", GONE.replace("'a'", "'b'"), ("count_into", "a", "c", "sum")),
    "a row more": ("new", MORE, ("increment", "new")),
    "a row more in a range": ("new", MORE, ("count_into", "a", "z", "sum")),
    "two rows exchanged": ("a", SWAP, ("increment", "a")),
    "a policy": ("a", "UPDATE state SET policy = x'00' WHERE key = CAST('a' AS BLOB)", ("increment", "a")),
}


@pytest.fixture
async def world(world):
    """a = 1, then 2; b = 1."""
    for key, value in (("a", "1"), ("a", "2"), ("b", "1")):
        await world.contract().submit("put", key, value)
    return world


def edit(world, statements):
    with contextlib.closing(sqlite3.connect(world.ledger.directory.database)) as db:
        db.executescript(statements)


async def refused(world, call, key):
    """Named to the client; and from then on nothing is answered from the file."""
    with pytest.raises(LedgerError, match=f"table (state|history), namespace pol, key '{key}'.*not what this ledger"):
        await call
    assert "Restore the ledger's directory from a copy" in world.chain.trouble
    with pytest.raises(LedgerError, match="not what this ledger wrote"):
        await world.contract().evaluate("get", "b")
    with pytest.raises(LedgerError, match="not what this ledger wrote"):
        await world.contract().submit("put", "c", "1")


async def test_a_status_laundered_through_an_endorsement(world):
    """Edited, endorsed, put back, submitted: the version read is the one that is there at the commit."""
    edit(world, KEEP + "UPDATE state SET value = x'39' WHERE key = CAST('a' AS BLOB)")
    with pytest.raises(LedgerError, match="key 'a': not what this ledger wrote"):
        transaction = await world.contract().propose("increment", "a").endorse()
        edit(world, BACK)
        status = await (await transaction.submit()).status()
        pytest.fail(f"committed as {status}")


@pytest.mark.parametrize(("key", "statements", "call"), EDITS.values(), ids=EDITS.keys())
async def test_an_edited_row_is_not_endorsed(world, key, statements, call):
    edit(world, statements)
    await refused(world, world.contract().propose(*call).endorse(), key)


@pytest.mark.parametrize(("key", "statements", "call"), EDITS.values(), ids=EDITS.keys())
async def test_an_edited_row_is_not_committed_on(world, key, statements, call):
    """Put in after the endorsement: neither are versions compared with it nor is it written over."""
    transaction = await world.contract().propose(*call).endorse()
    edit(world, statements)
    height = world.chain.height
    await refused(world, (await transaction.submit()).status(), key)
    assert world.chain.height == height


async def test_an_edited_row_that_is_only_written_over(world):
    transaction = await world.contract().propose("put", "a", "3").endorse()
    edit(world, "UPDATE state SET value = x'39' WHERE key = CAST('a' AS BLOB)")
    await refused(world, (await transaction.submit()).status(), "a")


@pytest.mark.parametrize(
    "statements",
    [
        "UPDATE history SET value = x'39' WHERE block = 1",
        "UPDATE history SET tx_id = 'x' WHERE block = 2",
        "DELETE FROM history WHERE block = 1",
        "INSERT INTO history SELECT namespace, key, block, 7, tx_id, timestamp_ms, value FROM history WHERE block = 1",
    ],
)
async def test_an_edited_history_is_not_read(world, statements):
    edit(world, statements)
    await refused(world, world.contract().evaluate("history", "a"), "a")


async def test_a_row_put_back_before_anybody_read_it_harms_nobody(world):
    edit(world, KEEP + GONE)
    edit(world, BACK)
    assert await world.contract().submit("increment", "a")
    assert await world.contract().evaluate("get", "a") == b"3"


async def test_reads_while_blocks_are_written_are_not_taken_for_edits(world):
    """Keys put, deleted and read in ranges at once, for many blocks."""

    async def work(number):
        for index in range(12):
            with contextlib.suppress(CommitError):
                await world.contract().submit(("put", "delete")[index % 2], f"k{number % 3}", *("1",) * (1 - index % 2))
            await world.contract().evaluate("range", "", "")
            await world.contract().evaluate("history", f"k{number % 3}")

    await asyncio.gather(*(work(number) for number in range(8)))
    assert world.chain.trouble == ""


async def test_an_edit_found_while_a_block_is_written_still_stops_the_ledger(world, monkeypatch):
    """The block that is on its way is kept; the halt is not taken for a disk that is well again."""
    ready, go = threading.Event(), threading.Event()
    commit = world.chain.writer.commit

    def slow(number):
        ready.set()
        assert go.wait(20)
        commit(number)

    transaction = await world.contract().propose("put", "c", "1").endorse()
    monkeypatch.setattr(world.chain.writer, "commit", slow)
    # The writer holds the file: the edit is in what the reader is held against.
    submitted = await transaction.submit()
    await asyncio.to_thread(ready.wait, 20)
    rows = world.chain.reader._rows
    monkeypatch.setitem(rows._state, ("pol", b"a"), 1)
    with pytest.raises(LedgerError, match="not what this ledger wrote"):
        await world.contract().evaluate("get", "a")
    go.set()
    with contextlib.suppress(LedgerError):
        await submitted.status()
    await asyncio.sleep(0.2)
    assert "not what this ledger wrote" in world.chain.trouble
