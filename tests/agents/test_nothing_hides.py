"""What is wrong with a pad's nodes is noticed within seconds and named; a pad that has enough of them goes on."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import time

import pytest
from kit.agents import FAST_UAV, cured, decided, hang

from wonderland.uwb.agreed import ASSUMED
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.drift.baseline import Baseline, PairBaseline
from wonderland_edge_agent.health import HEALTH_S
from wonderland_edge_agent.metrics import exposition
from wonderland_edge_agent.spool import Spool
from wonderland_fira_uci.uci.config import ParameterId
from wonderland_simulator.uci_node import Measurement

NOTICED_S = 5.0


@pytest.fixture(autouse=True)
def _roll_calls_follow_soon(monkeypatch):
    monkeypatch.setattr("wonderland_edge_agent.radios.roll_calls.FIRST_S", 0.3)


async def until(condition, limit_s=NOTICED_S):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.05)


def named(pad, *words):
    """The status names it in one reason, and the metric says that nothing can be proved."""
    status = pad.status()
    found = any(all(word in reason for word in words) for reason in status["cannot_prove"])
    assert not found or b'accepts_sessions{pad_id="pad-1"} 0' in exposition(status)
    return found


def state(pad, name):
    (anchor,) = [each for each in pad.status()["anchors"] if each["anchor_id"] == name]
    return anchor


async def told(world):
    """What the backend will hear of the anchors, once the agent has gone."""
    async with await Spool.open(world.directory / "spool", owner="pad-1") as spool:
        found = await spool.pending(0, max_records=10_000, max_bytes=1 << 24)
    return [json.loads(each.body)["anchors"] for each in found if each.kind == "health"]


async def test_a_node_that_hangs_at_rest_is_named_everywhere_and_forgiven(world):
    assert NOTICED_S < HEALTH_S
    async with world.pad() as pad:
        await until(lambda: pad.status()["accepts_sessions"])
        hang(world.ports["A3"])
        await until(lambda: named(pad, "3 of 4 anchors can range", "A3", "not answered within"))
        assert state(pad, "A3")["state"] == "down"
        assert b'anchor_up{pad_id="pad-1",anchor_id="A3"} 0' in exposition(pad.status())
        await asyncio.sleep(1.5)
        world.ports["A3"].unplug()
        cured(world.ports["A3"])
        world.ports["A3"].plug()
        await until(lambda: pad.status()["accepts_sessions"])
    heard = [anchor for anchors in await told(world) for anchor in anchors if anchor["anchor_id"] == "A3"]
    assert any(anchor["state"] == "down" and "not answered within" in anchor["detail"] for anchor in heard)


async def test_a_node_that_answers_and_never_ranges_is_named_at_rest_and_forgiven(world):
    world.mute = {"A2"}
    async with world.pad(drift={"roll_call_every_s": 1}) as pad:
        await until(lambda: named(pad, "3 of 4 anchors can range", "A2", "no other anchor hears it"))
        assert state(pad, "A2")["state"] == "silent"
        assert all(state(pad, name)["state"] == "up" for name in ("A1", "A3", "A4"))
        world.mute = set()
        await until(lambda: pad.status()["accepts_sessions"])


async def test_the_first_one_that_never_ranges_is_named_and_not_the_others(world):
    world.mute = {"A1"}
    async with world.pad() as pad:
        await until(lambda: named(pad, "3 of 4", "A1 (no other anchor hears it"))


def not_heard(world, *names):
    """No other anchor hears these; a drone does."""
    measure = world.measure

    def hidden(one, other, t_s):
        alone = {*names} & {one, other} and "uav" not in {one, other}
        return Measurement(None, status=0x21) if alone else measure(one, other, t_s)

    return hidden


@pytest.mark.parametrize("names", [("A1", "A2", "A3", "A4"), ("A2", "A3", "A4")])
async def test_of_anchors_that_hear_nobody_it_is_not_known_whether_they_range_until_a_drone_is(
    world, monkeypatch, names
):
    monkeypatch.setattr(world.air, "measure", not_heard(world, *names))
    async with world.pad(drift={"roll_call_every_s": 1}) as pad, world.uav() as uav:
        await until(lambda: pad.status()["not_known"], 15)
        assert "(A1, A2, A3, A4)" in pad.status()["not_known"][0]
        assert b'wonderland_pad_not_known{pad_id="pad-1"} 1' in exposition(pad.status())
        assert pad.status()["accepts_sessions"]
        assert (await decided(uav)).verdict.outcome == "verified"
        await until(lambda: not pad.status()["not_known"])
        await asyncio.sleep(2.5)
        assert not pad.status()["not_known"]
        assert pad.status()["accepts_sessions"]


@pytest.mark.parametrize("names", [("A1", "A2", "A3", "A4"), ("A2", "A3", "A4")])
async def test_anchors_that_heard_each_other_when_they_were_commissioned_and_do_no_more_are_at_fault(world, names):
    pad = await world.contract("pad").read_pad("pad-1")
    Baseline({("A1", "A2"): PairBaseline(4_000.0, 4.0)}, 0, "commissioning").save(
        world.directory / "spool" / "anchors.json", pad.commissioning_sha256
    )
    world.mute = {*names}
    async with world.pad(drift={"roll_call_every_s": 1}) as pad:
        words = [f"{name} (no other anchor hears it" for name in names]
        await until(lambda: named(pad, "0 of 4 anchors can range", *words), 15)
        world.mute = set()
        await until(lambda: pad.status()["accepts_sessions"], 15)


async def test_anchors_that_have_heard_each_other_since_the_start_and_do_no_more_are_at_fault(world):
    async with world.pad(drift={"roll_call_every_s": 1}) as pad:
        await until(lambda: pad._radios._attendance._shown, 15)
        world.mute = set(world.anchors)
        await until(lambda: named(pad, "0 of 4 anchors can range", "A1 (no other", "A4 (no other"), 15)


def refuse_sessions(world):
    """Every node takes sessions on channel 5 only, whatever it says of itself."""
    for port in world.ports.values():
        accepts = {**port.node.profile.accepts, ParameterId.CHANNEL_NUMBER: frozenset((5,))}
        port.node.become(dataclasses.replace(port.node.profile, accepts=accepts))


async def test_nodes_that_all_refuse_ranging_sessions_are_named_once_and_with_what_they_lack(world, caplog):
    refuse_sessions(world)
    async with world.pad(drift={"roll_call_every_s": 1}) as pad:
        await until(lambda: named(pad, "0 of 4 anchors can range", "A1 (takes no ranging session", "A4 (takes no"), 15)
        await asyncio.sleep(2.5)
    assert len([each for each in caplog.records if "anchor A1: takes no ranging session" in each.getMessage()]) == 1


async def test_nodes_of_channel_5_on_a_pad_that_was_commissioned_so_are_well(world):
    record = dataclasses.replace(world.commissioning(), nodes=dataclasses.replace(ASSUMED, channels=(5,)))
    await world.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=record.to_json())
    refuse_sessions(world)
    async with world.pad(drift={"roll_call_every_s": 1}) as pad, world.uav() as uav:
        await until(lambda: pad._radios._attendance._shown, 15)
        assert pad.status()["accepts_sessions"]
        assert not pad.status()["not_known"]
        assert (await decided(uav)).verdict.outcome == "verified"


async def test_hidden_from_all_others_it_is_forgiven_for_good_once_it_ranges_a_drone(world, monkeypatch):
    monkeypatch.setattr(world.air, "measure", not_heard(world, "A2"))
    async with world.pad(drift={"roll_call_every_s": 1}) as pad, world.uav() as uav:
        await until(lambda: named(pad, "A2 (no other anchor hears it"))
        assert (await decided(uav)).verdict.outcome == "verified"
        await until(lambda: pad.status()["accepts_sessions"])
        await asyncio.sleep(2.5)
        assert pad.status()["accepts_sessions"]


def with_another_key(method, *, of=None):
    """A plan whose configuration, of this node or of all, carries another key than everybody else's."""

    def changed(plan, *index):
        config = method(plan, *index)
        if of is not None and index != (of,):
            return config
        return dataclasses.replace(config, app=dataclasses.replace(config.app, session_key=bytes(16)))

    return changed


