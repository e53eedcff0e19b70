"""Whole proofs: radio bytes, agents, signed transactions, blocks, permission."""

from __future__ import annotations

import asyncio
import json
import socket
import time

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from wonderland.proof_contract import RefusedError
from wonderland.proofs.records.sessions import STEP_NAMES, Radio
from wonderland_edge_agent.ports import AgentError
from wonderland_edge_agent.session import machine
from wonderland_edge_agent.spool import Spool
from wonderland_remote_id import BasicId, IdType, Location, Pack, encode
from wonderland_remote_id.drip import Det, SamType, paginate
from wonderland_remote_id.drip.formats import sign_evidence
from wonderland_uav_agent.agent import UavAgentError


async def records(world):
    """What the pad's spool holds for the backend, by kind, once its agent has gone."""
    async with await Spool.open(world.directory / "spool", owner="pad-1") as spool:
        found = await spool.pending(0, max_records=10_000, max_bytes=1 << 24)
        left = await spool.sessions()
    by_kind = {}
    for record in found:
        by_kind.setdefault(record.kind, []).append(json.loads(record.body))
    return by_kind, left


async def until(condition, limit_s=10.0):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.01)


async def until_state(world, session_id, *states, limit_s=15.0):
    ledger = world.contract("mirror")
    async with asyncio.timeout(limit_s):
        while (session := await ledger.read_session(session_id)).state not in states:
            await asyncio.sleep(0.05)
    return session


async def test_an_honest_drone_is_verified_permitted_and_completes(world, monkeypatch):
    radios = []
    monkeypatch.setattr(machine, "Radio", lambda **fields: radios.append(Radio(**fields)) or radios[-1])
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
        session = await until_state(world, result.session_id, "completed")
    assert (result.state, result.end) == ("completed", "done")
    assert result.verdict.outcome == "verified"
    assert result.verdict.assurance == 2
    assert result.verdict.rounds <= radios[-1].attempted_rounds < 2 * result.verdict.rounds
    assert session.end == "done"
    assert [verdict.session_id for verdict in world.acted] == [result.session_id]
    assert list(result.steps) == list(STEP_NAMES)
    told, left = await records(world)
    assert left == {}
    assert [step["step"] for step in told["step"]] == list(STEP_NAMES)
    assert [end["state"] for end in told["session_end"]] == ["completed"]
    assert told["estimate"][-1]["rounds"] >= 10
    # The latest round alone may lack an anchor, over all of them each is there.
    assert {name for estimate in told["estimate"] for name in estimate["ranges"]} == {"A1", "A2", "A3", "A4"}
    assert told["health"]


async def test_several_proofs_one_after_the_other_each_with_its_own_prekey(world):
    async with world.pad() as pad, world.uav() as uav:
        results = [await uav.prove("pad-1", action) for action in ("land", "takeoff", "land", "takeoff")]
        await until(lambda: pad.status()["prekeys"] >= 4)
    assert {result.verdict.outcome for result in results} == {"verified"}
    assert len({result.session_id for result in results}) == 4


async def test_whole_certificates_over_the_radio(world):
    async with world.pad(whole_certificate=True), world.uav(whole_certificate=True) as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


async def test_a_drone_that_is_elsewhere_is_refuted_and_does_not_act(world):
    world.flight.truth = (16_000.0, 3_000.0, 6_000.0)
    async with world.pad() as pad, world.uav() as uav:
        result = await uav.prove("pad-1", "land")
        # The drone may hear of the verdict before the pad has the answer to its own transaction.
        await until(lambda: not pad.status()["session"])
    assert (result.state, result.end) == ("decided", "refused")
    assert result.verdict.outcome == "refuted"
    assert not world.acted
    told, left = await records(world)
    assert left == {}
    assert told["session_end"][0]["end"] == "refused"


async def test_a_drone_without_authorisation_is_verified_and_refused(world):
    await world.call("admin", "RevokeAuthorisation", uav_id="uav-1", authorisation_id="a1", reason="test")
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert (result.verdict.outcome, result.verdict.permission) == ("verified", "refused")
    assert not world.acted


async def test_a_suspended_drone_asks_in_vain(world):
    await world.call("admin", "SetUavStatus", uav_id="uav-1", status="suspended", reason="test")
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.permission == "refused"


async def test_an_action_that_fails_is_recorded_as_aborted(world):
    async def crash(verdict):
        raise OSError("the landing gear\nis stuck")

    async with world.pad(), world.uav(act=crash) as uav:
        result = await uav.prove("pad-1", "land")
        session = await until_state(world, result.session_id, "completed")
    assert (result.end, session.end) == ("aborted", "aborted")
    assert "landing gear is stuck" in session.note


async def test_a_drone_whose_node_is_off_the_air_leaves_a_recorded_end(world):
    world.ports["uav"].unplug()
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
        session = await until_state(world, result.session_id, "cancelled", "decided")
    assert not world.acted
    assert session.state == "cancelled" or (await world.contract("mirror").read_verdict(session.session_id))


