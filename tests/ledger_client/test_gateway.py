"""The Gateway client against a real ledger: every stage, offline signing, events, blocks, interruptions."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import itertools

import grpc
import pytest

from wonderland_fabric_gateway.checkpoints import Checkpoint, FileCheckpointer, MemoryCheckpointer
from wonderland_fabric_gateway.gateway import (
    CommitError,
    CommitStatusError,
    Deadlines,
    EndorseError,
    EvaluateError,
    Gateway,
    MalformedError,
    StreamError,
    SubmitError,
    UnknownTransactionError,
    UnsignedError,
)
from wonderland_fabric_gateway.transactions import ValidationCode


async def take(stream, count, within_s=10.0):
    async with asyncio.timeout(within_s):
        found = []
        async for item in stream:
            found.append(item)
            if len(found) == count:
                break
        return found


async def test_a_transaction_is_committed_and_can_be_read(contract):
    done = await contract.submit("put", "colour", b"blue")
    assert done.payload == b"blue"
    assert done.block_number >= 1
    assert await contract.evaluate("get", "colour") == b"blue"


async def test_the_contract_knows_who_asks(contract):
    proposal = contract.propose("who")
    assert await proposal.evaluate() == f"pad pad-1 {proposal.tx_id}".encode()


async def test_the_stages_one_by_one(contract, network):
    proposal = contract.propose("put", "a", "1")
    assert len(proposal.tx_id) == 64
    transaction = await proposal.endorse()
    assert (transaction.tx_id, transaction.payload) == (proposal.tx_id, b"1")
    assert await contract.evaluate("get", "a") == b""  # endorsed is not committed
    commit = await transaction.submit()
    status = await commit.status()
    assert (status.is_valid, status.code_name, status.tx_id) == (True, "VALID", proposal.tx_id)
    status.require_valid()
    assert await network.commit(proposal.tx_id).status() == status  # any time later, by the id alone


async def test_everything_signed_elsewhere(ledger, gateway):
    """The key never is where the connection is: bytes out, signatures in, at each of the three stages."""
    connection = ledger.connection
    sign = connection.signer("pad")
    async with connection.open_channel() as channel:
        offline = Gateway(channel, connection.identity("pad"), None)
        proposal = offline.network("wonderland").contract("pol").propose("put", "b", "2")
        with pytest.raises(UnsignedError) as caught:
            await proposal.endorse()
        assert caught.value.tx_id == proposal.tx_id
        sent = proposal.to_bytes()
        assert proposal.digest == hashlib.sha256(proposal.message).digest()
        transaction = await offline.new_signed_proposal(sent, sign(proposal.message)).endorse()
        with pytest.raises(UnsignedError):
            await transaction.submit()
        signature = sign(offline.new_transaction(transaction.to_bytes()).message)
        commit = await offline.new_signed_transaction(transaction.to_bytes(), signature).submit()
        with pytest.raises(UnsignedError):
            await commit.status()
        asked = offline.new_commit(commit.to_bytes())
        status = await offline.new_signed_commit(commit.to_bytes(), sign(asked.message)).status()
    assert status.is_valid
    assert await gateway.network("wonderland").contract("pol").evaluate("get", "b") == b"2"


@pytest.mark.parametrize("data", [b"", b"\xff\xff", b"\x0a\x02ab"])
async def test_bytes_that_are_no_stage(gateway, data):
    for read in (gateway.new_proposal, gateway.new_transaction, gateway.new_commit):
        with pytest.raises(MalformedError):
            read(data)


async def test_the_contract_refuses(contract):
    with pytest.raises(EndorseError) as caught:
        await contract.submit("dance")
    error = caught.value
    assert error.status_code is grpc.StatusCode.ABORTED
    assert len(error.tx_id) == 64
    (detail,) = error.details
    assert detail.msp_id == "AuthorityMSP"
    assert detail.address
    assert (error.chaincode_response.status, error.chaincode_response.message) == (
        404,
        "UNKNOWN_FUNCTION: there is no dance",
    )
    assert not error.is_mismatch
    assert error.tx_id in str(error)
    assert "UNKNOWN_FUNCTION" in str(error)
    with pytest.raises(EvaluateError) as caught:
        await contract.evaluate("dance")
    assert caught.value.chaincode_response.status == 404


async def test_a_contract_that_is_not_there(network):
    with pytest.raises(EvaluateError) as caught:
        await network.contract("other").evaluate("get", "a")
    assert caught.value.status_code is grpc.StatusCode.FAILED_PRECONDITION
    assert caught.value.chaincode_response is None


async def test_a_key_that_is_not_the_certificates(ledger):
    connection = ledger.connection
    async with connection.open_channel() as channel:
        forger = Gateway(channel, connection.identity("pad"), connection.signer("uav"))
        with pytest.raises(EndorseError):
            await forger.network("wonderland").contract("pol").submit("put", "a", "1")


async def test_a_second_submission_of_the_same_transaction_changes_nothing(contract):
    proposal = contract.propose("put", "a", "1")
    transaction = await proposal.endorse()
    status = await (await transaction.submit()).status()
    with contextlib.suppress(SubmitError):  # a ledger may say so, or let the block show it
        await transaction.submit()
    assert await transaction.commit.status() == status


async def test_conflicts_are_told(contract):
    stale = await contract.propose("add", "n").endorse()
    await contract.submit("add", "n")
    status = await (await stale.submit()).status()
    with pytest.raises(CommitError) as caught:
        status.require_valid()
    error = caught.value
    assert (error.code, error.code_name) == (ValidationCode.MVCC_READ_CONFLICT, "MVCC_READ_CONFLICT")
    assert error.is_conflict
    assert error.tx_id == stale.tx_id
    assert error.tx_id in str(error)


async def test_conflicts_are_overcome_by_new_attempts(contract):
    await asyncio.gather(*(contract.submit_with_retry("add", "n", attempts=30) for _ in range(8)))
    assert await contract.evaluate("get", "n") == b"8"


async def test_without_retry_a_conflict_is_an_error(contract):
    results = await asyncio.gather(*(contract.submit("add", "n") for _ in range(8)), return_exceptions=True)
    errors = [each for each in results if isinstance(each, Exception)]
    assert errors
    assert all(isinstance(each, CommitError) and each.is_conflict for each in errors)
    assert await contract.evaluate("get", "n") == str(8 - len(errors)).encode()


async def test_what_the_contract_refuses_is_not_tried_again(contract, network):
    before = await network.height()
    with pytest.raises(EndorseError):
        await contract.submit_with_retry("dance")
    assert await network.height() == before


async def test_a_deadline_is_kept(network):
    commit = network.commit("0" * 64)
    with pytest.raises(CommitStatusError) as caught:
        await commit.status(timeout_s=0.1)
    assert caught.value.status_code is grpc.StatusCode.DEADLINE_EXCEEDED


def test_deadlines_are_positive():
    with pytest.raises(ValueError, match="submit_s"):
        Deadlines(submit_s=0)
    with pytest.raises(ValueError, match="endorse_s"):
        Deadlines(endorse_s=float("nan"))


async def test_events_from_a_block_on(contract, network):
    done = [await contract.submit("put", f"k{number}", "x") for number in range(3)]
    stream = network.chaincode_events("pol", start_block=0)
    async with stream:
        events = await take(stream, 3)
    assert [(event.name, event.payload, event.chaincode) for event in events] == [
        ("Put", f"k{number}".encode(), "pol") for number in range(3)
    ]
    assert [(event.tx_id, event.block_number) for event in events] == [(each.tx_id, each.block_number) for each in done]


async def test_events_from_now_on_miss_nothing_after_opening(contract, network):
    await contract.submit("put", "before", "x")
    async with network.chaincode_events("pol") as stream:
        await contract.submit("put", "after", "x")
        (event,) = await take(stream, 1)
    assert event.payload == b"after"


async def test_events_after_a_transaction_without_naming_its_block(contract, network):
    done = [await contract.submit("put", f"k{number}", "x") for number in range(3)]
    async with network.chaincode_events("pol", after_transaction_id=done[0].tx_id) as stream:
        events = await take(stream, 2)
    assert [event.tx_id for event in events] == [done[1].tx_id, done[2].tx_id]


async def test_events_after_a_transaction_within_its_block(contract, network):
    """Many transactions share a block; each of them is a place to continue after."""
    done = await asyncio.gather(*(contract.submit("put", f"k{number}", "x") for number in range(20)))
    async with network.chaincode_events("pol", start_block=0) as stream:
        everything = [event.tx_id for event in await take(stream, 20)]
    assert set(everything) == {each.tx_id for each in done}
    for place, event in itertools.islice(enumerate(everything), 0, 19, 6):
        async with network.chaincode_events("pol", start_block=0, after_transaction_id=event) as stream:
            rest = await take(stream, 19 - place)
        assert [each.tx_id for each in rest] == everything[place + 1 :]


async def test_events_after_a_transaction_without_event(contract, network):
    """Fabric's own interface would be silent for ever."""
    quiet = await contract.submit("quiet", "a")
    loud = await contract.submit("put", "b", "x")
    async with network.chaincode_events("pol", after_transaction_id=quiet.tx_id) as stream:
        (event,) = await take(stream, 1)
    assert event.tx_id == loud.tx_id


