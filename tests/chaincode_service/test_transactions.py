"""Many transactions on one stream, and every way in which one of them can go wrong without harming the others."""

from __future__ import annotations

import asyncio
import logging
import re

import pytest

from wonderland_chaincode.service import Limits


async def test_many_transactions_at_once_each_with_one_question_in_flight(tools, world):
    state = tools.State(**{f"key-{number}": str(number) for number in range(200)})
    peer = await world.peer(state, delay_s=0.01)
    calls = [tools.Call("range", ("key-", "key-1")) for _ in range(20)]
    calls += [tools.Call("get", (f"key-{number}",)) for number in range(200)]
    began = [await peer.begin(call) for call in calls]
    ended = await asyncio.gather(*(peer.end(call, begun) for call, begun in zip(calls, began, strict=True)))
    assert [each.payload for each in ended[20:]] == [b"%d" % number for number in range(200)]
    assert peer.dropped == 0
    assert world.server.in_flight == 0
    assert world.count("transactions_total", function="get", outcome="ok") == 200
    assert world.count("transactions_total", function="other", outcome="ok") == 20


async def test_transactions_at_once_share_the_time_that_the_peer_takes(tools, world):
    peer = await world.peer(tools.State(a="1"), delay_s=0.2)
    calls = [tools.Call("get", ("a",)) for _ in range(30)]
    async with asyncio.timeout(2):  # one after the other would take six seconds
        began = [await peer.begin(call) for call in calls]
        await asyncio.gather(*(peer.end(call, begun) for call, begun in zip(calls, began, strict=True)))


async def test_a_range_is_read_page_by_page_and_only_as_far_as_needed(tools, world):
    state = tools.State(**{f"k{number:03}": "v" for number in range(10)})
    peer = await world.peer(state, page=3)
    whole = await peer.run(tools.Call("range", ("k", "l")))
    assert whole.calls == ["GET_STATE_BY_RANGE"] + ["QUERY_STATE_NEXT"] * 3
    first = await peer.run(tools.Call("first", ("k", "l")))
    assert first.calls == ["GET_STATE_BY_RANGE", "PUT_STATE"]
    assert first.payload == b"k000"


async def test_a_query_can_be_closed_early(tools, serving):
    class Closes:
        version = "1"

        async def invoke(self, stub, function, args):
            rows = stub.range("k", "l")
            key, _ = await anext(rows)
            await rows.aclose()
            await rows.aclose()
            left = [each async for each in rows]
            never = stub.range("k", "l")
            await never.aclose()
            return f"{key} {left}".encode()

    async with serving(Closes()) as world:
        peer = await world.peer(tools.State(k1="1", k2="2", k3="3"))
        ended = await peer.run(tools.Call("x"))
        assert (ended.status, ended.payload) == (200, b"k1 []")
        assert ended.calls == ["GET_STATE_BY_RANGE", "QUERY_STATE_CLOSE"]


@pytest.mark.parametrize(
    ("batch", "calls"),
    [
        ((True, 1000), ["WRITE_BATCH_STATE"]),
        ((True, 4), ["WRITE_BATCH_STATE"] * 3),
        ((True, 0), ["WRITE_BATCH_STATE"]),
        ((True, 1), ["PUT_STATE"] * 10),
        ((False, 1000), ["PUT_STATE"] * 10),
    ],
)
async def test_writes_go_in_as_few_messages_as_the_peer_allows(tools, world, batch, calls):
    peer = await world.peer(batch=batch)
    assert (await peer.run(tools.Call("fill", ("k", "10")))).calls == calls


async def test_a_batch_stays_below_the_message_limit(tools, serving, monkeypatch):
    monkeypatch.setattr("wonderland_chaincode.service.stub.MAX_BATCH_BYTES", 100)

    class Writes:
        version = "1"

        async def invoke(self, stub, function, args):
            for key in "abcdef":
                await stub.put(key, b"x" * 40)
            await stub.put("large", b"x" * 4000)
            return b""

    async with serving(Writes()) as world:
        ended = await (await world.peer()).run(tools.Call("x"))
        assert ended.calls == ["WRITE_BATCH_STATE"] * 4
        assert len(ended.rwset.writes) == 7


