"""The Gateway client against a server that fails on purpose: lost answers, forged answers, garbage."""

from __future__ import annotations

import asyncio
import contextlib
import itertools

import grpc
import pytest
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.orderer import ab_pb2
from fabric_protos.peer import events_pb2, proposal_pb2
from google.rpc import status_pb2
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from kit.scripted_gateway import UNAVAILABLE, FailError, Scripted, details, hang, serving

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.errors import BlockError, LedgerError
from wonderland_fabric_gateway.gateway import (
    CommitError,
    CommitStatusError,
    CommitUnknownError,
    Deadlines,
    EndorseError,
    EvaluateError,
    Gateway,
    GatewayError,
    MalformedError,
    StreamError,
    SubmitError,
    UnknownTransactionError,
)
from wonderland_fabric_gateway.gateway.backoff import Backoff
from wonderland_fabric_gateway.signing import SignatureError, verify
from wonderland_fabric_gateway.transactions import ValidationCode

MODERATE = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
async def server(maker):
    async with serving(Scripted(maker)) as scripted:
        yield scripted


@pytest.fixture
async def gateway(server, pad):
    async with grpc.aio.insecure_channel(f"127.0.0.1:{server.port}") as channel:
        limits = Deadlines(evaluate_s=1, endorse_s=1, submit_s=0.5, commit_status_s=1.0, locate_s=0.3, catch_up_s=0.05)
        # Pauses are as short as can be: randomness that says zero.
        yield Gateway(channel, pad.identity, pad.signer, deadlines=limits, random_bytes=bytes)


@pytest.fixture
def network(gateway):
    return gateway.network("wonderland")


@pytest.fixture
def contract(network):
    return network.contract("pol")


async def test_the_whole_way(contract, server):
    done = await contract.submit("put", "a")
    assert (done.payload, done.block_number) == (b"answer", 9)
    assert [name for name, _ in server.calls] == ["Endorse", "Submit", "CommitStatus"]


async def test_what_is_sent_is_signed_over_exactly_these_bytes(contract, server, pad):
    await contract.submit("put", "a")
    endorse, submit, status = (request for _, request in server.calls)
    proposed = gateway_pb2.EndorseRequest.FromString(endorse).proposed_transaction
    verify(pad.identity.public_key, proposed.proposal_bytes, proposed.signature)
    envelope = gateway_pb2.SubmitRequest.FromString(submit).prepared_transaction
    verify(pad.identity.public_key, envelope.payload, envelope.signature)
    asked = gateway_pb2.SignedCommitStatusRequest.FromString(status)
    verify(pad.identity.public_key, asked.request, asked.signature)
    with pytest.raises(SignatureError):
        verify(pad.identity.public_key, asked.request + b"x", asked.signature)


async def test_transient_data_and_organisations_are_sent(contract, server):
    await contract.evaluate("get", "a", transient={"secret": b"s"}, endorsing_organizations=["PadMSP"])
    request = gateway_pb2.EvaluateRequest.FromString(server.calls[0][1])
    proposal = proposal_pb2.Proposal.FromString(request.proposed_transaction.proposal_bytes)
    payload = proposal_pb2.ChaincodeProposalPayload.FromString(proposal.payload)
    assert dict(payload.TransientMap) == {"secret": b"s"}
    assert list(request.target_organizations) == ["PadMSP"]


@pytest.mark.parametrize("lost", [UNAVAILABLE, FailError(grpc.StatusCode.INTERNAL, "stream reset"), hang])
async def test_a_lost_answer_to_submit_means_asking_for_the_outcome(contract, server, lost):
    server.line_up("Submit", lost)
    done = await contract.submit("put", "a")
    assert done.block_number == 9
    assert server.counted("Submit") == 1  # never sent twice
    assert server.counted("Endorse") == 1


