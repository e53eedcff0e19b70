"""Several peers of one organisation: the next one is asked when one dies, is silent, or is behind."""

from __future__ import annotations

import asyncio
import contextlib
import functools

import grpc
import pytest
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import events_pb2
from kit.scripted_gateway import UNAVAILABLE, FailError, Scripted, details, hang, serving

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.checkpoints import Checkpoint, MemoryCheckpointer
from wonderland_fabric_gateway.errors import BlockError
from wonderland_fabric_gateway.gateway import (
    Deadlines,
    EndorseError,
    EvaluateError,
    Gateway,
    StreamError,
    UnknownTransactionError,
)
from wonderland_fabric_gateway.gateway.deliver import is_level
from wonderland_fabric_gateway.gateways import RETURN_S, Gateways

LIMITS = Deadlines(evaluate_s=4, endorse_s=4, submit_s=4, locate_s=4, resubmit_s=0.4, catch_up_s=30)


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


class Pair:
    """Two peers and a client of both."""

    def __init__(self, first, second, channels, identity, signer):
        self.first, self.second = first, second
        self.clock = Clock()
        self.gateways = Gateways(
            [(f"127.0.0.1:{each.port}", channel) for each, channel in zip((first, second), channels, strict=True)],
            now_s=self.clock,
        )
        self.network = Gateway(self.gateways, identity, signer, deadlines=LIMITS, random_bytes=bytes).network(
            "wonderland"
        )
        self.contract = self.network.contract("pol")
        self.gateways.is_level = None  # a test that wants heights compared says so

    def asked(self, method):
        """How often each was asked."""
        return self.first.counted(method), self.second.counted(method)


@pytest.fixture
async def pair(maker, pad):
    async with contextlib.AsyncExitStack() as stack:
        servers = [await stack.enter_async_context(serving(Scripted(maker))) for _ in range(2)]
        channels = [
            await stack.enter_async_context(grpc.aio.insecure_channel(f"127.0.0.1:{each.port}")) for each in servers
        ]
        yield Pair(*servers, channels, pad.identity, pad.signer)


@pytest.fixture
async def gone(maker, pad):
    """The same, with nobody at the first one's address."""
    async with contextlib.AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving(Scripted(maker)))
        nobody = Scripted(maker)
        async with serving(nobody):
            pass
        channels = [
            await stack.enter_async_context(grpc.aio.insecure_channel(f"127.0.0.1:{port}"))
            for port in (nobody.port, server.port)
        ]
        yield Pair(nobody, server, channels, pad.identity, pad.signer)


async def test_the_preferred_peer_has_all_of_it(pair):
    await pair.contract.submit("put", "a")
    await pair.contract.evaluate("get", "a")
    for method in ("Endorse", "Submit", "CommitStatus", "Evaluate"):
        assert pair.asked(method) == (1, 0)


async def test_a_dead_peer_is_passed_over_at_each_stage(gone):
    assert (await gone.contract.submit("put", "a")).block_number == 9
    assert await gone.contract.evaluate("get", "a") == b"evaluated"
    assert await gone.network.height() == 8


@pytest.mark.parametrize("method", ["Endorse", "Submit", "CommitStatus"])
async def test_a_peer_that_dies_between_two_stages(pair, method):
    pair.first.line_up(method, UNAVAILABLE)
    assert (await pair.contract.submit("put", "a")).block_number == 9
    assert pair.asked(method) == (1, 1)


@pytest.mark.parametrize("method", ["Evaluate", "Endorse", "Submit", "CommitStatus"])
async def test_a_silent_peer_leaves_time_for_the_other(pair, method):
    pair.first.line_up(method, hang)
    if method == "Evaluate":
        assert await pair.contract.evaluate("get", "a") == b"evaluated"
    else:
        assert (await pair.contract.submit("put", "a")).block_number == 9
    assert pair.asked(method) == (1, 1)


async def test_the_same_transaction_goes_to_the_other_peer(pair):
    pair.first.line_up("Submit", UNAVAILABLE)
    await pair.contract.submit("put", "a")
    (first,), (second,) = (
        [request for name, request in each.calls if name == "Submit"] for each in (pair.first, pair.second)
    )
    assert first == second


async def test_what_a_peer_says_moves_nobody_aside(pair):
    refusal = FailError(grpc.StatusCode.ABORTED, "see details", details("chaincode response 409, CONFLICT: no"))
    pair.first.line_up("Endorse", refusal)
    with pytest.raises(EndorseError):
        await pair.contract.submit("put", "a")
    assert pair.asked("Endorse") == (1, 0)
    # No orderer reached: the peer itself is well, and says so with details.
    pair.first.line_up("Submit", FailError(grpc.StatusCode.UNAVAILABLE, "no orderers", details("no leader")))
    await pair.contract.submit("put", "a")
    await pair.contract.evaluate("get", "a")
    assert pair.asked("Evaluate") == (1, 0)


async def test_nobody_is_left(gone):
    gone.second.line_up("Evaluate", UNAVAILABLE)
    with pytest.raises(EvaluateError) as caught:
        await gone.contract.evaluate("get", "a")
    assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE


