"""The Gateway's calls as a client sees them: results, refusals and their details."""

import asyncio
import datetime as dt
import json
from contextlib import AsyncExitStack

import grpc
import pytest
from fabric_protos.common import common_pb2, ledger_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import query_pb2, transaction_pb2
from google.rpc import status_pb2
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.gateway import CommitError, EndorseError, EvaluateError, SubmitError


def details_of(error):
    data = dict(error.trailing_metadata())["grpc-status-details-bin"]
    return [gateway_pb2.ErrorDetail.FromString(each.value) for each in status_pb2.Status.FromString(data).details]


async def test_submit_then_evaluate(world):
    done = await world.contract("pad").submit("put", "key", "value")
    assert done.payload == b"value"
    assert done.block_number == 1
    assert await world.contract("uav").evaluate("get", "key") == b"value"


async def test_evaluate_changes_nothing(world):
    assert await world.contract().evaluate("put", "key", "value") == b"value"
    assert world.chain.height == 1
    assert await world.contract().evaluate("get", "key") == b"<none>"


async def test_a_transaction_does_not_read_its_own_writes(world):
    assert (await world.contract().submit("put_then_get", "key", "new")).payload == b"<none>"
    assert (await world.contract().submit("put_then_get", "key", "newer")).payload == b"new"


async def test_the_contract_sees_who_calls(world):
    identity = world.connection.identity("uav")
    seen = json.loads(await world.contract("uav").evaluate("whoami"))
    assert seen["msp_id"] == "FleetMSP"
    assert (seen["role"], seen["pol_id"], seen["common_name"], seen["node_ou"]) == ("uav", "uav-1", "uav", "client")
    assert seen["attributes"] == {"pol.role": "uav", "pol.id": "uav-1"}
    assert seen["certificate_sha256"] == identity.certificate_sha256
    assert bytes.fromhex(seen["public_key"]) == identity.public_key_bytes
    assert seen["channel"] == "wonderland"
    assert len(seen["tx_id"]) == 64
    assert abs(seen["timestamp_ms"] - dt.datetime.now(dt.UTC).timestamp() * 1000) < 5000


async def test_history_is_newest_first_with_deletions(world):
    contract = world.contract()
    first = await contract.submit("put", "key", "1")
    second = await contract.submit("delete", "key")
    third = await contract.submit("put", "key", "3")
    rows = json.loads(await contract.evaluate("history", "key"))
    assert [row[0] for row in rows] == [third.tx_id, second.tx_id, first.tx_id]
    assert [row[2:] for row in rows] == [["3", False], ["", True], ["1", False]]


async def test_ranges_are_in_utf8_order_and_leave_composite_keys_out(world):
    contract = world.contract()
    for key in ("b", "a", "é", "𝄞", "\ufffd", "z", "\0type\0x\0"):
        await contract.submit("put", key, "v")
    assert list(json.loads(await contract.evaluate("range", "", ""))) == ["a", "b", "z", "é", "\ufffd", "𝄞"]
    assert list(json.loads(await contract.evaluate("range", "a", "z"))) == ["a", "b"]
    assert list(json.loads(await contract.evaluate("range", "\0type\0", "\0type\0\U0010ffff"))) == ["\0type\0x\0"]


async def test_a_refusal_by_the_contract_at_endorse(world, make_proposal):
    proposal = make_proposal(world.signing(), "refuse", "403", "NOT_YOURS: not your pad; ask its operator")
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        await world.endorse(proposal)
    assert caught.value.code() is grpc.StatusCode.ABORTED
    assert caught.value.details() == "failed to endorse transaction, see attached details for more info"
    (detail,) = details_of(caught.value)
    assert detail.msp_id == "AuthorityMSP"
    assert detail.address == world.connection.gateway.address
    assert detail.message == "chaincode response 403, NOT_YOURS: not your pad; ask its operator"


async def test_a_refusal_by_the_contract_at_evaluate(world):
    with pytest.raises(EvaluateError) as caught:
        await world.contract().evaluate("refuse", "404", "NOT_FOUND: no such pad")
    assert caught.value.status_code is grpc.StatusCode.UNKNOWN
    assert caught.value.message == (
        "evaluate call to endorser returned error: chaincode response 404, NOT_FOUND: no such pad"
    )
    assert caught.value.chaincode_response.status == 404


@pytest.mark.parametrize("function", ["crash", "wait", "return_text"])
async def test_a_fault_of_the_contract_shows_a_reference_and_no_more(world, function, caplog):
    with pytest.raises(EndorseError) as caught:
        await world.contract().submit(function)
    response = caught.value.chaincode_response
    assert response.status == 500
    reference = response.message.split("reference ")[1][:8]
    assert reference in caplog.text
    assert "Traceback" not in str(caught.value)
    assert "ZeroDivision" not in str(caught.value)
    assert await world.contract().evaluate("get", "x") == b"<none>"