async def test_a_lost_answer_and_an_invalid_transaction(contract, server):
    server.line_up("Submit", UNAVAILABLE)
    answer = gateway_pb2.CommitStatusResponse(result=ValidationCode.MVCC_READ_CONFLICT, block_number=4)
    server.line_up("CommitStatus", answer.SerializeToString())
    with pytest.raises(CommitError) as caught:
        await contract.submit("put", "a")
    assert (caught.value.code_name, caught.value.block_number) == ("MVCC_READ_CONFLICT", 4)


async def test_a_refused_submit_is_an_error_at_once(contract, server):
    server.line_up("Submit", FailError(grpc.StatusCode.ABORTED, "status=FORBIDDEN", details("no")))
    with pytest.raises(SubmitError) as caught:
        await contract.submit("put", "a")
    assert not caught.value.outcome_unknown
    assert caught.value.details[0].message == "no"
    assert len(caught.value.tx_id) == 64
    assert server.counted("CommitStatus") == 0


async def test_the_outcome_is_asked_for_through_interruptions(contract, server):
    server.line_up("CommitStatus", UNAVAILABLE, UNAVAILABLE, UNAVAILABLE)
    assert (await contract.submit("put", "a")).block_number == 9
    assert server.counted("CommitStatus") == 4


async def test_no_outcome_within_the_deadline_is_said_as_unknown(contract, server):
    server.line_up("Submit", *[UNAVAILABLE] * 99)
    server.line_up("CommitStatus", *[hang] * 99)
    with pytest.raises(CommitUnknownError, match="whether it arrived is unknown") as caught:
        await contract.submit("put", "a")
    assert len(caught.value.tx_id) == 64
    assert caught.value.status_code is grpc.StatusCode.DEADLINE_EXCEEDED


async def test_a_refused_question_is_not_asked_again(contract, server):
    server.line_up("CommitStatus", FailError(grpc.StatusCode.PERMISSION_DENIED, "access denied"))
    with pytest.raises(CommitStatusError, match="access denied"):
        await contract.submit("put", "a")
    assert server.counted("CommitStatus") == 1


MISMATCH = FailError(grpc.StatusCode.ABORTED, "failed to assemble transaction: ProposalResponsePayloads do not match")


async def test_peers_that_disagree_are_asked_again(contract, server):
    server.line_up("Endorse", MISMATCH, MISMATCH)
    assert (await contract.submit_with_retry("put", "a")).block_number == 9
    assert server.counted("Endorse") == 3
    ids = {
        gateway_pb2.EndorseRequest.FromString(request).transaction_id
        for name, request in server.calls
        if name == "Endorse"
    }
    assert len(ids) == 1  # this test's "randomness" repeats; the next test sees to fresh ids


async def test_each_attempt_is_a_new_transaction(server, pad):
    counter = itertools.count()
    server.line_up("Endorse", MISMATCH, MISMATCH)
    async with grpc.aio.insecure_channel(f"127.0.0.1:{server.port}") as channel:
        gateway = Gateway(
            channel, pad.identity, pad.signer, random_bytes=lambda length: next(counter).to_bytes(length, "big")
        )
        await gateway.network("wonderland").contract("pol").submit_with_retry("put", "a")
    ids = [
        gateway_pb2.EndorseRequest.FromString(request).transaction_id
        for name, request in server.calls
        if name == "Endorse"
    ]
    assert len(set(ids)) == 3


async def test_attempts_have_an_end(contract, server):
    server.line_up("Endorse", *[MISMATCH] * 9)
    with pytest.raises(EndorseError) as caught:
        await contract.submit_with_retry("put", "a", attempts=3)
    assert caught.value.is_mismatch
    assert server.counted("Endorse") == 3


@pytest.mark.parametrize(
    "refusal",
    [
        FailError(grpc.StatusCode.ABORTED, "see details", details("chaincode response 409, CONFLICT: no")),
        FailError(grpc.StatusCode.UNAVAILABLE, "no peers"),
    ],
)
async def test_other_refusals_are_not_tried_again(contract, server, refusal):
    server.line_up("Endorse", refusal)
    with pytest.raises(EndorseError):
        await contract.submit_with_retry("put", "a")
    assert server.counted("Endorse") == 1


def committed_as(code):
    return gateway_pb2.CommitStatusResponse(result=code, block_number=9).SerializeToString()


