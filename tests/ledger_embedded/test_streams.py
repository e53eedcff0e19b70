"""Block and event streams."""

import asyncio
import datetime as dt
import itertools

import grpc
import pytest
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import events_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.blocks import block_signatures, parse_block
from wonderland_fabric_gateway.checkpoints import FileCheckpointer
from wonderland_fabric_gateway.embedded.block_views import length_delimited
from wonderland_fabric_gateway.signing import verify


async def responses(call):
    """All responses up to the final status; after it a server waits for another seek, so the call is ended here."""
    found = []
    async for data in call:
        found.append(events_pb2.DeliverResponse.FromString(data))
        if found[-1].WhichOneof("Type") == "status":
            break
    call.cancel()
    return found


async def status_of(call):
    """The status that ends a stream, and how many blocks came before."""
    *blocks, last = await responses(call)
    return common_pb2.Status.Name(last.status), len(blocks)


@pytest.fixture
async def filled(world):
    """Blocks 1 to 3, the second without an event."""
    world.done = [
        await world.contract().submit("put", "a", "1", "Happened"),
        await world.contract().submit("put", "b", "2"),
        await world.contract().submit("put", "c", "3", "Happened"),
    ]
    return world


async def test_full_blocks_form_a_signed_chain(filled):
    *found, last = await responses(filled.seek(filled.signing("mirror"), 0, 3))
    assert last.status == common_pb2.SUCCESS
    blocks = [parse_block(each.block) for each in found]
    assert [each.number for each in blocks] == [0, 1, 2, 3]
    for before, after in itertools.pairwise(blocks):
        after.require_follows(before.header)
        (signature,) = block_signatures(after)
        assert signature.signer.msp_id == "OrdererMSP"
        assert signature.signer.node_ou == "orderer"
        verify(signature.signer.public_key, signature.message, signature.signature)
    assert set(blocks[0].config.organisations) == {"AuthorityMSP", "PadMSP", "FleetMSP", "OrdererMSP"}
    transaction = blocks[1].transactions[0]
    assert transaction.tx_id == filled.done[0].tx_id
    assert transaction.validation_name == "VALID"
    assert [(ns, write.key, write.value) for ns, write in transaction.writes] == [("pol", "a", b"1")]
    assert transaction.event.name == "Happened"
    assert [each.msp_id for each in transaction.endorsers] == ["AuthorityMSP", "PadMSP"]
    assert transaction.invocation.chaincode_version == "toy-1"


async def test_filtered_blocks_show_ids_codes_and_events_without_payload(filled):
    *found, _ = await responses(filled.seek(filled.signing("uav"), 0, 3, kind="DeliverFiltered"))
    blocks = [each.filtered_block for each in found]
    assert [each.number for each in blocks] == [0, 1, 2, 3]
    assert blocks[0].filtered_transactions[0].type == common_pb2.CONFIG
    first = blocks[1].filtered_transactions[0]
    assert (first.txid, first.tx_validation_code, first.type) == (filled.done[0].tx_id, 0, 3)
    event = first.transaction_actions.chaincode_actions[0].chaincode_event
    assert (event.event_name, event.chaincode_id, event.payload) == ("Happened", "pol", b"")
    assert not blocks[2].filtered_transactions[0].transaction_actions.chaincode_actions


async def test_blocks_with_private_data_and_headers_alone(filled):
    who = filled.signing("mirror")
    *found, _ = await responses(filled.seek(who, 1, 1, kind="DeliverWithPrivateData"))
    assert parse_block(found[0].block_and_private_data.block).number == 1
    header_only = ab_pb2.SeekInfo.HEADER_WITH_SIG
    *found, _ = await responses(filled.seek(who, 0, 1, content=header_only))
    assert len(found[0].block.data.data) == 1  # a config block stays whole
    assert not found[1].block.data.data
    assert found[1].block.metadata.metadata[common_pb2.SIGNATURES]


@pytest.mark.parametrize(
    ("start", "stop", "expected"),
    [
        ("oldest", "newest", [0, 1, 2, 3]),
        ("newest", "newest", [3]),
        ("oldest", "oldest", [0]),
        (2, "newest", [2, 3]),
        (1, 2, [1, 2]),
    ],
)
async def test_spans(filled, start, stop, expected):
    *found, last = await responses(filled.seek(filled.signing(), start, stop))
    assert [each.block.header.number for each in found] == expected
    assert last.status == common_pb2.SUCCESS