async def test_an_unusable_key_is_the_contracts_refusal(world):
    with pytest.raises(EndorseError) as caught:
        await world.contract().submit("empty_key")
    assert caught.value.chaincode_response.status == 400


@pytest.mark.parametrize(("count", "size"), [(1, (4 << 20) + 1), (3, 3 << 20), (10_001, 1)])
async def test_too_much_written_in_one_transaction(world, count, size):
    with pytest.raises(EndorseError) as caught:
        await world.contract().submit("big", str(count), str(size))
    assert caught.value.chaincode_response.status == 413


async def test_a_large_transaction_passes_whole(world):
    done = await world.contract().submit("big", "7", "900000")
    assert (await world.contract("uav").evaluate("get", "big1")) == b"x" * 900_000
    assert len(world.chain.block(done.block_number)) > 6_300_000


async def test_an_overloaded_ledger_says_that_nothing_was_taken(world):
    world.chain._cutter._bytes = 1 << 40
    with pytest.raises(SubmitError) as caught:
        await world.contract().submit("put", "k", "v")
    assert caught.value.status_code is grpc.StatusCode.RESOURCE_EXHAUSTED
    assert not caught.value.outcome_unknown
    world.chain._cutter._bytes = 0
    assert (await world.contract().submit("put", "k", "v")).block_number == 1


async def test_long_and_foreign_error_texts_fit_into_trailers(world):
    with pytest.raises(EvaluateError) as caught:
        await world.contract().evaluate("refuse", "400", "é" * 50_000)
    assert caught.value.chaincode_response.message.startswith("é" * 400)


async def test_an_unknown_chaincode_and_channel_are_named(world, make_proposal):
    with pytest.raises(EvaluateError, match="chaincode nix in channel wonderland"):
        await world.contract(chaincode="nix").evaluate("get", "x")
    request = gateway_pb2.EvaluateRequest(
        proposed_transaction=make_proposal(world.signing(), "get", "x", channel="other").signed
    )
    with pytest.raises(grpc.aio.AioRpcError, match="channel 'other' not found") as caught:
        await world.unary("Evaluate", request)
    assert caught.value.code() is grpc.StatusCode.FAILED_PRECONDITION


async def test_endorsing_organisations_must_be_ones_that_endorse(world):
    with pytest.raises(EndorseError, match=r"org\(s\): FleetMSP") as caught:
        await world.contract().submit("put", "k", "v", endorsing_organizations=["FleetMSP"])
    assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE


async def test_too_few_endorsers_fail_the_policy_at_commit(world):
    with pytest.raises(CommitError) as caught:
        await world.contract().submit("put", "k", "v", endorsing_organizations=["AuthorityMSP"])
    assert caught.value.code_name == "ENDORSEMENT_POLICY_FAILURE"
    assert await world.contract().evaluate("get", "k") == b"<none>"
    assert (
        await world.contract().submit("put", "k", "v", endorsing_organizations=["PadMSP", "AuthorityMSP"])
    ).block_number == 2


async def test_concurrent_increments_lose_nothing(world):
    results = await asyncio.gather(
        *(world.contract().submit("increment", "counter") for _ in range(12)), return_exceptions=True
    )
    good = [each for each in results if not isinstance(each, Exception)]
    bad = [each for each in results if isinstance(each, Exception)]
    assert good
    assert {each.code_name for each in bad} <= {"MVCC_READ_CONFLICT"}
    assert int(await world.contract().evaluate("get", "counter")) == len(good)
    done = await asyncio.gather(*(world.contract().submit_with_retry("increment", "c2", attempts=40) for _ in range(5)))
    assert len({each.payload for each in done}) == 5


async def test_status_of_an_unknown_transaction_waits(world):
    with pytest.raises(asyncio.TimeoutError):
        await asyncio.wait_for(world.status("00" * 32), 0.2)
    await asyncio.sleep(0.05)
    assert not world.chain._waiters


async def test_status_asked_before_submit_is_answered_at_commit(world, make_proposal):
    who = world.signing()
    proposal = make_proposal(who, "put", "k", "v")
    waiting = asyncio.ensure_future(world.status(proposal.tx_id))
    envelope = await world.endorse(proposal)
    envelope.signature = who.sign(envelope.payload)
    await world.submit(proposal.tx_id, envelope)
    assert await waiting == (transaction_pb2.VALID, 1)


async def test_describe_says_that_it_is_no_multi_party_ledger(world):
    about = json.loads(await world.contract("mirror", "_ledger").evaluate("Describe"))
    assert about["kind"] == "embedded"
    assert about["notice"] == NOTICE
    assert about["height"] == 1
    assert about["contracts"] == {"pol": "toy-1"}
    assert world.connection.ledger.notice == NOTICE