UNENDORSED = committed_as(ValidationCode.ENDORSEMENT_POLICY_FAILURE)


async def test_an_endorsement_that_was_not_enough_is_tried_once_more(contract, server):
    """The key may have been made, and given its own policy, in the same block."""
    server.line_up("CommitStatus", UNENDORSED)
    assert (await contract.submit_with_retry("put", "a")).block_number == 9
    assert server.counted("Endorse") == 2
    server.line_up("CommitStatus", UNENDORSED, committed_as(ValidationCode.MVCC_READ_CONFLICT), UNENDORSED)
    with pytest.raises(CommitError, match="ENDORSEMENT_POLICY_FAILURE"):
        await contract.submit_with_retry("put", "a")
    assert server.counted("Endorse") == 5
    server.line_up("CommitStatus", committed_as(ValidationCode.BAD_CREATOR_SIGNATURE))
    with pytest.raises(CommitError, match="BAD_CREATOR_SIGNATURE"):
        await contract.submit_with_retry("put", "a")
    assert server.counted("Endorse") == 6


async def test_a_transaction_without_an_outcome_is_handed_over_again(server, pad):
    """The orderer that acknowledged it may be gone, and it with it; the very same bytes cannot take effect twice."""
    server.line_up("Submit", UNAVAILABLE, UNAVAILABLE, b"", b"")
    server.line_up("CommitStatus", hang, hang, hang)
    async with grpc.aio.insecure_channel(f"127.0.0.1:{server.port}") as channel:
        gateway = Gateway(channel, pad.identity, pad.signer, deadlines=Deadlines(resubmit_s=0.2))
        done = await gateway.network("wonderland").contract("pol").submit("put", "a")
    assert done.block_number == 9
    sent = [request for name, request in server.calls if name == "Submit"]
    assert len(sent) == 4
    assert len(set(sent)) == 1
    assert server.counted("Endorse") == 1


async def test_refused_the_second_time_the_first_counts(contract, server):
    """An orderer that has it already may refuse it; then the outcome is that of the first."""
    server.line_up("Submit", UNAVAILABLE, FailError(grpc.StatusCode.ABORTED, "status=BAD_REQUEST"))
    server.line_up("CommitStatus", UNAVAILABLE)
    assert (await contract.submit("put", "a")).block_number == 9
    assert server.counted("Submit") == 2


async def test_peers_that_do_not_know_each_other_yet_are_asked_again(contract, server):
    young = (
        "no combination of peers can be derived which satisfy the endorsement policy: required chaincodes are absent"
    )
    server.line_up("Endorse", *[FailError(grpc.StatusCode.FAILED_PRECONDITION, young)] * 7)
    assert (await contract.submit_with_retry("put", "a")).block_number == 9
    assert server.counted("Endorse") == 8


async def test_an_unknown_outcome_is_not_tried_again(contract, server):
    server.line_up("CommitStatus", *[hang] * 99)
    with pytest.raises(CommitUnknownError):
        await contract.submit_with_retry("put", "a")
    assert server.counted("Endorse") == 1


async def test_another_transaction_than_the_one_proposed_is_not_signed(contract, server, maker):
    other_header = maker.header(nonce=b"o" * 24)
    server.line_up("Endorse", lambda request: server.endorsed(request, header=other_header))
    with pytest.raises(EndorseError, match="another transaction"):
        await contract.submit("put", "a")
    other_arguments = proposal_pb2.ChaincodeProposalPayload(input=b"").SerializeToString() or b"\x12\x00"
    server.line_up("Endorse", lambda request: server.endorsed(request, payload=other_arguments))
    with pytest.raises(EndorseError, match="another transaction"):
        await contract.submit("put", "a")
    assert server.counted("Submit") == 0


@pytest.mark.parametrize("garbage", [b"\xff\xff\xff", b"\x0a\x03abc", b""])
async def test_an_answer_that_is_none(contract, server, garbage):
    server.line_up("Endorse", garbage)
    with pytest.raises(GatewayError):
        await contract.submit("put", "a")