async def test_seeks_that_cannot_be_served(filled):
    who = filled.signing()
    assert await status_of(filled.seek(who, 3, 1)) == ("BAD_REQUEST", 0)
    assert await status_of(filled.seek(who, 9, 9, behavior=ab_pb2.SeekInfo.FAIL_IF_NOT_READY)) == ("NOT_FOUND", 0)
    assert await status_of(filled.seek(who, 2, 9, behavior=ab_pb2.SeekInfo.FAIL_IF_NOT_READY)) == ("NOT_FOUND", 2)
    assert await status_of(filled.open_stream("Deliver", b"\xff\xff")) == ("BAD_REQUEST", 0)
    assert await status_of(filled.open_stream("DeliverFiltered", b"")) == ("BAD_REQUEST", 0)
    stale = dt.datetime.now(dt.UTC) - dt.timedelta(minutes=16)
    assert await status_of(filled.seek(who, 0, 0, at=stale)) == ("BAD_REQUEST", 0)


async def test_a_stream_goes_on_with_new_blocks(filled):
    call = filled.seek(filled.signing(), "next_commit", 5)
    await asyncio.sleep(0.1)
    for key in ("x", "y"):
        await filled.contract().submit("put", key, "v")
    *found, last = await responses(call)
    assert [each.block.header.number for each in found] == [4, 5]
    assert last.status == common_pb2.SUCCESS


async def test_one_stream_serves_one_seek_after_another(filled):
    who = filled.signing()
    call = filled.open_stream("Deliver", filled.seek_envelope(who, 1, 2), filled.seek_envelope(who, 0, 0))
    found = [events_pb2.DeliverResponse.FromString(await call.read()) for _ in range(5)]
    assert [each.block.header.number for each in found if each.HasField("block")] == [1, 2, 0]
    assert [index for index, each in enumerate(found) if each.status == common_pb2.SUCCESS] == [2, 4]
    call.cancel()


async def test_a_stranger_and_a_forged_seek_are_forbidden(filled):
    pad, uav = filled.signing("pad"), filled.signing("uav")

    class Forged:
        creator = pad.creator
        sign = staticmethod(uav.sign)

    assert await status_of(filled.seek(Forged, 0, 0)) == ("FORBIDDEN", 0)
    assert await status_of(filled.seek(filled.chain.settings.signers.orderer, 0, 0)) == ("FORBIDDEN", 0)


async def test_a_revoked_readers_open_streams_end(filled):
    call = filled.seek(filled.signing("uav"), 0)
    events = filled.network("uav").chaincode_events("pol", start_block=0)
    reading = asyncio.ensure_future(responses(call))
    async with events:
        await anext(events)
        await anext(events)
        filled.ledger.directory.ca("FleetMSP").revoke(name="uav")
        await filled.ledger.refresh_revocations()
        found = await asyncio.wait_for(reading, 5)
        assert common_pb2.Status.Name(found[-1].status) == "FORBIDDEN"
        assert [each.block.header.number for each in found[:-1]] == [0, 1, 2, 3]
        with pytest.raises(Exception, match="revoked") as caught:
            await asyncio.wait_for(anext(events), 5)
        assert caught.value.status_code is grpc.StatusCode.PERMISSION_DENIED


async def test_the_config_block_of_a_revocation_carries_the_list(filled):
    filled.ledger.directory.ca("FleetMSP").revoke(name="uav")
    number = await filled.ledger.refresh_revocations()
    block = parse_block(filled.chain.block(number))
    assert block.config.sequence == 1
    assert len(block.config.organisations["FleetMSP"].revocation_lists) == 1
    assert not block.config.organisations["PadMSP"].revocation_lists
    await filled.contract().submit("put", "k", "v")
    last = common_pb2.Block.FromString(filled.chain.block(number + 1))
    slot = common_pb2.Metadata.FromString(last.metadata.metadata[common_pb2.SIGNATURES])
    assert common_pb2.OrdererBlockMetadata.FromString(slot.value).last_config.index == number