async def test_an_anchor_with_a_wrong_key_is_named(world, monkeypatch):
    monkeypatch.setattr(RangingPlan, "pad_ranging", with_another_key(RangingPlan.pad_ranging, of=3))
    async with world.pad(drift={"roll_call_every_s": 1}) as pad, world.uav() as uav:
        asking = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: named(pad, "3 of 4", "A4", "another key"), 8)
        assert (await asking).verdict.outcome == "inconclusive"
        await asyncio.sleep(1.5)  # a roll call, which has a key of its own, does not clear it
        assert named(pad, "A4", "another key")
        assert "A1" not in str(pad.status()["cannot_prove"])


async def test_a_drone_with_a_wrong_key_ends_the_session_within_seconds_and_by_name(world, monkeypatch):
    monkeypatch.setattr(RangingPlan, "uav_ranging", with_another_key(RangingPlan.uav_ranging))
    slow = dataclasses.replace(world.fast_pad, reply_ms=30_000)
    async with world.pad(timing=slow) as pad, world.uav() as uav:
        began = time.monotonic()
        result = await uav.prove("pad-1", "land")
        assert time.monotonic() - began < 9
        assert result.verdict is None or result.verdict.outcome != "verified"
        await until(lambda: not pad.status()["cannot_prove"])  # the pad is well
    async with await Spool.open(world.directory / "spool", owner="pad-1") as spool:
        found = await spool.pending(0, max_records=10_000, max_bytes=1 << 24)
    steps = [json.loads(each.body) for each in found if each.kind == "step"]
    assert any("another key" in step.get("detail", "") for step in steps)