async def test_a_drone_that_vanishes_after_its_request_is_judged_without_it(world):
    async with world.pad(), world.uav() as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: uav._runner is not None)
        session_id = uav._runner.session.session_id
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)
        await until_state(world, session_id, "decided")
    verdict = await world.contract("mirror").read_verdict(session_id)
    assert verdict.permission == "refused"
    assert "no_reply" in {reason.facts.get("failure") for reason in verdict.reasons}


async def test_three_of_four_anchors_still_range(world):
    world.ports["A3"].unplug()
    await world.policy(max_rounds=20)
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict is not None
    assert any(reason.code == "anchor_silent" for reason in result.verdict.reasons)


async def test_without_its_first_node_another_speaks(world):
    world.ports["A1"].unplug()
    await world.policy(max_rounds=20)
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict is not None
    assert any(reason.code == "anchor_silent" for reason in result.verdict.reasons)


async def test_a_pad_with_two_nodes_left_cancels(world):
    world.ports["A1"].unplug()
    world.ports["A2"].unplug()
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "radios_unavailable")


async def test_an_anchor_pulled_and_put_back_while_ranging_does_not_end_the_session(world):
    await world.policy(verify_ppm=999_999, refute_ppm=1, max_rounds=80)
    world.flight.truth = (world.flight.claimed[0] + 600.0, *world.flight.claimed[1:])
    async with world.pad() as pad, world.uav() as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: pad._runner is not None and pad._runner._machine.evidence.rounds >= 3)
        world.ports["A4"].unplug()
        await asyncio.sleep(0.3)
        world.ports["A4"].plug()
        result = await working
    assert result.verdict is not None
    assert not any(reason.code == "session_stopped" for reason in result.verdict.reasons)


async def test_a_pad_that_is_stopped_in_mid_session_ends_it(world):
    async with world.uav() as uav:
        async with world.pad() as pad:
            working = asyncio.create_task(uav.prove("pad-1", "land"))
            await until(lambda: pad._runner is not None and pad._runner._machine.evidence.rounds >= 2)
        result = await working
    assert (result.state, result.end) == ("cancelled", "agent_stopped")
    _, left = await records(world)
    assert left == {}


async def test_a_pad_that_was_killed_ends_the_session_when_it_is_back(world, monkeypatch):
    async with world.uav() as uav:
        async with world.pad() as pad:
            working = asyncio.create_task(uav.prove("pad-1", "land"))
            await until(lambda: pad._runner is not None and pad._runner._machine.evidence.rounds >= 2)
            monkeypatch.setattr(pad, "_stop", _die)  # as after kill -9: nothing is said any more
        async with world.pad():
            result = await working
    assert (result.state, result.end) == ("cancelled", "agent_restart")
    told, left = await records(world)
    assert left == {}
    assert [end["end"] for end in told["session_end"]] == ["agent_restart"]


async def _die(tasks):
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def test_a_request_made_while_the_pad_was_away_is_served_when_it_comes(world):
    async with world.pad():
        pass
    async with world.uav() as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        await asyncio.sleep(0.3)
        async with world.pad():
            result = await working
    assert result.verdict.outcome == "verified"


async def test_a_permission_that_nobody_completes_lapses(world):
    await world.policy(session_ttl_ms=5_000)

    async def hover(verdict):
        await asyncio.sleep(60)

    async with world.pad(), world.uav(act=hover) as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        result = await working
        session = await until_state(world, result.session_id, "cancelled")
    assert (result.state, session.end) == ("cancelled", "permission_expired")


async def test_a_second_agent_of_the_same_pad_is_refused_in_words(world):
    async with world.pad():
        with pytest.raises(AgentError, match="another agent"):
            async with world.pad():
                pass


async def test_an_identity_of_someone_else_is_refused_before_anything_opens(world):
    with pytest.raises(AgentError, match="not for pad pad-1"):
        async with world.pad(identity="uav"):
            pass


async def test_a_full_spool_refuses_sessions_and_says_so(world, monkeypatch):
    async with world.pad() as pad, world.uav() as uav:
        monkeypatch.setattr(type(pad._spool), "accepts_sessions", property(lambda spool: False))
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "pad_spool_full")


async def test_what_cannot_begin_is_said(world):
    async with world.uav() as uav:
        with pytest.raises(UavAgentError, match="offers no prekey"):
            await uav.prove("pad-1", "land")
        with pytest.raises(RefusedError, match="PAD_UNKNOWN"):
            await uav.prove("pad-9", "land")


async def test_a_ledger_that_restarts_in_mid_session_costs_nothing_but_time(world):
    async with world.pad() as pad, world.uav() as uav:
        working = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: pad._runner is not None and pad._runner._machine.evidence.rounds >= 2)
        await world.restart_ledger(pause_s=1.0)
        result = await working
    assert result.verdict.outcome == "verified"
    assert (result.state, result.end) == ("completed", "done")


