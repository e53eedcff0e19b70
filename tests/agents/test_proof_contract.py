"""The contract as its users see it: what is final, what may be tried again, what is kept out."""

from __future__ import annotations

import grpc
import pytest

from wonderland.proof_contract import MAX_NOTE, AwayError, Committed, ProofContract, RefusedError, _note
from wonderland_fabric_gateway.gateway import Event, Submitted
from wonderland_fabric_gateway.gateway.errors import (
    CommitError,
    CommitUnknownError,
    EndorseError,
    ErrorDetail,
    EvaluateError,
    GatewayError,
    SubmitError,
)


class Stream:
    def __init__(self, items):
        self.items = list(items)
        self.closed = False

    def __aiter__(self):
        return self

    async def __anext__(self):
        if not self.items:
            raise StopAsyncIteration
        item = self.items.pop(0)
        if isinstance(item, Exception):
            raise item
        return item

    def close(self):
        self.closed = True


class Network:
    name = "wonderland"

    def __init__(self, outcome=None, stream=None):
        self.outcome = outcome
        self.stream = stream

    def contract(self, chaincode):
        return self

    def chaincode_events(self, chaincode, **where):
        return self.stream

    async def evaluate(self, function, argument):
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome

    submit_with_retry = evaluate

    async def leave_if_behind(self):
        pass


def contract(outcome=None, stream=None):
    return ProofContract(Network(outcome, stream), "pol")


def detail(text):
    return (ErrorDetail("peer:7051", "PadMSP", text),)


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (
            EndorseError(
                "x",
                status_code=grpc.StatusCode.ABORTED,
                details=detail("chaincode response 422, SESSION_EXPIRED: too late"),
            ),
            422,
            "SESSION_EXPIRED",
        ),
        (
            EvaluateError("chaincode response 404, PAD_UNKNOWN: no pad", status_code=grpc.StatusCode.UNKNOWN),
            404,
            "PAD_UNKNOWN",
        ),
        (
            EvaluateError("chaincode response 500, internal trouble", status_code=grpc.StatusCode.UNKNOWN),
            500,
            "REFUSED",
        ),
        (CommitError(tx_id="t", code=10, block_number=4), 0, "ENDORSEMENT_POLICY_FAILURE"),
        (SubmitError("no", status_code=grpc.StatusCode.PERMISSION_DENIED), 0, "PERMISSION_DENIED"),
    ],
)
async def test_a_refusal_is_final_and_says_why(error, status, code):
    with pytest.raises(RefusedError) as caught:
        await contract(error).read_pad("pad-1")
    assert (caught.value.status, caught.value.code) == (status, code)
    with pytest.raises(RefusedError):
        await contract(error).publish_prekeys("pad-1", ())


@pytest.mark.parametrize(
    "error",
    [
        EvaluateError("gone", status_code=grpc.StatusCode.UNAVAILABLE),
        SubmitError("slow", status_code=grpc.StatusCode.DEADLINE_EXCEEDED),
        EndorseError("disagree", status_code=grpc.StatusCode.ABORTED),
        CommitUnknownError("maybe", tx_id="t", status_code=grpc.StatusCode.UNAVAILABLE),
        GatewayError("no answer"),
    ],
)
async def test_an_absent_ledger_says_nothing_about_the_question(error):
    with pytest.raises(AwayError) as caught:
        await contract(error).read_session("a" * 64)
    assert caught.value.tx_id == error.tx_id


async def test_what_was_not_even_endorsed_can_not_be_committed():
    error = EndorseError("no peer", tx_id="t", status_code=grpc.StatusCode.UNAVAILABLE)
    with pytest.raises(AwayError) as caught:
        await contract(error).cancel("a" * 64, "test")
    assert caught.value.tx_id == ""


def refusal(text):
    said = detail(f"chaincode response {text}")
    return EndorseError("see details", status_code=grpc.StatusCode.ABORTED, details=said)