@pytest.mark.parametrize("lost", ["A1", "A4"])
async def test_a_pad_of_five_with_one_missing_from_the_start_goes_on_and_says_so(world, lost):
    await world.extend(5)
    world.ports[lost].unplug()
    async with world.pad() as pad, world.uav() as uav:
        await until(lambda: pad.status()["goes_on_without"])
        (word,) = pad.status()["goes_on_without"]
        assert word.startswith(f"{lost} (")
        await until(lambda: pad.status()["accepts_sessions"])
        assert (await decided(uav)).verdict.outcome == "verified"


async def test_nobody_says_that_a_pad_can_prove_before_its_anchors_were_looked_at(world):
    said = []
    async with world.pad() as pad:
        while not pad.status()["accepts_sessions"]:
            said += pad.status()["cannot_prove"]
            await asyncio.sleep(0.01)
        assert any(each.startswith("not known yet") and "(A1, A2, A3, A4)" in each for each in said)
        assert all(anchor["state"] == "up" for anchor in pad.status()["anchors"])
        world.ports["A2"].unplug()
        await until(lambda: state(pad, "A2")["state"] == "down")
        world.ports["A2"].plug()
        # Looked at as soon as it is back, long before the next roll call is due.
        await until(lambda: named(pad, "not known yet", "(A2)") or pad.status()["accepts_sessions"])
        await until(lambda: pad.status()["accepts_sessions"], 3)


async def test_a_first_node_that_answers_and_never_ranges_leaves_speaking_to_another(world):
    await world.extend(5)
    world.mute = {"A1"}
    async with world.pad() as pad, world.uav() as uav:
        await until(lambda: pad.status()["goes_on_without"])
        assert (await decided(uav)).verdict.outcome == "verified"


async def test_the_node_that_speaks_is_pulled_in_mid_session_and_another_goes_on(world):
    await world.extend(5)
    async with world.pad() as pad, world.uav() as uav:
        asking = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: pad._radios._voice)
        assert pad._radios._voice == "A1"
        await asyncio.sleep(0.1)
        world.ports["A1"].unplug()
        await until(lambda: pad._radios._voice not in {"", "A1"} or asking.done())
        assert (await asking).verdict.outcome == "verified"


