"""Two drones, one pad: the real agents on the embedded ledger."""

from __future__ import annotations

import asyncio
import logging
import sys
from asyncio.subprocess import PIPE

from kit.agents import decided

from wonderland.proofs import encoding, keys
from wonderland.proofs.records.transactions import RequestProof
from wonderland_uav_agent.agent import Urgency

OCCUPIED = {"occupied_ms": 600_000}


async def sessions_of(world, uav_id, *, limit_s=10.0, count=1):
    """The requests of a drone, once so many are on the ledger."""
    found = {}

    async def listen():
        async for event in world.contract("mirror").events(start_block=0, names=frozenset({"ProofRequested"})):
            if event.record["uav_id"] == uav_id:
                found[event.record["session_id"]] = event.record
            if len(found) >= count:
                return

    async with asyncio.timeout(limit_s):
        await listen()
    return list(found)


async def test_the_second_waits_while_the_first_is_on_the_pad_and_is_served_by_itself(world, caplog):
    caplog.set_level(logging.INFO)
    await world.second_uav()
    await world.policy(**OCCUPIED)
    async with world.pad() as pad, world.uav() as first, world.uav(name="uav-2") as second:
        landed = await decided(first, action="land")
        assert (landed.state, landed.end) == ("completed", "done"), landed.verdict
        waiting = asyncio.create_task(decided(second))
        await sessions_of(world, "uav-2")
        await asyncio.sleep(3)
        assert not waiting.done()
        assert pad.status()["queue"] == {"on_pad": "uav-1", "waiting": ["uav-2"]}
        assert "uav-1 is on the pad; 1 wait until it has left" in caplog.text
        assert [verdict.uav_id for verdict in world.acted] == ["uav-1"]
        left = await decided(first, action="takeoff")
        assert (left.state, left.end) == ("completed", "done")
        async with asyncio.timeout(20):
            result = await waiting
    assert (result.state, result.end) == ("completed", "done")
    assert [(each.uav_id, each.action) for each in world.acted] == [
        ("uav-1", "land"),
        ("uav-1", "takeoff"),
        ("uav-2", "land"),
    ]


async def test_a_recorded_departure_frees_the_pad(world):
    await world.second_uav()
    await world.policy(**OCCUPIED)
    async with world.pad(), world.uav() as first, world.uav(name="uav-2") as second:
        landed = await decided(first, action="land")
        waiting = asyncio.create_task(decided(second))
        await sessions_of(world, "uav-2")
        await world.call("pad_operator", "RecordDeparture", session_id=landed.session_id, note="carried away")
        async with asyncio.timeout(20):
            assert (await waiting).end == "done"


async def test_an_emergency_is_signed_and_served_once_the_pad_is_free(world):
    await world.second_uav()
    await world.policy(**OCCUPIED)
    async with world.pad(), world.uav() as first:
        landed = await decided(first, action="land")
        calm = asyncio.create_task(decided(first))  # it asks to land again, and may: the pad is its own
        await calm
        async with world.uav(name="uav-2") as second:
            waiting = asyncio.create_task(second.prove("pad-1", "land", Urgency("emergency")))
            (urgent,) = await sessions_of(world, "uav-2")
            stored = await world.contract("mirror").read_session(urgent)
            assert stored.priority == "emergency"
            again = calm.result().session_id
            assert landed.session_id != again
            await world.call("pad_operator", "RecordDeparture", session_id=again)
            async with asyncio.timeout(20):
                assert (await waiting).end == "done"


async def test_an_emergency_passes_who_came_earlier_and_the_override_is_on_record(world):
    await world.second_uav()
    await world.policy(**OCCUPIED)
    contract = world.contract("uav-2")
    async with world.pad(), world.uav() as first, world.uav(name="uav-2") as second:
        landed = await decided(first, action="land")
        (prekey, *_) = await contract.list_prekeys("pad-1", 10)
        calm, _ = await contract.request_proof(
            RequestProof(
                pad_id="pad-1",
                action="dock",
                prekey_id=prekey.prekey_id,
                uav_key=encoding.to_base64url(keys.public_bytes(keys.new_key())),
                claim=world.flight.claim(world.clock()),
            )
        )
        proving = asyncio.create_task(second.prove("pad-1", "land", Urgency("emergency")))
        _, urgent = await sessions_of(world, "uav-2", count=2)
        await world.call("pad_operator", "RecordDeparture", session_id=landed.session_id)
        async with asyncio.timeout(20):
            result = await proving
    assert (result.session_id, result.end) == (urgent, "done")
    stored = await contract.read_session(urgent)
    assert stored.precedence.by == "pad"
    assert stored.precedence.reason == "emergency, by the drone's own word; before 1 who came earlier"
    passed = await contract.read_session(calm.session_id)
    assert passed.precedence is None
    assert passed.ended_ms is None or passed.ended_ms > stored.ended_ms


