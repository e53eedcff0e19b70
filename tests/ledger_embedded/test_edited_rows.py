"""Rows of the stored ledger edited by somebody without its seal: no start from any of them."""

import asyncio
import contextlib
import shutil
import sqlite3

import pytest
from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.commit_hash import commit_hash_of, expected_commit_hash
from wonderland_fabric_gateway.embedded.errors import DirectoryError, LedgerCorruptedError
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import CommitError
from wonderland_fabric_gateway.transactions import ValidationCode

HISTORY = "(namespace, key, block, position, tx_id, timestamp_ms, value)"
EDITS = {
    "a value": ("state", "a", "UPDATE state SET value = x'39' WHERE key = CAST('a' AS BLOB)"),
    "a version": ("state", "a", "UPDATE state SET position = 1 WHERE key = CAST('a' AS BLOB)"),
    "a row of the state less": ("state", "a", "DELETE FROM state WHERE key = CAST('a' AS BLOB)"),
    "a row of the state more": (
        "state",
        "new",
        "INSERT INTO state SELECT namespace, CAST('new' AS BLOB), value, block, position, policy FROM state LIMIT 1",
    ),
    "a policy less": ("state", "guarded", "UPDATE state SET policy = NULL WHERE key = CAST('guarded' AS BLOB)"),
    "another policy": ("state", "guarded", "UPDATE state SET policy = x'00' WHERE key = CAST('guarded' AS BLOB)"),
    "a policy more": (
        "state",
        "a",
        "UPDATE state SET policy = (SELECT policy FROM state WHERE policy NOT NULL) WHERE key = CAST('a' AS BLOB)",
    ),
    "a code": ("tx", "", "UPDATE tx SET code = 11 WHERE block = 2"),
    "a place": ("tx", "", "UPDATE tx SET block = 1 WHERE block = 2"),
    "a transaction less": ("tx", "", "DELETE FROM tx WHERE block = 0"),
    "a transaction more": ("tx", "made-up", "INSERT INTO tx VALUES ('made-up', 1, 1, 0)"),
    "an old value": ("history", "a", "UPDATE history SET value = x'39' WHERE block = 1"),
    "an old value's author": ("history", "a", "UPDATE history SET tx_id = 'x' WHERE block = 1"),
    "an old value less": ("history", "a", "DELETE FROM history WHERE block = 1"),
    "an old value more": ("history", "z", f"INSERT INTO history {HISTORY} VALUES ('pol', x'7a', 1, 0, 'x', 1, x'39')"),
    "a header's hash": ("block", "2", "UPDATE block SET header_hash = zeroblob(32) WHERE number = 2"),
    "another setting": ("meta", "more", "INSERT INTO meta VALUES ('more', x'00')"),
}
# The last block goes, and the state is put back to what it was before: what is left is a whole chain.
CUT_OFF = """
    DELETE FROM block WHERE number = 4; DELETE FROM tx WHERE block = 4; DELETE FROM history WHERE block = 4;
    UPDATE state SET (value, block, position) =
      (SELECT value, block, position FROM history WHERE key = state.key ORDER BY block DESC LIMIT 1) WHERE block = 4;
"""


@pytest.fixture
async def ledger(tmp_path, open_world):
    """a = 1, then 2; a key with a policy of its own; a = 3. Stopped."""
    async with open_world(tmp_path / "ledger") as world:
        contract = world.contract()
        await contract.submit("put", "a", "1")
        await contract.submit("put", "a", "2")
        await contract.submit("guard", "guarded", "PadMSP")
        await contract.submit("put", "a", "3")
        assert world.chain.height == 5
    return tmp_path / "ledger"


def edit(ledger, statements, *values):
    with contextlib.closing(sqlite3.connect(ledger / "ledger.sqlite3")) as db:
        db.executescript(statements) if not values else db.execute(statements, values)
        db.commit()


async def refused(open_world, ledger):
    with pytest.raises(LedgerCorruptedError) as caught:
        async with open_world(ledger):
            pass
    return caught.value


def recoded(raw, code, before=b""):
    """A block with another code for its one transaction and, after the block before, the commit hash to it."""
    block = common_pb2.Block.FromString(raw)
    block.metadata.metadata[common_pb2.TRANSACTIONS_FILTER] = bytes((code,))
    new = expected_commit_hash(commit_hash_of(parse_block(before)), parse_block(block.SerializeToString()))
    block.metadata.metadata[common_pb2.COMMIT_HASH] = common_pb2.Metadata(value=new).SerializeToString()
    return block.SerializeToString()


@pytest.mark.parametrize(("table", "key", "statements"), EDITS.values(), ids=EDITS.keys())
async def test_an_edited_row_is_named_and_nothing_is_served(ledger, open_world, table, key, statements):
    edit(ledger, statements)
    error = await refused(open_world, ledger)
    assert error.table == table
    assert key in error.key
    assert "Restore the ledger's directory from a copy" in str(error)


async def test_a_whole_ledger_starts_again_and_goes_on(ledger, open_world):
    for number in range(5, 8):
        async with open_world(ledger) as world:
            assert (await world.contract().submit("put", "a", str(number))).block_number == number


async def test_the_last_block_cut_off_with_all_its_rows(ledger, open_world):
    edit(ledger, CUT_OFF)
    error = await refused(open_world, ledger)
    assert "ends with block 3, but was sealed after block 4: its end has been cut off" in str(error)