async def test_the_node_that_speaks_hangs_in_mid_session_and_another_goes_on(world):
    await world.extend(5)
    slow = dataclasses.replace(world.fast_pad, reply_ms=6_000, silence_ms=3_000, identity_ms=6_000, echo_ms=6_000)
    slow = dataclasses.replace(slow, confirm_ms=6_000)  # a busy machine has other things to do, too
    async with world.pad(timing=slow) as pad, world.uav() as uav:
        with contextlib.suppress(TimeoutError):
            await until(lambda: pad.status()["accepts_sessions"], 3)
        asking = asyncio.create_task(decided(uav))
        await until(lambda: pad._radios._voice)
        hang(world.ports["A1"])
        verdict = (await asking).verdict
        assert verdict.outcome == "verified", verdict.reasons
        assert pad.status()["goes_on_without"]


async def test_a_node_that_gives_no_credit_is_named_and_another_speaks_in_its_place(world, caplog):
    node = world.ports["A1"].node
    node.notify_credit = lambda _session: None
    slow = dataclasses.replace(world.fast_pad, reply_ms=8_000, silence_ms=4_000, identity_ms=8_000, echo_ms=8_000)
    slow = dataclasses.replace(slow, confirm_ms=8_000)
    async with (
        world.pad(timing=slow) as pad,
        world.uav(timing=dataclasses.replace(FAST_UAV, pad_silence_ms=8_000)) as uav,
    ):
        result = await decided(uav)
        assert result.verdict.outcome == "verified", result
        assert state(pad, "A1") | {"firmware": ""} == {
            "anchor_id": "A1",
            "state": "silent",
            "detail": "accepts no data (no credit)",
            "firmware": "",
        }
        assert "the voice of A1 (accepts no data (no credit))" in pad.status()["goes_on_without"]
        assert pad.status()["accepts_sessions"]
        del node.notify_credit
        world.ports["A1"].unplug()
        await until(lambda: state(pad, "A1")["state"] == "down")
        world.ports["A1"].plug()
        await until(lambda: state(pad, "A1")["state"] == "up")
    assert [each for each in caplog.records if "anchor A1: accepts no data (no credit)" in each.getMessage()]
    heard = [anchor for anchors in await told(world) for anchor in anchors if anchor["anchor_id"] == "A1"]
    assert any(anchor.get("detail") == "accepts no data (no credit)" for anchor in heard)


async def test_a_drone_that_asks_and_has_no_radio_makes_no_healthy_node_look_mute(world):
    world.ports["uav"].unplug()
    slow = dataclasses.replace(world.fast_pad, reply_ms=4_000, silence_ms=4_000)
    async with (
        world.pad(timing=slow) as pad,
        world.uav(timing=dataclasses.replace(FAST_UAV, pad_silence_ms=8_000)) as uav,
    ):
        asking = asyncio.create_task(uav.prove("pad-1", "land"))
        await until(lambda: pad._radios._words is not None)
        await until(lambda: pad._radios._words is None or pad._radios._words.credit_timeouts >= 3)
        await until(lambda: not pad.status()["session"], 10)
        await asyncio.gather(asking, return_exceptions=True)
        assert pad.status()["goes_on_without"] == []
        world.ports["uav"].plug()
        assert (await decided(uav)).verdict.outcome == "verified"
        assert pad.status()["cannot_prove"] == []


@pytest.mark.parametrize("anchors", [6, 8])
async def test_pads_of_six_and_of_eight_verify(world, anchors):
    await world.extend(anchors)
    async with world.pad() as pad, world.uav() as uav:
        await until(lambda: pad.status()["accepts_sessions"])
        result = await decided(uav)
        said = (result.verdict.outcome, result.verdict.permission)
        assert said == ("verified", "granted"), (result.verdict.reasons, result.verdict.rounds)
        assert pad.status()["goes_on_without"] == []
        assert len(pad.status()["anchors"]) == anchors
    assert world.air.collisions == 0