@pytest.mark.parametrize("start", [None, 0])
async def test_events_after_a_transaction_that_is_not_there(contract, network, start):
    await contract.submit("put", "a", "x")
    stream = network.chaincode_events("pol", start_block=start, after_transaction_id="f" * 64, reconnect=True)
    with pytest.raises(UnknownTransactionError, match="there is no transaction") as caught:
        async with asyncio.timeout(5):
            await anext(stream)
    assert caught.value.tx_id == "f" * 64


async def test_events_after_a_transaction_that_lies_before_the_start(contract, network):
    early = await contract.submit("put", "a", "x")
    late = await contract.submit("put", "b", "x")
    stream = network.chaincode_events("pol", start_block=late.block_number, after_transaction_id=early.tx_id)
    with pytest.raises(UnknownTransactionError, match="before the start"):
        await anext(stream)


async def test_a_checkpoint_of_another_ledger_is_noticed(contract, network):
    await contract.submit("put", "a", "x")

    def keeper(checkpoint):
        made = MemoryCheckpointer()
        made.save(checkpoint)
        return made

    async def refused(stream, match=None):
        with pytest.raises(UnknownTransactionError, match=match):
            await anext(stream)

    # At once: a block that is not there yet is waited for.
    checkpoints = (Checkpoint(1, "e" * 64), Checkpoint(1000, "e" * 64), Checkpoint(1000))
    await asyncio.gather(
        *(refused(network.chaincode_events("pol", checkpointer=keeper(each))) for each in checkpoints),
        refused(network.blocks(checkpointer=keeper(Checkpoint(1000))), "1000"),
        refused(network.filtered_blocks(checkpointer=keeper(Checkpoint(1000))), "1000"),
    )


