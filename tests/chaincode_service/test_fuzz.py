"""Whatever a peer sends, a stream ends by the peer's leaving or by `StreamProtocolError`, and answers what it began."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wonderland_chaincode.service import Limits
from wonderland_chaincode.service.errors import StreamProtocolError
from wonderland_chaincode.service.metrics import Metrics
from wonderland_chaincode.service.stream import PeerStream

QUIET = settings(
    deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
IDS = ("a" * 64, "b" * 64, "", "é")


async def fed(tools, contract, frames):
    """A stream that got these frames and then its end: (what was raised, messages written)."""
    written = []
    left = iter(frames)

    async def read():
        await asyncio.sleep(0)
        return next(left, None)

    async def write(data):
        written.append(tools.M.FromString(data))

    stream = PeerStream(
        "fuzz", read, write, package_id=tools.PACKAGE_ID, contract=contract,
        limits=Limits(answer_s=0.05, handshake_s=1), metrics=Metrics(), now_ms=lambda: tools.START_MS,
    )  # fmt: skip
    try:
        async with asyncio.timeout(10):
            await stream.serve()
    except StreamProtocolError as error:
        return error, written
    assert stream.in_flight == 0
    return None, written


@QUIET
@given(frames=st.lists(st.binary(max_size=60), max_size=6), registered=st.booleans())
def test_any_bytes(tools, toy, frames, registered):
    opening = [tools.M(type=kind).SerializeToString() for kind in (tools.M.REGISTERED, tools.M.READY)]
    error, written = asyncio.run(fed(tools, toy, [*(opening if registered else ()), *frames]))
    assert error is None or str(error)
    assert all(message.type in set(tools.M.Type.values()) for message in written)


messages = st.builds(
    lambda kind, tx_id, channel, payload, proposal: (kind, tx_id, channel, payload, proposal),
    st.integers(0, 40),
    st.sampled_from(IDS),
    st.sampled_from(("wonderland", "")),
    st.binary(max_size=40),
    st.none() | st.binary(max_size=40),
)


@QUIET
@given(sent=st.lists(messages, max_size=12))
def test_any_messages_after_the_registration(tools, toy, sent):
    frames = [tools.M(type=kind).SerializeToString() for kind in (tools.M.REGISTERED, tools.M.READY)]
    for kind, tx_id, channel, payload, proposal in sent:
        message = tools.M(type=kind, txid=tx_id, channel_id=channel, payload=payload)
        if proposal is not None:
            message.proposal.proposal_bytes = proposal
        frames.append(message.SerializeToString())
    error, _ = asyncio.run(fed(tools, toy, frames))
    assert error is None


@QUIET
@given(data=st.data())
def test_a_damaged_transaction_is_answered_once(tools, toy, data):
    """One byte of a good message changed: still one answer, or (where its id was hit) an answer under that id."""
    call = tools.Call("put", ("key", "value"), nonce=b"n" * 24)
    good = bytearray(call.message().SerializeToString())
    place = data.draw(st.integers(0, len(good) - 1))
    good[place] ^= data.draw(st.integers(1, 255))
    frames = [tools.M(type=kind).SerializeToString() for kind in (tools.M.REGISTERED, tools.M.READY)]
    error, answers = asyncio.run(answered(tools, toy, [*frames, bytes(good)]))
    if error is None:
        assert len(answers) <= 1
        assert all(each.type in {tools.M.COMPLETED, tools.M.ERROR, tools.M.KEEPALIVE} for each in answers)


async def answered(tools, contract, frames):
    """Like `fed`, with a peer that answers each question by nothing and leaves after the last answer."""
    written = []
    inbox = asyncio.Queue()
    for frame in frames:
        inbox.put_nowait(frame)

    async def read():
        try:
            return await asyncio.wait_for(inbox.get(), 0.02)
        except TimeoutError:
            return None

    async def write(data):
        message = tools.M.FromString(data)
        if message.type in {tools.M.GET_STATE, tools.M.PUT_STATE}:
            answer = tools.M(type=tools.M.RESPONSE, txid=message.txid, channel_id=message.channel_id)
            inbox.put_nowait(answer.SerializeToString())
        elif message.type != tools.M.REGISTER:
            written.append(message)

    stream = PeerStream(
        "fuzz", read, write, package_id=tools.PACKAGE_ID, contract=contract, limits=Limits(answer_s=1),
        metrics=Metrics(), now_ms=lambda: tools.START_MS,
    )  # fmt: skip
    try:
        await stream.serve()
    except StreamProtocolError as error:
        return error, written
    return None, written


@pytest.fixture(autouse=True)
def _no_log(caplog):
    caplog.set_level("CRITICAL")