class Behind(Network):
    """Refuses some times, as a peer that has not seen the last block, and then answers."""

    def __init__(self, error, times, answer):
        super().__init__()
        self.error, self.left, self.answer = error, times, answer

    async def submit_with_retry(self, function, argument):
        self.left -= 1
        if self.left >= 0:
            raise self.error
        return Submitted("t" * 64, 7, self.answer)


@pytest.mark.parametrize(
    ("text", "way"),
    [
        ("404, SESSION_UNKNOWN: none", lambda c, s: c.cancel(s, "test")),
        ("404, SESSION_UNKNOWN: none", lambda c, s: c.complete(s, "done")),
        ("422, SESSION_REQUESTED: not decided", lambda c, s: c.complete(s, "done")),
    ],
)
async def test_a_peer_that_is_behind_is_waited_for(text, way, make_duo):
    session = make_duo().session
    known = ProofContract(Behind(refusal(text), 3, session.encode()), "pol")
    done = await way(known, session.session_id)
    assert done == (session, Committed("t" * 64, 7))


async def test_a_peer_that_stays_behind_is_away_not_a_refusal():
    known = ProofContract(Behind(refusal("404, SESSION_UNKNOWN: none"), 10**6, b""), "pol", lag_s=0.01)
    with pytest.raises(AwayError, match="behind") as caught:
        await known.cancel("a" * 64, "test")
    assert caught.value.tx_id == ""


async def test_a_session_of_another_state_is_a_refusal_at_once():
    network = Behind(refusal("422, SESSION_REQUESTED: not decided"), 10**6, b"")
    with pytest.raises(RefusedError):
        await ProofContract(network, "pol").cancel("a" * 64, "test")
    assert network.left == 10**6 - 1


@pytest.mark.parametrize("answer", [b"", b"[]", b"{", b'{"pad_id":1}', b"\xff", b'{"x":1.5}'])
async def test_an_answer_that_is_none_is_refused(answer):
    with pytest.raises(RefusedError, match="BAD_ANSWER"):
        await contract(answer).read_pad("pad-1")


async def test_no_verdict_yet_is_none():
    error = EvaluateError("chaincode response 404, VERDICT_UNKNOWN: none", status_code=grpc.StatusCode.UNKNOWN)
    assert await contract(error).read_verdict("a" * 64) is None


async def test_events_that_are_not_asked_for_or_cannot_be_read_are_left_out():
    stream = Stream(
        [
            Event(3, "t1", "pol", "ProofRequested", b'{"record":{"pad_id":"pad-1"},"t_ms":5}'),
            Event(3, "t2", "pol", "AssetCreated", b"{}"),
            Event(4, "t3", "pol", "ProofRequested", b"\xff"),
            Event(4, "t4", "pol", "ProofRequested", b"[1]"),
            Event(5, "t5", "pol", "ProofRequested", b'{"record":"x"}'),
            Event(6, "t6", "pol", "ProofRequested", b'{"pad_id":"pad-2"}'),
        ]
    )
    source = contract(stream=stream).events(names=frozenset({"ProofRequested"}))
    seen = [(event.tx_id, event.record, event.checkpoint.block_number) async for event in source]
    assert seen == [("t1", {"pad_id": "pad-1"}, 3), ("t6", {"pad_id": "pad-2"}, 6)]
    assert stream.closed


async def test_a_stream_that_breaks_says_that_the_ledger_is_away():
    stream = Stream([GatewayError("ended", status_code=grpc.StatusCode.UNAVAILABLE)])
    with pytest.raises(AwayError):
        await anext(contract(stream=stream).events(names=frozenset({"ProofRequested"})))
    assert stream.closed


def test_notes_are_one_bounded_line():
    assert _note("  two\nlines\x00and\tmore ") == "two lines and more"
    assert _note("\n") is None
    assert len(_note("x" * 9_000)) == MAX_NOTE
