"""The same contract on the service and on the embedded ledger: the same answer, event and read-write set."""

from __future__ import annotations

import json

import pytest
from fabric_protos.peer import chaincode_shim_pb2 as shim

from wonderland_fabric_gateway.embedded import rwset as rwsets
from wonderland_fabric_gateway.signature_policies import key_policy


@pytest.fixture
def state(tools):
    state = tools.State(a="1", b="2", c="3", d="4", e="5")
    state.commit({"b": "20"}, tx_id="11" * 32, timestamp_ms=tools.START_MS + 1)
    state.commit({"b": None}, tx_id="22" * 32, timestamp_ms=tools.START_MS + 2)
    state.commit({"b": "200", "é": "accent", "\U0001f681": "helicopter"}, tx_id="33" * 32)
    return state


CALLS = [
    ("put", "k", "v"),
    ("put", "k", "v", "Event"),
    ("put", "clé \U0001f681", "valeur"),
    ("get", "a"),
    ("get", "nowhere"),
    ("get_many",),
    ("get_many", "a"),
    ("get_many", "c", "nowhere", "a", "e", "a", "b", "d"),
    ("get_many", "a", ""),
    ("guard", "k", "PadMSP", "AuthorityMSP"),
    ("guard", "a", "PadMSP", "PadMSP"),
    ("guard", "k"),
    ("guard", "k", ""),
    ("guard", "k", *(f"M{index}" for index in range(51))),
    ("guard_what_is_not_put", "a"),
    ("put_then_get", "a", "new"),
    ("put_twice_then_delete_other", "x", "a"),
    ("range", "a", "d"),
    ("range", "", ""),
    ("range", "b", ""),
    ("range", "x", "y"),
    ("history", "b"),
    ("history", "nowhere"),
    ("fill", "f", "0"),
    ("fill", "f", "1"),
    ("fill", "f", "7"),
    ("whoami",),
    ("refuse", "409", "THERE_ALREADY: no"),
    ("refuse", "599", "odd"),
    ("bad_key", "empty"),
    ("bad_key", "surrogate"),
    ("bad_key", "long"),
    ("bad_key", "bytes"),
    ("bad_value", "text"),
    ("bad_value", "empty"),
    ("bad_event", "empty"),
    ("bad_event", "text"),
    ("bad_event", "line"),
    ("bad_event", "long"),
    ("write_much",),
    ("fill", "f", "10001"),
    ("bad_value", "long"),
    ("big_result",),
]


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
@pytest.mark.parametrize("batch", [(True, 1000), (True, 3), (False, 0)], ids=["batch", "batches-of-3", "one-by-one"])
async def test_a_transaction_comes_out_the_same_on_both_ledgers(tools, toy, world, state, call, batch):
    function, *args = call
    call = tools.Call(function, tuple(args))
    peer = await world.peer(state, batch=batch)
    there = await peer.run(call)
    status, text, payload, event, rwset = tools.in_place(toy, call, state)
    assert (there.status, there.text, there.payload, there.event) == (status, text, payload, event)
    assert there.kind == tools.M.COMPLETED
    if status == 200:
        assert rwsets.encode(there.rwset, "pol") == rwsets.encode(rwset, "pol")
    else:
        assert not there.rwset.writes
    assert not peer.dropped


@pytest.mark.parametrize(("most", "questions"), [(1000, 1), (3, 3), (1, 7)])
async def test_several_keys_are_read_in_as_few_questions_as_the_peer_allows(tools, world, state, most, questions):
    peer = await world.peer(state, batch=(True, most))
    ended = await peer.run(tools.Call("get_many", ("a", "b", "c", "d", "e", "f", "é")))
    assert json.loads(ended.payload) == ["1", "200", "3", "4", "5", None, "accent"]
    assert ended.calls == ["GET_STATE" if most == 1 else "GET_STATE_MULTIPLE"] * questions


async def test_an_answer_with_fewer_values_than_keys_is_no_answer(tools, world, state):
    peer = await world.peer(state)
    peer.garbage = shim.GetStateMultipleResult(values=[b"1"]).SerializeToString()
    ended = await peer.run(tools.Call("get_many", ("a", "b")))
    assert ended.kind == tools.M.ERROR
    assert "try again" in ended.text


async def test_an_endorsement_that_a_key_needs_reaches_the_peer_with_its_value(tools, world, state):
    peer = await world.peer(state)
    ended = await peer.run(tools.Call("guard", ("k", "PadMSP", "AuthorityMSP")))
    assert ended.calls == ["WRITE_BATCH_STATE"]
    (policy,) = ended.rwset.policies
    assert (policy.key, policy.policy) == ("k", key_policy(["AuthorityMSP", "PadMSP"]))


async def test_what_the_contract_sees_of_its_sender(tools, world):
    who = tools.Person(
        "drone-7", "FleetMSP", (("pol.role", "uav"), ("pol.id", "1AB0000007"), ("hf.Affiliation", "")), number=99
    )
    call = tools.Call("whoami", who=who, timestamp_ms=tools.START_MS + 5)
    seen = json.loads((await (await world.peer()).run(call)).payload)
    assert (seen["msp_id"], seen["common_name"], seen["role"], seen["pol_id"]) == (
        "FleetMSP", "drone-7", "uav", "1AB0000007",
    )  # fmt: skip
    assert seen["attributes"] == {"pol.role": "uav", "pol.id": "1AB0000007", "hf.Affiliation": ""}
    assert (seen["channel"], seen["tx_id"], seen["timestamp_ms"]) == ("wonderland", call.tx_id, call.timestamp_ms)
    assert len(bytes.fromhex(seen["public_key"])) == 65


async def test_a_sender_without_attributes_has_no_role(tools, world):
    seen = json.loads(
        (await (await world.peer()).run(tools.Call("whoami", who=tools.Person("x", attributes=())))).payload
    )
    assert (seen["role"], seen["pol_id"], seen["attributes"]) == ("", "", {})