async def test_a_pad_is_kept_for_who_reserved_it_and_then_free_after_a_restart_too(world):
    await world.second_uav()
    await world.policy(reservation_ms=600_000, session_ttl_ms=30_000)
    now_ms = world.clock()
    span = {"from_ms": now_ms + 30_000, "until_ms": now_ms + 600_000}
    async with world.uav() as first, world.uav(name="uav-2") as second:
        async with world.pad():
            kept = await world.call("fleet_operator", "ReservePad", pad_id="pad-1", uav_id="uav-1", **span)
            assert [each["uav_id"] for each in kept["reservations"]] == ["uav-1"]
            waiting = asyncio.create_task(decided(second))
            await sessions_of(world, "uav-2")
            await asyncio.sleep(1)
        async with world.pad() as pad:
            await asyncio.sleep(1)
            assert not waiting.done()
            assert pad.status()["queue"] == {"on_pad": "", "waiting": ["uav-2"]}
            assert (await decided(first)).end == "done"
            async with asyncio.timeout(20):
                assert (await waiting).end == "done"
    assert [verdict.uav_id for verdict in world.acted] == ["uav-1", "uav-2"]


async def test_a_cancelled_reservation_keeps_nobody_waiting(world):
    await world.second_uav()
    await world.policy(reservation_ms=600_000)
    now_ms = world.clock()
    made = await world.call(
        "uav", "ReservePad", pad_id="pad-1", uav_id="uav-1", from_ms=now_ms, until_ms=now_ms + 600_000
    )
    async with world.pad(), world.uav(name="uav-2") as second:
        waiting = asyncio.create_task(decided(second))
        await sessions_of(world, "uav-2")
        await asyncio.sleep(1)
        assert not waiting.done()
        (its,) = made["reservations"]
        await world.call(
            "pad_operator", "CancelReservation", pad_id="pad-1", reservation_id=its["reservation_id"], note="works"
        )
        async with asyncio.timeout(20):
            assert (await waiting).end == "done"


async def test_the_command_reserves_says_for_whom_and_gives_up(world):
    await world.policy(reservation_ms=600_000)

    async def run(*arguments):
        command = [sys.executable, "-m", "wonderland.cli", "uav", "reserve", "--pad", "pad-1"]
        command += ["--connection", str(world.directory / "ledger" / "connection.json"), *arguments]
        started = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
        out, err = await asyncio.wait_for(started.communicate(), 30)
        return started.returncode, (out + err).decode()

    assert await run() == (0, "pad-1 is kept for nobody\n")
    code, text = await run("--in", "5", "--minutes", "10")
    assert (code, "  uav-1  (by " in text) == (0, True), text
    code, text = await run("--in", "8")
    assert (code, "RESERVATION_TOO_LONG" in text) == (1, True), text
    code, text = await run("--in", "8", "--minutes", "5")
    assert (code, "PAD_RESERVED" in text) == (1, True), text
    assert await run("--give-up") == (0, "pad-1 is kept for nobody\n")


async def test_a_pad_that_starts_again_takes_up_who_waited(world):
    await world.second_uav()
    await world.policy(**OCCUPIED)
    async with world.uav() as first, world.uav(name="uav-2") as second:
        async with world.pad():
            landed = await decided(first, action="land")
            waiting = asyncio.create_task(decided(second))
            (session_id,) = await sessions_of(world, "uav-2")
            await asyncio.sleep(1)
        async with world.pad() as pad:
            assert pad.status()["queue"] == {"on_pad": "uav-1", "waiting": ["uav-2"]}
            await world.call("pad_operator", "RecordDeparture", session_id=landed.session_id)
            async with asyncio.timeout(20):
                result = await waiting
    assert (result.session_id, result.end) == (session_id, "done")


async def test_who_waits_too_long_is_told_asks_again_and_gives_up(world):
    await world.second_uav()
    await world.policy(**(OCCUPIED | {"session_ttl_ms": 9_000}))
    async with world.pad(), world.uav() as first, world.uav(name="uav-2", patience_s=9) as second:
        await decided(first, action="land")
        async with asyncio.timeout(40):
            result = await second.prove("pad-1", "land")
        assert (result.state, result.end) == ("cancelled", "queue_timeout")
        assert len(await sessions_of(world, "uav-2", count=2)) == 2