@MODERATE
@given(data=st.binary(max_size=60))
async def test_any_answer_is_a_typed_error_or_a_result(contract, server, data):
    server.line_up("Evaluate", data)
    server.line_up("Endorse", data)
    with contextlib.suppress(GatewayError):
        await contract.evaluate("get", "a")
    with pytest.raises(GatewayError):
        await contract.propose("put").endorse()
    server.script.clear()


@MODERATE
@given(data=st.binary(max_size=80))
async def test_garbage_in_the_details_hides_no_error(contract, server, data):
    server.line_up("Evaluate", FailError(grpc.StatusCode.UNKNOWN, "the reason", (("grpc-status-details-bin", data),)))
    with pytest.raises(EvaluateError, match="the reason") as caught:
        await contract.evaluate("get", "a")
    assert caught.value.status_code is grpc.StatusCode.UNKNOWN


async def test_details_of_a_foreign_type_are_left_out(contract, server):
    status = status_pb2.Status()
    status.details.add().Pack(status_pb2.Status(message="x"))
    trailers = (("grpc-status-details-bin", status.SerializeToString()), ("other", "x"))
    server.line_up("Evaluate", FailError(grpc.StatusCode.UNKNOWN, "the reason", trailers))
    with pytest.raises(EvaluateError) as caught:
        await contract.evaluate("get", "a")
    assert caught.value.details == ()


async def test_several_peers_have_their_say(contract, server):
    server.line_up(
        "Endorse", FailError(grpc.StatusCode.ABORTED, "see details", details("one", "chaincode response 422, X: y"))
    )
    with pytest.raises(EndorseError) as caught:
        await contract.submit("put", "a")
    error = caught.value
    assert [each.message for each in error.details] == ["one", "chaincode response 422, X: y"]
    assert error.chaincode_response.status == 422
    assert "PadMSP at peer:1: one" in str(error)


async def test_nobody_listens(pad):
    async with grpc.aio.insecure_channel("127.0.0.1:1") as channel:
        contract = Gateway(channel, pad.identity, pad.signer).network("wonderland").contract("pol")
        with pytest.raises(EndorseError) as caught:
            await contract.submit("put", "a")
    assert caught.value.status_code is grpc.StatusCode.UNAVAILABLE


@pytest.fixture
def chain(maker):
    """Three blocks, as answers of Deliver."""
    messages = []
    previous = b"p" * 32
    for number in (5, 6, 7):
        message = maker.block([maker.transaction()], number=number, previous=previous)
        previous = parse_block(message).header.hash
        messages.append(events_pb2.DeliverResponse(block=message))
    return messages


def status(name):
    return events_pb2.DeliverResponse(status=common_pb2.Status.Value(name))


async def collect(stream, count):
    async with asyncio.timeout(5), stream:
        return [await anext(stream) for _ in range(count)]


async def test_a_stream_continues_where_it_was_interrupted(network, server, chain, caplog):
    caplog.set_level("INFO", logger="wonderland_fabric_gateway.gateway.streams")
    server.line_up(
        "Deliver", [chain[0], UNAVAILABLE], [UNAVAILABLE], [chain[1], status("SERVICE_UNAVAILABLE")], [chain[2], None]
    )
    blocks = await collect(network.blocks(start_block=5, reconnect=True), 3)
    assert [block.number for block in blocks] == [5, 6, 7]
    starts = []
    for name, data in server.calls:
        if name == "DeliverFiltered":  # how long the chain is, before continuing
            continue
        payload = common_pb2.Payload.FromString(common_pb2.Envelope.FromString(data).payload)
        starts.append(ab_pb2.SeekInfo.FromString(payload.data).start.specified.number)
    assert starts == [5, 6, 6, 7]
    said = [record.getMessage().split(": ")[1].split(",")[0] for record in caplog.records]
    assert said == ["the ledger is not heard", "the ledger is heard again"] * 2, "once for each outage"