async def test_a_peer_that_came_back_is_preferred_again_after_a_while(pair):
    pair.first.line_up("Evaluate", UNAVAILABLE)
    await pair.contract.evaluate("get", "a")
    assert pair.asked("Evaluate") == (1, 1)
    await pair.contract.evaluate("get", "a")  # it can be reached, but has just come back
    assert pair.asked("Evaluate") == (1, 2)
    pair.clock.now_s += RETURN_S - 0.1
    await pair.contract.evaluate("get", "a")
    assert pair.asked("Evaluate") == (1, 3)
    pair.clock.now_s += 0.2
    await pair.contract.evaluate("get", "a")
    assert pair.asked("Evaluate") == (2, 3)


async def test_a_peer_that_is_still_behind_is_not_preferred_again(pair):
    level = []

    async def is_level(index, other):
        assert (index, other) == (0, 1)
        return level.pop(0)

    pair.gateways.is_level = is_level
    pair.gateways.failed(0)
    await pair.gateways.channel(0).channel_ready()
    for answer, order in ((False, [1, 0]), (True, [0, 1])):
        level.append(answer)
        assert pair.gateways.order() == [1, 0]
        pair.clock.now_s += RETURN_S
        assert pair.gateways.order() == [1, 0]
        (comparing,) = pair.gateways._comparing.values()
        await comparing
        assert pair.gateways.order() == order
    assert level == []


async def test_peers_that_disagree_since_the_preferred_one_is_behind(pair):
    """Fabric's peers can stop to follow for a while; what they endorse then never matches what others do."""
    mismatch = FailError(grpc.StatusCode.ABORTED, "failed to assemble: ProposalResponsePayloads do not match")
    pair.first.line_up("Endorse", *[mismatch] * 99)
    pair.gateways.is_level = functools.partial(is_level, pair.network._environment, "wonderland")
    pair.first.newest, pair.second.newest = 6, 7
    assert (await pair.contract.submit_with_retry("put", "a")).block_number == 9
    assert pair.asked("Endorse") == (1, 1)


async def test_heights_are_compared_at_the_peers_themselves(pair):
    pair.first.newest, pair.second.newest = 6, 7
    environment = pair.network._environment
    assert not await is_level(environment, "wonderland", 0, 1)
    pair.first.newest = 7
    assert await is_level(environment, "wonderland", 0, 1)


async def test_a_stream_leaves_a_peer_that_stands_still_while_others_go_on(pair, chain):
    pair.first.line_up("Deliver", [chain[0], None])
    pair.second.line_up("Deliver", [chain[1], chain[2], None])
    pair.first.newest, pair.second.newest = 5, 7
    async with asyncio.timeout(20), pair.network.blocks(start_block=5, reconnect=True) as stream:
        stream._silence_s = 0.05
        assert [(await anext(stream)).number for _ in range(3)] == [5, 6, 7]
    assert starts(pair.second) == [6]


async def test_a_stream_stays_while_its_peer_is_level(pair, chain):
    pair.first.line_up("Deliver", [chain[0], None])
    pair.first.newest = pair.second.newest = 5
    async with pair.network.blocks(start_block=5, reconnect=True) as stream:
        stream._silence_s = 0.02
        await anext(stream)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await anext(stream)
    assert starts(pair.second) == []


async def test_a_peer_that_fails_again_has_to_wait_for_longer(pair):
    for wait_s in (RETURN_S, 2 * RETURN_S, 4 * RETURN_S):
        pair.gateways.failed(0)
        assert pair.gateways.order() == [1, 0]
        await pair.gateways.channel(0).channel_ready()
        assert pair.gateways.order() == [1, 0]
        pair.clock.now_s += wait_s - 0.1
        assert pair.gateways.order() == [1, 0]
        pair.clock.now_s += 0.2
        assert pair.gateways.order() == [0, 1]


async def test_calls_that_fail_together_are_one_failure(pair):
    for _ in range(50):
        pair.gateways.failed(0)
    await pair.gateways.channel(0).channel_ready()
    pair.gateways.order()
    pair.clock.now_s += RETURN_S
    assert pair.gateways.order() == [0, 1]


async def test_all_away_are_asked_in_turn(pair):
    pair.gateways.failed(0)
    pair.clock.now_s += 1
    pair.gateways.failed(1)
    assert pair.gateways.order() == [0, 1]
    pair.clock.now_s += 1
    pair.gateways.failed(0)
    assert pair.gateways.order() == [1, 0]


def test_no_gateway_at_all():
    with pytest.raises(ValueError, match="at least one"):
        Gateways([])


# --- streams


def outline(number, *tx_ids):
    transactions = [events_pb2.FilteredTransaction(txid=each) for each in tx_ids]
    return events_pb2.DeliverResponse(
        filtered_block=events_pb2.FilteredBlock(number=number, filtered_transactions=transactions)
    )


def event(number, tx_id, *before):
    answer = gateway_pb2.ChaincodeEventsResponse(block_number=number)
    for each in (*before, tx_id):
        answer.events.add(chaincode_id="pol", tx_id=each, event_name="Put", payload=each.encode())
    return answer.SerializeToString()