async def test_only_administrators_may_refresh_revocations(world):
    with pytest.raises(EvaluateError, match="chaincode response 403"):
        await world.contract("admin", "_ledger").evaluate("RefreshRevocations")


async def test_qscc_and_cscc(world):
    done = await world.contract().submit("put", "k", "v")
    qscc, cscc = world.contract(chaincode="qscc"), world.contract(chaincode="cscc")
    info = ledger_pb2.BlockchainInfo.FromString(await qscc.evaluate("GetChainInfo", "wonderland"))
    assert info.height == 2
    block = common_pb2.Block.FromString(await qscc.evaluate("GetBlockByNumber", "wonderland", "1"))
    assert block.header.previous_hash == info.previousBlockHash
    assert await qscc.evaluate("GetBlockByHash", "wonderland", info.currentBlockHash) == block.SerializeToString()
    assert await qscc.evaluate("GetBlockByTxID", "wonderland", done.tx_id) == block.SerializeToString()
    found = transaction_pb2.ProcessedTransaction.FromString(
        await qscc.evaluate("GetTransactionByID", "wonderland", done.tx_id)
    )
    assert found.validationCode == transaction_pb2.VALID
    assert found.transactionEnvelope.SerializeToString() == block.data.data[0]
    config = common_pb2.Block.FromString(await cscc.evaluate("GetConfigBlock", "wonderland"))
    assert config.header.number == 0
    channels = query_pb2.ChannelQueryResponse.FromString(await cscc.evaluate("GetChannels"))
    assert [each.channel_id for each in channels.channels] == ["wonderland"]


@pytest.mark.parametrize(
    "args",
    [
        ("qscc",),
        ("qscc", "GetChainInfo"),
        ("qscc", "GetChainInfo", "other"),
        ("qscc", "GetBlockByNumber", "wonderland", "-1"),
        ("qscc", "GetBlockByNumber", "wonderland", "99999999999999999999"),
        ("qscc", "GetBlockByNumber", "wonderland", "9999999999999999999"),
        ("qscc", "GetBlockByNumber", "wonderland", "7"),
        ("qscc", "GetBlockByHash", "wonderland", "x"),
        ("qscc", "GetTransactionByID", "wonderland", "x"),
        ("qscc", "GetBlockByTxID", "wonderland", b"\xff"),
        ("qscc", "Nonsense", "wonderland", "x"),
        ("cscc", "Nonsense"),
        ("cscc", "GetConfigBlock"),
        ("_ledger", "Nonsense"),
    ],
)
async def test_bad_system_queries_are_refused_with_a_status(world, make_proposal, args):
    chaincode, *rest = args
    request = gateway_pb2.EvaluateRequest(
        proposed_transaction=make_proposal(world.signing(), *rest, chaincode=chaincode).signed
    )
    with pytest.raises(grpc.aio.AioRpcError, match=r"chaincode response [45]"):
        await world.unary("Evaluate", request)


async def test_system_queries_cannot_be_endorsed(world):
    with pytest.raises(EndorseError, match="only evaluates"):
        await world.contract(chaincode="qscc").submit("GetChainInfo", "wonderland")


@given(data=st.binary(max_size=200), method=st.sampled_from(["Evaluate", "Endorse", "Submit", "CommitStatus"]))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_garbage_is_answered_and_never_an_internal_error(shared_world, data, method):
    runner, world = shared_world
    with pytest.raises(grpc.aio.AioRpcError) as caught:
        runner.run(world.unary(method, data))
    assert caught.value.code() in {
        grpc.StatusCode.INVALID_ARGUMENT,
        grpc.StatusCode.FAILED_PRECONDITION,
        grpc.StatusCode.ABORTED,
    }


@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_requests_are_answered_and_never_an_internal_error(shared_world, make_proposal, data):
    runner, world = shared_world
    good = gateway_pb2.EndorseRequest(
        proposed_transaction=make_proposal(world.signing(), "put", "k", "v").signed
    ).SerializeToString()
    damaged = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, 1 << 16)) % len(damaged)] = data.draw(st.integers(0, 255))
    damaged = bytes(damaged[: 1 + data.draw(st.integers(0, 1 << 16)) % len(damaged)])
    code = runner.run(code_of(world.unary("Endorse", damaged)))
    assert code not in {grpc.StatusCode.INTERNAL, grpc.StatusCode.UNKNOWN}


async def code_of(call):
    try:
        await call
    except grpc.aio.AioRpcError as error:
        return error.code()
    return grpc.StatusCode.OK


@pytest.fixture(scope="module")
def shared_world(tmp_path_factory, open_world):
    """One ledger for all examples of a property, with its own event loop."""
    with asyncio.Runner() as runner:
        stack = AsyncExitStack()
        directory = tmp_path_factory.mktemp("shared") / "ledger"
        world = runner.run(stack.enter_async_context(open_world(directory)))
        yield runner, world
        runner.run(stack.aclose())