async def test_a_cut_off_end_is_not_hidden_by_removing_the_seal(ledger, open_world):
    edit(ledger, CUT_OFF + "DELETE FROM meta WHERE name = 'seal'; PRAGMA user_version = 2;")
    assert "seal has been removed" in str(await refused(open_world, ledger))


async def test_a_cut_off_end_is_not_hidden_by_the_seals_number(ledger, open_world):
    edit(
        ledger,
        CUT_OFF + "UPDATE meta SET value = CAST(x'0000000000000003' || substr(value, 9) AS BLOB) WHERE name = 'seal'",
    )
    assert "not the ledger's seal" in str(await refused(open_world, ledger))


async def test_two_blocks_swapped(ledger, open_world):
    edit(
        ledger,
        "UPDATE block SET number = -1 WHERE number = 1; UPDATE block SET number = 1 WHERE number = 2;"
        "UPDATE block SET number = 2 WHERE number = -1;",
    )
    assert "block 2 is stored where 1 should be" in str(await refused(open_world, ledger))


async def made_invalid(ledger, open_world, code):
    """The last transaction made invalid, in its block and in all that follows from it."""
    async with open_world(ledger) as world:
        before, raw = world.chain.block(3), world.chain.block(4)
    keep_block = "DELETE FROM block WHERE number = 4; DELETE FROM tx WHERE block = 4;"
    edit(ledger, CUT_OFF.replace(keep_block, f"UPDATE tx SET code = {int(code)} WHERE block = 4;"))
    edit(ledger, "UPDATE block SET raw = ? WHERE number = 4", recoded(raw, code, before))
    return await refused(open_world, ledger)


async def test_a_code_that_the_state_contradicts(ledger, open_world):
    error = await made_invalid(ledger, open_world, ValidationCode.MVCC_READ_CONFLICT)
    assert (error.table, error.key) == ("block", "4")
    assert "MVCC_READ_CONFLICT of transaction" in str(error)
    assert "which is VALID by the state before it" in str(error)


async def test_a_code_that_only_the_moment_of_submission_tells(ledger, open_world):
    error = await made_invalid(ledger, open_world, ValidationCode.INVALID_CHAINCODE)
    assert "rows of block, tx, state, history were changed and fit each other" in str(error)


async def test_an_old_configuration_put_back_in_force(tmp_path, open_world):
    """So that who was revoked is somebody again."""
    async with open_world(tmp_path / "l") as world:
        world.ledger.directory.ca("FleetMSP").revoke(name="uav")
        assert await world.ledger.refresh_revocations() == 1
    edit(tmp_path / "l", "UPDATE meta SET value = CAST('0' AS BLOB) WHERE name = 'last_config'")
    error = await refused(open_world, tmp_path / "l")
    assert (error.table, error.key) == ("meta", "name last_config")


async def test_a_row_edited_while_the_ledger_runs_and_then_written_over(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        await world.contract().submit("put", "a", "1")
        edit(tmp_path / "l", "UPDATE state SET value = x'39' WHERE key = CAST('a' AS BLOB)")
        commit = await (await world.contract().propose("put", "a", "2").endorse()).submit()
        with pytest.raises(LedgerError, match="key 'a': not what this ledger wrote"):
            await commit.status()
    error = await refused(open_world, tmp_path / "l")
    assert error.table == "state"
    assert "key a" in error.key


async def test_a_ledger_from_before_the_seal_is_recomputed_and_sealed(ledger, open_world):
    """With every kind of code on its chain, and a change of the configuration."""
    async with open_world(ledger) as world:
        with pytest.raises(CommitError, match="ENDORSEMENT_POLICY_FAILURE"):
            await world.contract().submit("put", "b", "1", endorsing_organizations=["AuthorityMSP"])
        increments = (world.contract().submit("increment", "counter") for _ in range(12))
        outcomes = await asyncio.gather(*increments, return_exceptions=True)
        assert any(isinstance(each, CommitError) for each in outcomes)
        world.ledger.directory.ca("FleetMSP").revoke(name="uav")
        await world.ledger.refresh_revocations()
        await world.contract().submit("delete", "a")
    old = ledger.with_name("old")
    shutil.copytree(ledger, old)
    edit(old, "DELETE FROM meta WHERE name = 'seal'; PRAGMA user_version = 2;")
    (old / "node" / "seal.key").unlink()
    edited = ledger.with_name("edited")
    shutil.copytree(old, edited)
    edit(edited, "UPDATE history SET value = x'39' WHERE block = 1")
    assert (await refused(open_world, edited)).table == "history"
    assert not (edited / "node" / "seal.key").exists()
    for number in range(2):
        async with open_world(old) as world:
            await world.contract().submit("put", "c", str(number))
    edit(old, "DELETE FROM meta WHERE name = 'seal'")
    assert "seal has been removed" in str(await refused(open_world, old))


async def test_the_seals_key_is_private_and_whole(ledger, open_world):
    key = ledger / "node" / "seal.key"
    assert key.stat().st_mode & 0o777 == 0o600
    key.write_bytes(key.read_bytes()[:31])
    with pytest.raises(DirectoryError, match=r"seal\.key is not whole"):
        async with open_world(ledger):
            pass