@pytest.fixture
def chain(maker):
    """Four blocks, as answers of Deliver."""
    messages = []
    previous = b"p" * 32
    for number in (5, 6, 7, 8):
        message = maker.block([maker.transaction()], number=number, previous=previous)
        previous = parse_block(message).header.hash
        messages.append(events_pb2.DeliverResponse(block=message))
    return messages


def starts(server, kind="Deliver"):
    """Where block streams were asked to begin."""
    found = []
    for name, data in server.calls:
        if name == kind:
            payload = common_pb2.Payload.FromString(common_pb2.Envelope.FromString(data).payload)
            found.append(ab_pb2.SeekInfo.FromString(payload.data).start.specified.number)
    return found


async def test_a_block_stream_goes_on_at_the_other_peer(pair, chain):
    pair.first.line_up("Deliver", [chain[0], chain[1], UNAVAILABLE])
    pair.second.line_up("Deliver", [chain[2], chain[3], None])
    async with asyncio.timeout(20), pair.network.blocks(start_block=5, reconnect=True) as stream:
        assert [(await anext(stream)).number for _ in range(4)] == [5, 6, 7, 8]
    assert (starts(pair.first), starts(pair.second)) == ([5], [7])


async def test_an_event_stream_goes_on_at_the_other_peer_without_loss_or_repetition(pair):
    pair.first.line_up("ChaincodeEvents", [event(5, "a"), event(6, "c", "b"), UNAVAILABLE])
    pair.second.line_up("DeliverFiltered", [outline(6, "b", "c", "d")])
    pair.second.line_up("ChaincodeEvents", [event(6, "d", "b", "c"), event(7, "e"), None])
    seen = []
    async with asyncio.timeout(20), pair.network.chaincode_events("pol", start_block=5, reconnect=True) as stream:
        while len(seen) < 5:
            seen.append((await anext(stream)).tx_id)
    assert seen == ["a", "b", "c", "d", "e"]


async def test_a_peer_that_is_behind_is_waited_for(pair, chain):
    """The dead peer was ahead: nothing is lost by waiting, and the other one is not taken for another ledger."""
    pair.first.line_up("Deliver", [chain[0], chain[1], UNAVAILABLE])
    pair.first.line_up("DeliverFiltered", *[[UNAVAILABLE]] * 99)
    pair.second.line_up("DeliverFiltered", [outline(4)], [outline(4)], [outline(5)], [outline(6)])
    pair.second.line_up("Deliver", [chain[2], None])
    async with asyncio.timeout(20), pair.network.blocks(start_block=5, reconnect=True) as stream:
        assert [(await anext(stream)).number for _ in range(3)] == [5, 6, 7]
    assert starts(pair.second) == [7]


async def test_events_after_a_checkpoint_wait_for_a_peer_that_is_behind(pair):
    absent = events_pb2.DeliverResponse(status=common_pb2.NOT_FOUND)
    pair.first.line_up("DeliverFiltered", *[[UNAVAILABLE]] * 99)
    pair.second.line_up("DeliverFiltered", [absent], [outline(5)], [outline(6, "b", "c")])
    pair.second.line_up("ChaincodeEvents", [event(6, "c", "b"), None])
    keeper = MemoryCheckpointer()
    keeper.save(Checkpoint(6, "b"))
    async with asyncio.timeout(20), pair.network.chaincode_events("pol", checkpointer=keeper) as stream:
        assert (await anext(stream)).tx_id == "c"


async def test_another_chain_at_the_other_peer_is_noticed(pair, chain, maker):
    stranger = maker.block([maker.transaction()], number=7, previous=b"x" * 32)
    pair.first.line_up("Deliver", [chain[0], chain[1], UNAVAILABLE])
    pair.second.line_up("Deliver", [events_pb2.DeliverResponse(block=stranger), None])
    stream = pair.network.blocks(start_block=5, reconnect=True)
    assert [(await anext(stream)).number for _ in range(2)] == [5, 6]
    with pytest.raises(BlockError, match="does not continue the chain"):
        await anext(stream)


async def test_a_checkpoint_whose_block_holds_another_transaction_is_refused_at_once(pair):
    pair.first.line_up("DeliverFiltered", [outline(6, "x", "y")])
    keeper = MemoryCheckpointer()
    keeper.save(Checkpoint(6, "b"))
    with pytest.raises(UnknownTransactionError, match="Remove the checkpoint to begin anew"):
        await pair.network.chaincode_events("pol", checkpointer=keeper, reconnect=True)
    assert pair.asked("ChaincodeEvents") == (0, 0)
    assert pair.asked("CommitStatus") == (0, 0)


async def test_without_reconnect_each_peer_is_tried_for_the_beginning_only(pair, chain):
    pair.first.line_up("Deliver", [UNAVAILABLE])
    pair.second.line_up("Deliver", [chain[0], UNAVAILABLE])
    stream = pair.network.blocks(start_block=5)
    assert (await anext(stream)).number == 5
    with pytest.raises(StreamError):
        await anext(stream)