async def test_a_ledger_that_became_shorter_is_noticed(network, server, chain):
    """Set up anew behind our back: waiting for its blocks would be silence, then another history."""
    server.line_up("Deliver", [chain[0], chain[1], UNAVAILABLE])
    server.newest = 3
    stream = network.blocks(start_block=5, reconnect=True)
    assert [(await anext(stream)).number for _ in range(2)] == [5, 6]
    with pytest.raises(UnknownTransactionError, match="4 blocks"):
        await anext(stream)


@pytest.mark.parametrize("ended", [[], [status("SUCCESS")]])
async def test_a_stream_that_just_ends_is_opened_again(network, server, chain, ended):
    server.line_up("Deliver", [chain[0], *ended], [chain[1], None])
    assert len(await collect(network.blocks(start_block=5, reconnect=True), 2)) == 2


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("FORBIDDEN", grpc.StatusCode.PERMISSION_DENIED),
        ("NOT_FOUND", grpc.StatusCode.NOT_FOUND),
        ("BAD_REQUEST", grpc.StatusCode.INVALID_ARGUMENT),
    ],
)
async def test_what_waiting_cannot_cure_is_raised(network, server, chain, name, code):
    server.line_up("Deliver", [chain[0], status(name)])
    stream = network.blocks(start_block=5, reconnect=True)
    assert (await anext(stream)).number == 5
    with pytest.raises(StreamError, match=name) as caught:
        await anext(stream)
    assert caught.value.status_code is code
    with pytest.raises(StopAsyncIteration):
        await anext(stream)


async def test_a_gap_is_an_error(network, server, chain):
    server.line_up("Deliver", [chain[0], chain[2]])
    stream = network.blocks(start_block=5, reconnect=True)
    await anext(stream)
    with pytest.raises(StreamError, match="block 7 instead of 6"):
        await anext(stream)


async def test_a_block_whose_contents_were_changed_ends_the_stream(network, server, chain):
    chain[0].block.data.data[0] += b"x"
    server.line_up("Deliver", [chain[0], chain[1]])
    stream = network.blocks(start_block=5, reconnect=True)
    with pytest.raises(BlockError, match="data_hash"):
        await anext(stream)
    with pytest.raises(StopAsyncIteration):
        await anext(stream)


@MODERATE
@given(data=st.binary(max_size=80))
async def test_any_answer_on_a_stream_is_a_typed_error(network, server, data):
    server.line_up("Deliver", [data])
    server.line_up("DeliverFiltered", [data])
    with pytest.raises(LedgerError):
        await anext(network.blocks(start_block=5))
    with contextlib.suppress(LedgerError):
        await anext(network.filtered_blocks(start_block=0))
    server.script.clear()


@MODERATE
@given(data=st.binary(max_size=80))
async def test_any_event_answer_is_a_typed_error_or_an_event(network, server, data):
    server.line_up("ChaincodeEvents", [data])
    stream = network.chaincode_events("pol", start_block=0)
    try:
        await anext(stream)
    except LedgerError:
        pass
    finally:
        stream.close()
    server.script.clear()


async def test_a_ledger_that_does_not_answer_while_a_place_is_sought(network, server):
    """No verdict over the transaction: the ledger was silent, and that can be cured by waiting."""
    server.line_up("DeliverFiltered", [None])
    with pytest.raises(StreamError) as caught:
        await anext(network.chaincode_events("pol", after_transaction_id="a" * 64))
    assert caught.value.status_code is grpc.StatusCode.DEADLINE_EXCEEDED


async def test_malformed_is_told_from_unreachable(network, server):
    server.line_up("DeliverFiltered", [b"\xff\xff\xff"])
    with pytest.raises(MalformedError):
        await network.height()


def test_pauses_grow_have_a_limit_and_are_random():
    longest = Backoff(lambda length: b"\xff" * length, first_s=0.1, max_s=0.5)
    assert [longest.next_s() for _ in range(5)] == [0.1, 0.2, 0.4, 0.5, 0.5]
    longest.reset()
    assert longest.next_s() == 0.1
    shortest = Backoff(bytes)
    assert 0 < shortest.next_s() < 1e-6