async def test_a_checkpoint_at_the_very_end_is_fine(contract, network):
    done = await contract.submit("put", "a", "x")
    keeper = MemoryCheckpointer()
    keeper.save(Checkpoint.after_block(done.block_number))
    async with network.chaincode_events("pol", checkpointer=keeper) as stream:
        await contract.submit("put", "b", "x")
        (event,) = await take(stream, 1)
    assert event.payload == b"b"


async def test_checkpoints_over_a_restart_lose_and_repeat_nothing(start_ledger, tmp_path):
    keeper = FileCheckpointer(tmp_path / "checkpoint.json")
    seen = []
    written = []
    for run in range(3):
        async with start_ledger() as ledger:
            connection = ledger.connection
            async with connection.open_channel() as channel:
                gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
                network = gateway.network("wonderland")
                contract = network.contract("pol")
                done = [await contract.submit("put", f"{run}-{number}", "x") for number in range(4)]
                written += [each.tx_id for each in done]
                async with network.chaincode_events("pol", start_block=0, checkpointer=keeper) as stream:
                    for event in await take(stream, 3):  # always one behind
                        seen.append(event.tx_id)
                        keeper.save(event.checkpoint)
    assert seen == written[: len(seen)]
    assert len(seen) == 9


async def free_address(start_ledger):
    async with start_ledger() as ledger:
        return ledger.connection.gateway.address


async def submit_when_back(contract):
    while True:
        try:
            return await contract.submit("put", "b", "x")
        except EndorseError as error:
            if error.status_code is not grpc.StatusCode.UNAVAILABLE:
                raise
            await asyncio.sleep(0.05)


async def test_streams_survive_a_restart_of_the_ledger(start_ledger):
    address = await free_address(start_ledger)
    async with start_ledger(address) as ledger:
        connection = ledger.connection
        channel = connection.open_channel()
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        network = gateway.network("wonderland")
        contract = network.contract("pol")
        events = network.chaincode_events("pol", reconnect=True)
        blocks = network.blocks(start_block=0, reconnect=True)
        filtered = network.filtered_blocks(reconnect=True)
        await asyncio.gather(events.open(), blocks.open(), filtered.open())
        first = await contract.submit("put", "a", "x")
        assert [event.tx_id for event in await take(events, 1)] == [first.tx_id]
    waiting = [asyncio.create_task(take(stream, 1)) for stream in (events, filtered)]
    async with start_ledger(address):
        async with asyncio.timeout(20):
            second = await submit_when_back(contract)
        assert [event.tx_id for event in await waiting[0]] == [second.tx_id]
        (outline,) = await waiting[1]
        assert outline.number == first.block_number
        chain = await take(blocks, second.block_number + 1)
        for before, after in itertools.pairwise(chain):
            after.require_follows(before.header)
        for stream in (events, blocks, filtered):
            stream.close()
        await channel.close()


