"""The running chain: cutting blocks, full and failing disks, restarts, damaged stores."""

import asyncio
import contextlib
import sqlite3
import threading
import time

import grpc
import pytest
from fabric_protos.common import common_pb2

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.commit_hash import commit_hash_of, expected_commit_hash
from wonderland_fabric_gateway.embedded import chain as chain_module
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.committer import Candidate
from wonderland_fabric_gateway.embedded.errors import (
    DirectoryError,
    LedgerCorruptedError,
    LedgerOverloadedError,
    RevocationListError,
    StorageError,
)
from wonderland_fabric_gateway.embedded.orderer import BatchCutter, BatchLimits
from wonderland_fabric_gateway.embedded.seal import Seal
from wonderland_fabric_gateway.gateway import EndorseError, GatewayError


def candidate(name="t", size=10):
    return Candidate(name, b"x" * size, b"", 0, 0, 0)


async def fill(world, blocks):
    """So many blocks of one invalid transaction each."""
    for number in range(world.chain.height, world.chain.height + blocks):
        world.chain.submit(Candidate(f"filler {number}", b"filler", b"", 0, 255, 0))
        await world.chain.wait_for_block(number)


async def until(condition):
    async with asyncio.timeout(60):
        while not condition():
            await asyncio.sleep(0.01)


async def test_each_block_tells_by_a_hash_all_that_was_committed(world):
    contract = world.contract()
    await contract.submit("put", "a", "1")
    await contract.submit("delete", "a")
    await contract.submit("fill", "k", "3")
    await fill(world, 1)
    blocks = [parse_block(world.chain.block(number)) for number in range(world.chain.height)]
    previous = commit_hash_of(blocks[0])
    assert previous == b""
    for block in blocks[1:]:
        previous = expected_commit_hash(previous, block)
        assert commit_hash_of(block) == previous
    assert len({commit_hash_of(block) for block in blocks}) == len(blocks)


async def test_older_blocks_are_checked_while_the_ledger_serves(tmp_path, open_world):
    async with open_world(tmp_path / "ledger") as world:
        await world.contract().submit("put", "k", "1")
        await fill(world, 130)
    async with open_world(tmp_path / "ledger") as world:
        await until(lambda: world.chain.verified_from == 0)
        assert world.chain.trouble == ""
        await world.contract().submit("put", "k", "2")


@pytest.mark.parametrize("what", ["code", "hash", "missing"])
async def test_damage_to_an_older_block_stops_the_chain_and_is_said(tmp_path, open_world, monkeypatch, what):
    """Found after the start, were it not for the seal; what is there stays readable."""
    monkeypatch.setattr(Seal, "broken", lambda *_: [])
    async with open_world(tmp_path / "ledger") as world:
        await world.contract().submit("put", "k", "1")
        await fill(world, 130)
        path, raw = world.ledger.directory.database, world.chain.block(1)
    block = common_pb2.Block.FromString(raw)
    if what == "code":  # nobody signs the validation codes
        block.metadata.metadata[common_pb2.TRANSACTIONS_FILTER] = b"\x0b"
    elif what == "hash":
        block.header.previous_hash = b"x" * 32
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        if what == "missing":  # and another one too many, so that the count is right
            db.execute("UPDATE block SET number=-5 WHERE number=1")
        else:
            db.execute("UPDATE block SET raw=? WHERE number=1", (block.SerializeToString(),))
    async with open_world(tmp_path / "ledger") as world:
        await until(lambda: world.chain.trouble)
        assert "nothing is added to this chain any more, since" in world.chain.trouble
        assert "block 1" in world.chain.trouble
        assert await world.contract().evaluate("get", "k") == b"1"
        with pytest.raises(GatewayError, match="restore it from a copy"):
            await world.contract().submit("put", "k", "2")


async def test_a_chain_that_was_begun_without_commit_hashes_goes_on_without(tmp_path, open_world):
    async with open_world(tmp_path / "ledger") as world:
        await world.contract().submit("put", "k", "1")
        await world.contract().submit("put", "k", "2")
        path, raw = world.ledger.directory.database, world.chain.block(2)
    block = common_pb2.Block.FromString(raw)
    block.metadata.metadata[common_pb2.COMMIT_HASH] = b""
    with contextlib.closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE block SET raw=? WHERE number=2", (block.SerializeToString(),))
    (tmp_path / "ledger" / "node" / "seal.key").unlink()  # older than the seal, too
    async with open_world(tmp_path / "ledger") as world:
        await fill(world, 1)
        assert commit_hash_of(parse_block(world.chain.block(3))) == b""