async def test_events_from_a_block_and_after_a_transaction(filled):
    async with filled.network("uav").chaincode_events("pol", start_block=0) as events:
        first, second = await anext(events), await anext(events)
    assert [(each.block_number, each.payload) for each in (first, second)] == [(1, b"1"), (3, b"3")]
    async with filled.network("uav").chaincode_events("pol", start_block=1, after_transaction_id=first.tx_id) as events:
        assert (await anext(events)).tx_id == second.tx_id


async def test_events_of_now_on_and_only_of_valid_transactions(world):
    async with world.network("uav").chaincode_events("pol") as events:
        stale = await world.contract().propose("increment", "n").endorse()
        await world.contract().submit("increment", "n")
        commit = await stale.submit()
        assert (await commit.status()).code == 11
        done = await world.contract().submit("put", "k", "v", "Told")
        event = await asyncio.wait_for(anext(events), 5)
        assert (event.tx_id, event.name, event.block_number) == (done.tx_id, "Told", done.block_number)


async def test_events_resume_over_a_restart_without_gap_or_double(tmp_path, open_world):
    checkpointer = FileCheckpointer(tmp_path / "checkpoint.json")
    seen = []
    for round_ in range(3):
        async with open_world(tmp_path / "ledger") as world:
            for index in range(4):
                await world.contract().submit("put", "k", f"{round_}-{index}", "E")
            events = world.network("uav").chaincode_events("pol", start_block=0, checkpointer=checkpointer)
            async with events:
                while len(seen) < 4 * round_ + 3:  # leave one over each time
                    event = await asyncio.wait_for(anext(events), 5)
                    seen.append(event.payload.decode())
                    checkpointer.save(event.checkpoint)
    assert seen == [f"{round_}-{index}" for round_ in range(3) for index in range(4)][:11]


async def test_an_event_request_must_be_signed_and_well_formed(filled):
    who = filled.signing("uav")
    request = gateway_pb2.ChaincodeEventsRequest(channel_id="wonderland", chaincode_id="pol", identity=who.creator)
    other = filled.signing("pad")

    async def code(request_bytes, signature):
        data = gateway_pb2.SignedChaincodeEventsRequest(request=request_bytes, signature=signature).SerializeToString()
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await anext(
                aiter(filled.channel.preferred.unary_stream("/gateway.Gateway/ChaincodeEvents")(data, timeout=5))
            )
        return caught.value.code()

    data = request.SerializeToString()
    assert await code(data, other.sign(data)) is grpc.StatusCode.PERMISSION_DENIED
    assert await code(b"", b"") is grpc.StatusCode.INVALID_ARGUMENT
    assert await code(b"\xff", b"") is grpc.StatusCode.INVALID_ARGUMENT
    request.start_position.oldest.SetInParent()
    data = request.SerializeToString()
    assert await code(data, who.sign(data)) is grpc.StatusCode.INVALID_ARGUMENT
    request.channel_id = "other"
    data = request.SerializeToString()
    assert await code(data, who.sign(data)) is grpc.StatusCode.FAILED_PRECONDITION


async def test_streams_are_counted_and_end_when_the_ledger_stops(tmp_path, open_world):
    async with open_world(tmp_path / "l") as world:
        reading = asyncio.ensure_future(status_of(world.seek(world.signing(), 0)))
        events = world.network().chaincode_events("pol")
        async with events:
            waiting = asyncio.ensure_future(anext(events))
            await asyncio.sleep(0.1)
            started = asyncio.get_running_loop().time()
            await world.ledger.stop()
            assert asyncio.get_running_loop().time() - started < 1.5
            assert await reading == ("SERVICE_UNAVAILABLE", 1)
            with pytest.raises(Exception, match="stopping"):
                await waiting


@given(data=st.binary(max_size=40_000), field=st.integers(1, 15))
@settings(max_examples=50, deadline=None)
def test_wrapping_by_hand_is_what_protobuf_does(data, field):
    wrapped = length_delimited(2, data)
    message = common_pb2.Envelope.FromString(wrapped)  # field 2 of Envelope is bytes
    assert message.signature == data
    assert message.SerializeToString() == wrapped or not data
    assert length_delimited(field, data)[1:] == wrapped[1:]