async def test_without_reconnect_an_interruption_is_an_error(start_ledger):
    async with start_ledger() as ledger:
        connection = ledger.connection
        channel = connection.open_channel()
        gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
        stream = gateway.network("wonderland").chaincode_events("pol")
        await stream.open()
        waiting = asyncio.create_task(anext(stream))
        await asyncio.sleep(0.05)
    with pytest.raises(StreamError) as caught:
        await waiting
    assert caught.value.status_code is not None
    await channel.close()


async def test_blocks_tell_everything(contract, network):
    done = await contract.submit("put", "a", "value")
    async with network.blocks(start_block=0) as stream:
        chain = await take(stream, done.block_number + 1)
    assert set(chain[0].config.organisations) == {"AuthorityMSP", "PadMSP", "FleetMSP", "OrdererMSP"}
    for before, after in itertools.pairwise(chain):
        after.require_follows(before.header)
    (transaction,) = [each for block in chain for each in block.transactions if each.tx_id == done.tx_id]
    assert transaction.is_valid
    assert (transaction.creator.pol_id, transaction.invocation.function) == ("pad-1", "put")
    assert transaction.event.name == "Put"
    assert [(namespace, write.key, write.value) for namespace, write in transaction.writes] == [("pol", "a", b"value")]
    assert {endorser.msp_id for endorser in transaction.endorsers} == {"AuthorityMSP", "PadMSP"}


async def test_filtered_blocks_tell_the_outline(contract, network):
    done = await contract.submit("put", "a", "value")
    async with network.filtered_blocks(start_block=done.block_number) as stream:
        (block,) = await take(stream, 1)
    assert (block.number, block.channel) == (done.block_number, "wonderland")
    (transaction,) = block.transactions
    assert (transaction.tx_id, transaction.validation_name) == (done.tx_id, "VALID")
    assert [(event.chaincode, event.name) for event in transaction.events] == [("pol", "Put")]
    assert block.checkpoint == Checkpoint(done.block_number + 1)


async def test_blocks_continue_after_a_checkpoint(contract, network):
    done = [await contract.submit("put", "a", str(number)) for number in range(3)]
    keeper = MemoryCheckpointer()
    keeper.save(Checkpoint.after_block(done[1].block_number))
    async with network.blocks(start_block=0, checkpointer=keeper) as stream:
        (block,) = await take(stream, 1)
    assert block.number == done[2].block_number


async def test_the_height(contract, network):
    before = await network.height()
    done = await contract.submit("put", "a", "x")
    assert await network.height() == done.block_number + 1 > before


async def test_a_channel_that_is_not_there(gateway):
    network = gateway.network("looking-glass")
    with pytest.raises(StreamError):
        await network.height()
    with pytest.raises(StreamError):
        await anext(network.blocks(start_block=0, reconnect=True))
    with pytest.raises(EvaluateError):
        await network.contract("pol").evaluate("get", "a")


async def test_closing_ends_an_iteration_quietly(network):
    stream = await network.chaincode_events("pol")
    waiting = asyncio.create_task(take(stream, 1))
    await asyncio.sleep(0.05)
    stream.close()
    assert await waiting == []
    with pytest.raises(StopAsyncIteration):
        await anext(stream)


async def test_cancelling_an_iteration_is_a_cancellation(network):
    stream = network.blocks()
    await stream.open()
    waiting = asyncio.create_task(anext(stream))
    await asyncio.sleep(0.05)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting


async def test_a_closed_channel_is_an_error_and_no_cancellation(ledger):
    connection = ledger.connection
    channel = connection.open_channel()
    gateway = Gateway(channel, connection.identity("pad"), connection.signer("pad"))
    network = gateway.network("wonderland")
    stream = network.blocks(reconnect=True)
    await stream.open()
    waiting = asyncio.create_task(anext(stream))
    status = asyncio.create_task(network.commit("0" * 64).status())
    await asyncio.sleep(0.05)
    await channel.close()
    with pytest.raises(StreamError, match="channel"):
        await waiting
    with pytest.raises(CommitStatusError, match="channel"):
        await status
    with pytest.raises(EvaluateError, match="channel"):
        await network.contract("pol").evaluate("get", "a")
    with pytest.raises(StreamError, match="channel"):
        await network.height()