async def test_a_batch_is_cut_by_count_before_its_time():
    cutter = BatchCutter(BatchLimits(time_ms=60_000, count=3))
    for name in "abcd":
        cutter.add(candidate(name))
    await asyncio.wait_for(cutter.wait(), 1)
    assert [each.tx_id for each in cutter.take_batch()] == ["a", "b", "c"]
    with pytest.raises(asyncio.TimeoutError):
        await asyncio.wait_for(cutter.wait(), 0.05)


async def test_a_batch_is_cut_by_size_before_its_time():
    cutter = BatchCutter(BatchLimits(time_ms=60_000, size_bytes=100))
    for name in "abc":
        cutter.add(candidate(name, 60))
    await asyncio.wait_for(cutter.wait(), 1)
    assert [each.tx_id for each in cutter.take_batch()] == ["a"]
    await asyncio.wait_for(cutter.wait(), 1)
    cutter.add(candidate("big", 1000))
    assert [each.tx_id for each in cutter.take_batch()] == ["b"]
    assert [each.tx_id for each in cutter.take_batch()] == ["c"]
    assert [each.tx_id for each in cutter.take_batch()] == ["big"]


async def test_the_time_runs_from_the_oldest_transaction():
    cutter = BatchCutter(BatchLimits(time_ms=60))
    loop = asyncio.get_running_loop()
    started = loop.time()
    cutter.add(candidate("a"))
    loop.call_later(0.04, cutter.add, candidate("b"))
    await asyncio.wait_for(cutter.wait(), 1)
    assert 0.055 <= loop.time() - started < 0.5
    assert [each.tx_id for each in cutter.take_batch()] == ["a", "b"]
    assert cutter.take_batch() == []


async def test_a_line_that_is_too_long_is_refused():
    cutter = BatchCutter(BatchLimits())
    cutter._bytes = 1 << 40
    with pytest.raises(LedgerOverloadedError, match="try again"):
        cutter.add(candidate())


async def test_concurrent_transactions_share_blocks(tmp_path, open_world):
    async with open_world(tmp_path / "l", limits=BatchLimits(time_ms=50)) as world:
        contract = world.contract()
        done = await asyncio.gather(*(contract.submit("put", f"k{index}", "v") for index in range(20)))
        assert len({each.block_number for each in done}) < 10
        assert world.chain.height < 11