async def test_status_says_how_the_pad_is(world):
    async with world.pad() as pad:
        await until(lambda: pad.status()["accepts_sessions"])  # a first roll call has shown that its anchors range
        status = pad.status()
        await until((world.directory / "spool" / "status.json").exists)
    assert status["prekeys"] == 6
    assert {anchor["state"] for anchor in status["anchors"]} == {"up"}
    assert (status["reach"]["assurance"], status["reach"]["unknown"]) == (2, [])
    assert "assurance 3: anchor A1 cannot do UL-TDoA" in status["reach"]["missing"]
    assert json.loads((world.directory / "spool" / "status.json").read_text())["pad_id"] == "pad-1"


async def test_two_drones_at_once_are_served_one_after_the_other(world):
    await world.second_uav()
    async with world.pad() as pad, world.uav() as first, world.uav(name="uav-2") as second:
        working = [asyncio.create_task(uav.prove("pad-1", "land")) for uav in (first, second)]
        results = await asyncio.gather(*working)
        assert pad.status()["sessions_run"] == 2
        await until(lambda: not pad.status()["session"])  # the drones are done a moment before the pad is
    assert {result.verdict.outcome for result in results} == {"verified"}
    assert {result.end for result in results} == {"done"}
    assert world.air.collisions == 0, "the one that waits 30 m above has its radio open"
    told, _ = await records(world)
    assert len(told["session_end"]) == 2


async def test_a_flood_of_requests_is_ended_and_the_next_drone_is_served(world, monkeypatch):
    monkeypatch.setattr("wonderland_edge_agent.waiting.MAX_WAITING", 1)
    monkeypatch.setattr("wonderland_edge_agent.agent.CARE_S", 0.2)
    await world.policy(session_ttl_ms=8_000)
    ledger = world.contract("uav")
    async with world.pad(prekeys=8), world.uav() as uav:
        from wonderland.proofs import encoding, keys
        from wonderland.proofs.records.transactions import RequestProof

        sessions = []
        for prekey in (await ledger.list_prekeys("pad-1", 10))[:4]:
            argument = RequestProof(
                pad_id="pad-1",
                action="land",
                prekey_id=prekey.prekey_id,
                uav_key=encoding.to_base64url(keys.public_bytes(keys.new_key())),
                claim=world.flight.claim(world.clock()),
            )
            sessions.append((await ledger.request_proof(argument))[0].session_id)
        ends = [await until_state(world, session_id, "cancelled", "decided") for session_id in sessions]
        assert any(end.end == "pad_overloaded" for end in ends)
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


async def test_the_whole_way_with_time_stamps_an_honest_drone_and_one_whose_radio_lies(world):
    """Blinks over UCI, four ports, one clock: the ranges fit both claims, the time stamps only one."""
    await world.share_a_clock()
    await world.policy(min_assurance=3, session_ttl_ms=20_000)
    async with world.pad(), world.uav() as uav:
        honest = await uav.prove("pad-1", "land")
        assert honest.verdict is not None
        assert (honest.verdict.outcome, honest.verdict.assurance) == ("verified", 3), honest.verdict.reasons
        assert honest.verdict.time_differences.frames >= 10
        assert honest.verdict.clock.readings >= 3
        world.flight.claimed = world.flight.ranged = (7_500.0, 3_000.0, 6_000.0)
        world.drawn.clear()
        liar = await uav.prove("pad-1", "land")
    assert liar.verdict is not None
    assert (liar.verdict.outcome, liar.verdict.permission) == ("refuted", "refused"), liar.verdict.reasons
    assert "time_differences_contradict" in {reason.code for reason in liar.verdict.reasons}
    assert len(world.acted) == 1


async def test_who_signed_the_broadcasts_is_told_with_the_end_of_the_session(world):
    key = Ed25519PrivateKey.generate()
    host_identity = key.public_key().public_bytes_raw()
    det = Det.of(host_identity, raa=10, hda=20)
    roots = {"registries": [{"det": str(det), "host_identity": host_identity.hex(), "name": "HDA 20"}]}
    (world.directory / "registries.json").write_text(json.dumps(roots))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        address = probe.getsockname()
    remote_id = {"listen": f"127.0.0.1:{address[1]}", "drip": "registries.json"}

    async def broadcast(uav_id):
        while True:
            now_ms = int(time.time() * 1000)
            here = world.flight.claim(now_ms)
            place = Location(lat_e7=here.lat_e7, lon_e7=here.lon_e7)
            messages = (BasicId(uas_id=uav_id, id_type=IdType.SERIAL_NUMBER), place)
            signed = sign_evidence(encode(place), det, (now_ms - 1_000, now_ms + 60_000), key.sign)
            for page in paginate(signed.sam(SamType.WRAPPER), now_ms):
                frame = encode(Pack(messages=(*messages, page)))
                sender.sendto(frame, address)
            await asyncio.sleep(0.1)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        async with world.pad(remote_id=remote_id), world.uav() as uav:
            sending = asyncio.create_task(broadcast(uav.uav_id))
            result = await uav.prove("pad-1", "land")
            await until_state(world, result.session_id, "completed")
            sending.cancel()
    told, _ = await records(world)
    signature = told["session_end"][0]["signature"]
    assert (signature["state"], signature["signer"], signature["covers_location"]) == ("verified", "HDA 20", True)
    assert signature["bound"] is False, "its serial number is not made from the entity tag"