async def test_a_contract_that_refuses_writes_nothing_and_has_no_event(tools, world):
    ended = await (await world.peer()).run(tools.Call("refuse", ("403", "NOT_YOURS: no; ask")))
    assert (ended.kind, ended.status, ended.text) == (tools.M.COMPLETED, 403, "NOT_YOURS: no; ask")
    assert ended.calls == []
    assert ended.event is None


@pytest.mark.parametrize("function", ["crash", "nowhere", "wait", "sleep", "return_text", "two_at_once"])
async def test_a_fault_of_the_contract_is_a_reference_for_the_client_and_a_trace_in_the_log(
    tools, world, caplog, function
):
    peer = await world.peer(tools.State(a="1", b="2"))
    ended = await peer.run(tools.Call(function))
    assert (ended.kind, ended.status) == (tools.M.COMPLETED, 500)
    found = re.fullmatch(r"the contract failed \(reference ([0-9a-f]{8})\); the service's log says why", ended.text)
    assert found, ended.text
    assert not ended.rwset.writes
    (record,) = [
        each
        for each in caplog.records
        if each.name.startswith("wonderland_chaincode") and each.levelno >= logging.ERROR
    ]
    assert found[1] in record.getMessage()
    assert record.reference == found[1]
    assert record.exc_info
    assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"
    assert peer.dropped == 0


async def test_the_log_shows_where_the_contract_crashed(tools, world, caplog):
    await (await world.peer()).run(tools.Call("crash"))
    assert "ZeroDivisionError" in caplog.text
    assert "do_crash" in caplog.text


@pytest.mark.parametrize("kind", ["empty", "text", "line", "long"])
async def test_an_event_that_no_ledger_can_carry_is_refused(tools, world, kind):
    ended = await (await world.peer()).run(tools.Call("bad_event", (kind,)))
    assert ended.status == 400
    assert "event" in ended.text


async def test_a_value_that_would_delete_its_key_is_refused(tools, world):
    ended = await (await world.peer()).run(tools.Call("bad_value", ("empty",)))
    assert ended.status == 400
    assert "an empty value would delete the key" in ended.text


async def test_what_one_transaction_writes_is_bounded(tools, world):
    ended = await (await world.peer()).run(tools.Call("write_much"))
    assert (ended.status, ended.calls) == (413, [])
    ended = await (await world.peer()).run(tools.Call("fill", ("k", "10001")))
    assert (ended.status, ended.calls) == (413, [])


async def test_what_a_client_sends_is_bounded(tools, world):
    ended = await (await world.peer()).run(tools.Call("get", (b"x" * (4 << 20),)))
    assert (ended.kind, ended.status) == (tools.M.COMPLETED, 413)


async def test_a_call_without_a_readable_function_is_refused(tools, world):
    peer = await world.peer()
    ended = await peer.run(tools.Call(b"\xff"))
    assert (ended.status, ended.text) == (400, "the function's name is no UTF-8 text")
    call = tools.Call("get", ("a",))
    message = call.message()
    message.payload = b""
    ended = await peer.run_message(call, message)
    assert (ended.status, "names no function" in ended.text) == (400, True)


async def test_a_certificate_that_cannot_be_read_is_refused(tools, world):
    peer = await world.peer()
    ended = await peer.run(tools.Call("whoami"), creator=b"\xff\xff")
    assert (ended.kind, ended.status) == (tools.M.COMPLETED, 403)
    assert "certificate cannot be used" in ended.text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"tx_id": "00" * 32}, "different transactions"),
        ({"channel": "other"}, "different transactions"),
    ],
)
async def test_a_message_that_contradicts_its_proposal_is_an_error(tools, world, change, said):
    ended = await (await world.peer()).run(tools.Call("get", ("a",)), **change)
    assert ended.kind == tools.M.ERROR
    assert said in ended.text


@pytest.mark.parametrize("part", ["no proposal", "proposal", "payload", "timestamp"])
async def test_a_message_that_is_broken_inside_is_an_error_of_that_transaction(tools, world, part):
    peer = await world.peer(tools.State(a="1"))
    call = tools.Call("get", ("a",), timestamp_ms=-5 if part == "timestamp" else tools.START_MS)
    message = call.message()
    if part == "no proposal":
        message.ClearField("proposal")
    elif part == "proposal":
        message.proposal.proposal_bytes = b"\xff" * 9
    elif part == "payload":
        message.payload = b"\xff" * 9
    ended = await peer.run_message(call, message)
    assert ended.kind == tools.M.ERROR
    assert ended.text
    assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"