async def test_everything_is_there_after_a_restart(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        for index in range(5):
            last = await world.contract().submit("put", "k", str(index))
        tip = world.chain.tip
    async with open_world(tmp_path / "l") as world:
        assert world.chain.tip == tip
        assert await world.contract().evaluate("get", "k") == b"4"
        assert await world.status(last.tx_id) == (0, 5)
        after = await world.contract().submit("put", "k", "5")
        assert after.block_number == 6
        block = parse_block(world.chain.block(6))
        assert block.header.previous_hash == tip.header_hash


async def test_what_was_taken_is_committed_when_the_ledger_stops(tmp_path, open_world, make_proposal):
    async with open_world(tmp_path / "l", limits=BatchLimits(time_ms=60_000)) as world:
        who = world.signing()
        proposal = make_proposal(who, "put", "k", "v")
        envelope = await world.endorse(proposal)
        envelope.signature = who.sign(envelope.payload)
        await world.submit(proposal.tx_id, envelope)
    async with open_world(tmp_path / "l") as world:
        assert await world.status(proposal.tx_id) == (0, 1)


async def test_a_full_disk_refuses_then_goes_on_and_loses_nothing(tmp_path, open_world, monkeypatch):
    monkeypatch.setattr(chain_module, "RETRY_S", 0.05)
    async with open_world(tmp_path / "l") as world:
        contract = world.contract()
        await contract.submit("put", "before", "1")
        world.chain.writer.limit_pages(1)
        waiting = asyncio.ensure_future(contract.submit("fill", "during", "200"))
        while not world.chain.trouble:
            await asyncio.sleep(0.01)
        with pytest.raises(EndorseError, match="disk is full") as caught:
            await contract.submit("put", "refused", "1")
        assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE
        assert await contract.evaluate("get", "before") == b"1"
        assert await contract.evaluate("get", "during00000") == b"<none>"
        assert world.chain.height == 2
        await asyncio.sleep(0.2)
        assert not waiting.done()
        world.chain.writer.limit_pages(1 << 20)
        assert (await asyncio.wait_for(waiting, 5)).block_number == 2
        assert (await contract.submit("put", "after", "1")).block_number == 3
        assert await contract.evaluate("get", "refused") == b"<none>"


async def test_a_disk_that_is_still_full_when_the_ledger_stops(tmp_path, open_world, monkeypatch):
    monkeypatch.setattr(chain_module, "RETRY_S", 0.05)
    async with open_world(tmp_path / "l") as world:
        world.chain.writer.limit_pages(1)
        commit = await (await world.contract().propose("fill", "k", "200").endorse()).submit()
        waiting = asyncio.ensure_future(commit.status())
        while not world.chain.trouble:
            await asyncio.sleep(0.01)
        await asyncio.wait_for(world.ledger.stop(), 5)
        # Which of the two it hears depends on whether it asked before or after the ledger gave up.
        with pytest.raises(GatewayError, match=r"cannot write|disk is full") as caught:
            await asyncio.wait_for(waiting, 5)
        assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE
    async with open_world(tmp_path / "l") as world:
        assert world.chain.height == 1
        assert (await world.contract().submit("put", "k", "v")).block_number == 1


async def test_a_failing_disk_stops_the_ledger_with_a_clear_answer(tmp_path, open_world, monkeypatch):
    async with open_world(tmp_path / "l") as world:
        done = await world.contract().submit("put", "k", "1")

        def broken(number):
            world.chain.writer._db.execute("ROLLBACK")
            raise StorageError(f"block {number} could not be written: disk I/O error", full=False)

        monkeypatch.setattr(world.chain.writer, "commit", broken)
        transaction = await world.contract().propose("put", "k", "2").endorse()
        commit = await transaction.submit()
        with pytest.raises(GatewayError, match="cannot write") as caught:
            await commit.status()
        assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE
        with pytest.raises(EndorseError, match="Mend the disk"):
            await world.contract().submit("put", "k", "3")
        with pytest.raises(GatewayError, match="cannot write"):
            await commit.status()  # also for who asks only now
        assert await world.status(done.tx_id) == (0, 1)
        assert await world.contract().evaluate("get", "k") == b"1"
    monkeypatch.undo()
    async with open_world(tmp_path / "l") as world:
        assert await world.contract().evaluate("get", "k") == b"1"
        assert (await world.contract().submit("put", "k", "4")).block_number == 2


async def test_a_fault_while_making_a_block_is_not_silent(tmp_path, open_world, monkeypatch, caplog):
    async with open_world(tmp_path / "l") as world:
        monkeypatch.setattr(world.chain._assembler, "assemble", None)
        with pytest.raises(GatewayError) as caught:
            await world.contract().propose("put", "k", "1").endorse()
            transaction = await world.contract().propose("put", "k", "1").endorse()
            await (await transaction.submit()).status()
        assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE
        assert "no block could be made of 1 transactions" in caplog.text


async def test_revocation_lists_are_checked_before_they_get_onto_the_channel(world):
    foreign = world.ledger.directory.ca(orgs.PAD).revocation_list_pem()
    with pytest.raises(RevocationListError):
        await world.chain.set_revocation_lists({orgs.FLEET: [foreign]})
    assert world.chain.height == 1
    assert await world.contract().evaluate("get", "k") == b"<none>"
    own = world.ledger.directory.ca(orgs.FLEET).revocation_list_pem()
    assert await world.chain.set_revocation_lists({orgs.FLEET: [own]}) == 1
    assert await world.chain.set_revocation_lists({orgs.FLEET: [own]}) is None
    assert world.chain.config_block == 1


async def test_revocations_of_several_organisations_hold_over_restarts(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        for msp_id, name in ((orgs.FLEET, "uav"), (orgs.PAD, "pad")):
            world.ledger.directory.ca(msp_id).revoke(name=name)
        assert await world.ledger.refresh_revocations() == 1
        world.ledger.directory.ca(orgs.AUTHORITY).revoke(name="inspector")  # while nobody tells the ledger
    async with open_world(tmp_path / "l") as world:
        assert world.chain.height == 3
        for name in ("uav", "pad", "inspector"):
            with pytest.raises(GatewayError, match="revoked"):
                await world.contract(name).evaluate("get", "k")
        assert await world.contract("pad_operator").evaluate("get", "k") == b"<none>"


DAMAGES = {
    "a changed block": "UPDATE block SET raw = CAST(substr(raw, 1, length(raw) - 40) || zeroblob(40) AS BLOB) WHERE number = 2",
    "a missing block": "DELETE FROM block WHERE number = 2",
    "a missing tip": "DELETE FROM block WHERE number = (SELECT max(number) FROM block) - 1",
    "swapped blocks": "UPDATE block SET raw = (SELECT raw FROM block WHERE number = 1) WHERE number = 2",
    "a changed header hash": "UPDATE block SET header_hash = zeroblob(32) WHERE number = 3",
    "an index without the tip's transaction": "DELETE FROM tx WHERE block = 3",
    "a configuration that is none": "UPDATE meta SET value = CAST('2' AS BLOB) WHERE name = 'last_config'",
    "a configuration nowhere": "UPDATE meta SET value = CAST('x' AS BLOB) WHERE name = 'last_config'",
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
async def test_a_damaged_store_is_said_to_be_one(tmp_path, open_world, damage):
    async with open_world(tmp_path / "l") as world:
        for index in range(3):
            await world.contract().submit("put", "k", str(index))
    db = sqlite3.connect(tmp_path / "l" / "ledger.sqlite3")
    db.execute(damage)
    db.commit()
    db.close()
    with pytest.raises(LedgerCorruptedError):
        async with open_world(tmp_path / "l"):
            pass


async def test_a_forged_orderer_signature_is_noticed(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        await world.contract().submit("put", "k", "1")
        block = common_pb2.Block.FromString(world.chain.block(1))
    slot = common_pb2.Metadata.FromString(block.metadata.metadata[common_pb2.SIGNATURES])
    slot.value = b""
    block.metadata.metadata[common_pb2.SIGNATURES] = slot.SerializeToString()
    db = sqlite3.connect(tmp_path / "l" / "ledger.sqlite3")
    db.execute("UPDATE block SET raw = ? WHERE number = 1", (block.SerializeToString(),))
    db.commit()
    db.close()
    with pytest.raises(LedgerCorruptedError, match="stored block 1"):
        async with open_world(tmp_path / "l"):
            pass


async def test_a_store_with_overwritten_pages_is_said_to_be_damaged(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        for index in range(30):
            await world.contract().submit("put", f"k{index}", "x" * 500)
    file = tmp_path / "l" / "ledger.sqlite3"
    data = bytearray(file.read_bytes())
    for page in range(1, len(data) // 4096):
        data[page * 4096 : page * 4096 + 200] = b"\xaa" * 200
    file.write_bytes(data)
    with pytest.raises(LedgerCorruptedError):
        async with open_world(tmp_path / "l"):
            pass


async def test_another_channels_store_is_refused(tmp_path, open_world):
    async with open_world(tmp_path / "l"):
        pass
    with pytest.raises(DirectoryError, match="channel 'wonderland', not 'other'"):
        async with open_world(tmp_path / "l", channel="other"):
            pass


async def test_an_idle_ledger_uses_no_processor(world):
    import time

    await world.contract().submit("put", "k", "v")
    before = time.process_time()
    await asyncio.sleep(0.5)
    assert time.process_time() - before < 0.05


async def test_nobody_hears_of_a_transaction_before_its_block_is_the_newest(world, monkeypatch):
    """Between the disk's word and the ledger's own there is a moment, in which the store has it already."""
    chain, commit, on_disk = world.chain, world.chain.writer.commit, threading.Event()

    def slow(number):
        commit(number)
        on_disk.set()
        time.sleep(0.3)

    monkeypatch.setattr(chain.writer, "commit", slow)
    before = chain.height
    endorsed = await world.contract().propose("put", "a", "1").endorse()
    await endorsed.submit()
    while not on_disk.is_set():
        await asyncio.sleep(0.005)
    assert chain.reader.transaction(endorsed.tx_id) is not None
    assert chain.height == before
    status = await endorsed.commit.status()
    assert (status.block_number, chain.height) == (before, before + 1)
