"""A pad's queue as people see it: by REST and on the live map, from what the ledger has and nothing else."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace

import pytest
from jsonschema import Draft202012Validator
from kit.backend import serving
from kit.chain import START_MS, Tx, number
from kit.description import document
from kit.facts import Facts

from wonderland.proofs import encoding
from wonderland.proofs.records import keys, policies
from wonderland.proofs.records.reservations import Reservation, Reservations
from wonderland.proofs.records.sessions import Departure

BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
NOW_MS = START_MS + 20_000
COMPONENTS = document()["components"]


def conforms(schema_name, value):
    schema = {"$ref": f"#/components/schemas/{schema_name}", "components": COMPONENTS}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


async def pads_told(socket, kind):
    """The pads of the next frame of a kind that has some, by their ids."""
    while True:
        frame = json.loads(await asyncio.wait_for(socket.recv(), 5))
        if frame["type"] == kind and frame.get("pads"):
            return {each["pad_id"]: each for each in frame["pads"]}


def session(name, uav_id="uav-1", t_ms=START_MS, pad_id="pad-1", **more):
    policy = policies.Policy(occupied_ms=3_600_000).to_json()
    return Facts().session(number("session", name), pad_id, uav_id, t_ms, policy=policy, **more)


def written(record, name, function):
    event = (name, encoding.encode({"kind": name, "record": record.to_json()}))
    tx_id = record.session_id if function == "RequestProof" else ""
    writes = {keys.composite(keys.SESSION, record.session_id): record.encode()}
    argument = {"pad_id": record.pad_id} if function == "RequestProof" else {"session_id": record.session_id}
    return Tx(function, argument, writes, event, t_ms=record.requested_ms, tx_id=tx_id)


def asks(record):
    return written(record, "ProofRequested", "RequestProof")


def landed(record):
    times = {"decided_ms": NOW_MS - 9_000, "ended_ms": NOW_MS - 8_000}
    done = replace(record, state="completed", end="done", ended_by="uav", **times)
    return written(done, "InteractionCompleted", "CompleteInteraction"), done


@pytest.fixture
async def queueing(new_backend, chain, source_of, clock):
    """uav-1 stands on pad-1; uav-2 waits for it, uav-3 with an emergency after it; uav-4 waits at another pad."""
    clock.now_ms = NOW_MS
    facts = Facts()
    drones = [facts.put_uav(f"uav-{each}") for each in (1, 2, 3, 4)]
    chain.add(facts.put_pad(), facts.put_pad("pad-2", commissioned=False), *drones)
    first = session("first")
    chain.add(asks(first))
    done, _ = landed(first)
    chain.add(done)
    late = {"t_ms": NOW_MS - 5_000}
    # Of one block: the place in it counts, and no clock.
    chain.add(
        asks(session("calm", "uav-2", **late)),
        asks(session("urgent", "uav-3", t_ms=NOW_MS - 1_000, priority="emergency")),
        asks(session("elsewhere", "uav-4", pad_id="pad-2", **late)),
    )
    async with serving(new_backend(source_of(chain))) as client:
        await client.mirrored(chain.height)
        yield client


@both
async def test_who_has_the_pad_and_who_waits(queueing, chain):
    queue = await queueing.json("/pads/pad-1/queue")
    conforms("PadQueue", queue)
    occupant = queue["occupant"]
    assert (occupant["uav_id"], occupant["landed"]) == ("uav-1", True)
    assert occupant["until_ms"] - occupant["since_ms"] == 3_600_000
    assert [(each["place"], each["uav_id"], each["rank"], each["blocked_by"]) for each in queue["waiting"]] == [
        (1, "uav-3", "emergency", "uav-1"),
        (2, "uav-2", "normal", "uav-1"),
    ]
    elsewhere = await queueing.json("/pads/pad-2/queue")
    assert "occupant" not in elsewhere
    assert [each["uav_id"] for each in elsewhere["waiting"]] == ["uav-4"]
    answer = await queueing.get("/pads/pad-9/queue")
    assert answer.status_code == 404


@both
async def test_a_departure_frees_the_pad_and_the_landings_transaction_stays(queueing, chain):
    _, done = landed(session("first"))
    before = await queueing.json(f"/sessions/{done.session_id}")
    left = replace(done, departure=Departure(by="operator", name="Ada", t_ms=NOW_MS, note='said: "departure":{'))
    async with queueing.live() as socket:
        pad = (await pads_told(socket, "snapshot"))["pad-1"]
        conforms("Pad", pad)
        assert (pad["queue"]["waiting"], pad["queue"]["occupant"]["uav_id"]) == (2, "uav-1")
        chain.add(written(left, "DepartureRecorded", "RecordDeparture"))
        assert (await pads_told(socket, "delta"))["pad-1"]["queue"] == {"waiting": 2}
    queue = await queueing.json("/pads/pad-1/queue")
    assert "occupant" not in queue
    assert ["blocked_by" in each for each in queue["waiting"]] == [False, False]
    after = await queueing.json(f"/sessions/{done.session_id}")
    assert after["summary"]["complete_tx"] == before["summary"]["complete_tx"]
    assert [each["function"] for each in after["transactions"]] == ["RequestProof", "CompleteInteraction"]


async def test_what_nobody_counted_as_valid_moves_nobody(queueing, chain):
    forged = written(replace(session("forged", "uav-4"), priority="emergency"), "ProofRequested", "RequestProof")
    forged.code = 11
    chain.add(forged)
    await queueing.mirrored(chain.height)
    queue = await queueing.json("/pads/pad-1/queue")
    assert [each["uav_id"] for each in queue["waiting"]] == ["uav-3", "uav-2"]


def keeps(pad_id="pad-1", *spans):
    """The reservations of a pad, as the contract writes them: (drone, from, until) each."""
    who = {"msp_id": "FleetMSP", "reserved_by": "Ada", "reserved_ms": NOW_MS}
    made = tuple(
        Reservation(reservation_id=number("reservation", uav_id), uav_id=uav_id, from_ms=begin, until_ms=end, **who)
        for uav_id, begin, end in spans
    )
    record = Reservations(pad_id=pad_id, reservations=made)
    event = ("PadReserved", encoding.encode({"kind": "PadReserved", "record": record.to_json()}))
    writes = {keys.composite(keys.RESERVATIONS, pad_id): record.encode()}
    return Tx("ReservePad", {"pad_id": pad_id}, writes, event, t_ms=NOW_MS)


@both
async def test_a_reservation_keeps_others_waiting_and_is_on_the_map(queueing, chain, new_backend, source_of):
    spans = [("uav-9", NOW_MS, NOW_MS + 600_000), ("uav-8", NOW_MS - 9_000, NOW_MS - 1)]
    async with queueing.live() as socket:
        await pads_told(socket, "snapshot")
        chain.add(keeps("pad-2", *spans))
        told = (await pads_told(socket, "delta"))["pad-2"]
        conforms("Pad", told)
    assert told["queue"]["reservation"]["uav_id"] == "uav-9"
    queue = await queueing.json("/pads/pad-2/queue")
    conforms("PadQueue", queue)
    assert [each["uav_id"] for each in queue["reservations"]] == ["uav-9"]
    assert [(each["uav_id"], each["blocked_by"], each["kept"]) for each in queue["waiting"]] == [
        ("uav-4", "uav-9", True)
    ]
    # Taken: nobody waits for it, and a backend that starts anew knows no more of it.
    chain.add(keeps("pad-2"))
    await queueing.mirrored(chain.height)
    queue = await queueing.json("/pads/pad-2/queue")
    assert (queue["reservations"], "blocked_by" in queue["waiting"][0]) == ([], False)
    chain.add(keeps("pad-2", *spans))
    await queueing.mirrored(chain.height)
    async with serving(new_backend(source_of(chain))) as again, again.live() as socket:
        assert (await pads_told(socket, "snapshot"))["pad-2"]["queue"]["reservation"]["uav_id"] == "uav-9"