async def test_a_transaction_from_another_time_is_not_run_here(tools, world):
    peer = await world.peer()
    for offset_ms, word in ((-16 * 60_000, "behind"), (16 * 60_000, "ahead of")):
        ended = await peer.run(tools.Call("get", ("a",), timestamp_ms=tools.START_MS + offset_ms))
        assert ended.kind == tools.M.ERROR
        assert f"960 s {word} this organisation's clock" in ended.text
        assert ended.calls == []
    for offset_ms in (-14 * 60_000, 14 * 60_000):
        ended = await peer.run(tools.Call("get", ("a",), timestamp_ms=tools.START_MS + offset_ms))
        assert ended.status == 200


@pytest.mark.parametrize(
    ("refuse", "function", "args"),
    [
        ("GET_STATE", "get", ("a",)),
        ("PUT_STATE", "put", ("a", "1")),
        ("WRITE_BATCH_STATE", "fill", ("k", "5")),
        ("GET_STATE_BY_RANGE", "range", ("a", "b")),
        ("QUERY_STATE_NEXT", "range", ("a", "z")),
        ("GET_HISTORY_FOR_KEY", "history", ("a",)),
    ],
)
async def test_what_a_peer_refuses_is_an_error_that_another_peer_may_not_have(
    tools, world, caplog, refuse, function, args
):
    peer = await world.peer(tools.State(a="1", b="2", c="3", d="4"), refuse=refuse)
    ended = await peer.run(tools.Call(function, args))
    assert ended.kind == tools.M.ERROR
    assert re.fullmatch(r"a read or write failed at the peer \(reference [0-9a-f]{8}\); try again", ended.text)
    assert "no ledger context" in caplog.text
    assert world.count("transactions_total", function="get", outcome="unavailable") == (function == "get")


async def test_a_peer_that_does_not_answer_costs_one_transaction(tools, toy, serving, caplog):
    async with serving(toy, limits=Limits(answer_s=0.1, drain_s=1)) as world:
        peer = await world.peer(tools.State(a="1"), mute=True)
        ended = await peer.run(tools.Call("get", ("a",)))
        assert ended.kind == tools.M.ERROR
        assert "no answer to GET_STATE" in caplog.text
        peer.mute = False
        assert (await peer.run(tools.Call("get", ("a",)))).payload == b"1"


@pytest.mark.parametrize("found", [b"\xff\xff", b"\x10\x01", b"\x10\x01\x1a\x01q"])
async def test_a_peers_answer_that_is_none_is_an_error_of_that_transaction(tools, world, found):
    """Garbage, and a promise of more without a query's name or without a result, which would never end."""
    peer = await world.peer(tools.State(a="1"), garbage=found)
    ended = await peer.run(tools.Call("range", ("a", "b")))
    assert ended.kind == tools.M.ERROR


async def test_a_transaction_that_comes_twice_runs_once(tools, world):
    peer = await world.peer(tools.State(a="1"), delay_s=0.1)
    call = tools.Call("get", ("a",))
    begun = await peer.begin(call)
    await peer.send(call.message())
    ended = await peer.end(call, begun)
    assert ended.calls == ["GET_STATE"]
    assert world.count("unexpected_messages_total") == 1


async def test_what_is_too_much_at_once_is_sent_elsewhere(tools, toy, serving):
    async with serving(toy, limits=Limits(max_in_flight=2, drain_s=1)) as world:
        peer = await world.peer(tools.State(a="1"), delay_s=0.1)
        calls = [tools.Call("get", ("a",)) for _ in range(3)]
        began = [await peer.begin(call) for call in calls]
        ended = [await peer.end(call, begun) for call, begun in zip(calls, began, strict=True)]
        assert [each.kind for each in ended] == [tools.M.COMPLETED, tools.M.COMPLETED, tools.M.ERROR]
        assert ended[2].text == "2 transactions are under way here; try again"


async def test_an_init_message_is_a_transaction_like_any_other(tools, world):
    ended = await (await world.peer(tools.State(a="1"))).run(tools.Call("get", ("a",)), type=tools.M.INIT)
    assert ended.payload == b"1"
