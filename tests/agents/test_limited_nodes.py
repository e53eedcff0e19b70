"""Nodes that can do less than usual: plans follow what they can, and what none can follow is said before the request."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace

import pytest
from kit.agents import ANCHORS, commissioning

from wonderland.proofs.records.policies import Policy
from wonderland.toml_settings import SettingsError
from wonderland.uwb.agreed import ASSUMED, ability_of, no_plan, out_of_reach, pad_ability
from wonderland_edge_agent.commissioning.alone import alone
from wonderland_edge_agent.commissioning.errors import RadioError
from wonderland_edge_agent.commissioning.live.ask import ask_nodes
from wonderland_edge_agent.radios import AnchorPort, PadRadios
from wonderland_edge_agent.settings import parse
from wonderland_fira_uci.errors import RangingPlanError
from wonderland_fira_uci.uci.capabilities import (
    Capabilities,
    DeviceRoles,
    RframeConfigs,
    ScheduleModes,
)
from wonderland_fira_uci.uci.config import ParameterId
from wonderland_uav_agent.agent import UavAgentError

NOW_MS = 1_700_000_000_000
ROLES, SCHEDULES, CHANNELS, RFRAMES, SLOT, PAYLOAD = 0x05, 0x0A, 0x0E, 0x0F, 0x1D, 0x01
"""Ids of GET_CAPS_INFO since UCI 2."""


def says(world, names, **said: bytes) -> None:
    """Let nodes say something else of themselves, from their next reset on."""
    ids = {"roles": ROLES, "schedules": SCHEDULES, "channels": CHANNELS, "rframes": RFRAMES}
    ids |= {"slot": SLOT, "payload": PAYLOAD}
    for name in names:
        node = world.ports[name].node
        told = dict(node.profile.capabilities) | {ids[key]: value for key, value in said.items()}
        node.profile = replace(node.profile, capabilities=tuple(told.items()))


@contextlib.asynccontextmanager
async def ready_radios(world, **more):
    ports = [AnchorPort.of(anchor) for anchor in world.settings().anchors]
    async with PadRadios(ports, world.clock, **more) as radios, asyncio.timeout(20):
        while any(state.state != "up" for state in radios.states()):
            await asyncio.sleep(0.01)
        yield radios


async def requests(world) -> int:
    """How many prekeys the pad has left to take."""
    return len(await world.contract("uav").list_prekeys("pad-1", 50))


@pytest.mark.parametrize(
    ("said", "lack"),
    [
        ({"schedule_modes": ScheduleModes.CONTENTION}, "time-scheduled ranging"),
        ({"device_roles": DeviceRoles.RESPONDER}, "the role of an initiator"),
        ({"rframe_configs": RframeConfigs.SP3}, "frames SP1"),
        ({"channels": ()}, "a channel"),
        ({"bprf_sets": ()}, "the base pulse rate"),
        ({"min_slot_rstu": 1_000_000}, r"slots of 20 ms: its shortest slot takes 833\.3 ms"),
        ({"max_data_payload_octets": 20}, "data of 48 octets in a frame: it takes 20"),
    ],
)
def test_what_no_plan_can_do_without_is_named_with_its_side(said, lack):
    with pytest.raises(RangingPlanError, match=f"the drone's node cannot do .*{lack}"):
        ability_of(Capabilities(**said))


def test_the_anchor_that_lacks_something_is_named():
    contention = Capabilities(schedule_modes=ScheduleModes.CONTENTION)
    with pytest.raises(RangingPlanError, match=r"the node of anchor A2 cannot do time-scheduled"):
        pad_ability({"A1": Capabilities(), "A2": contention})
    assert pad_ability({"A1": None, "A2": None}) is None


@pytest.mark.parametrize(
    ("said", "lack"),
    [
        ({"schedules": b"\x01"}, "time-scheduled ranging"),
        ({"roles": b"\x01\x00"}, "the role of an initiator"),
        ({"rframes": b"\x08"}, "frames SP1"),
        ({"channels": b"\x00"}, "a channel"),
        ({"payload": b"\x14\x00"}, "data of 48 octets"),
        ({"slot": (1_000_000).to_bytes(4, "little")}, "slots of 20 ms"),
    ],
)
async def test_a_drone_whose_node_no_plan_can_use_takes_no_prekey(world, said, lack):
    says(world, ["uav"], **said)
    async with world.pad(), world.uav() as uav:
        before = await requests(world)
        with pytest.raises(UavAgentError, match=f"pad pad-1: the drone's node cannot do {lack}") as caught:
            await uav.prove("pad-1", "land")
        assert await requests(world) == before
    assert caught.value.code == "no_radio_plan"


async def test_a_pad_keeps_to_its_region_even_when_that_was_set_after_commissioning(world, caplog):
    says(world, ["uav"], channels=b"\x01")
    async with world.pad(uwb={"region": "JP"}), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "no_radio_plan")
    assert "the plan has channel 5, and region JP has channels 9, 10 alone" in caplog.text


async def test_the_same_pad_ranges_on_a_channel_that_the_region_has(world):
    async with world.pad(uwb={"region": "JP"}), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


def test_boards_that_have_one_channel_are_no_pad_where_the_region_lacks_it(tmp_path):
    with pytest.raises(SettingsError, match=r"region JP has channels 9, 10 alone, and DWM1001 boards use channel 5"):
        parse(
            {"pad_id": "p", "connection": "c", "spool": "s"}
            | {"uwb": {"kind": "dwm1001", "listen": "127.0.0.1:5481", "region": "JP"}},
            tmp_path / "pad.toml",
        )


def only_channel_five(world) -> None:
    """These refuse sessions on any other."""
    says(world, world.ports, channels=b"\x01")
    for port in world.ports.values():
        profile = port.node.profile
        port.node.profile = replace(profile, accepts={**profile.accepts, ParameterId.CHANNEL_NUMBER: frozenset((5,))})


async def test_nodes_that_have_channel_five_alone_range_a_drone(world):
    only_channel_five(world)
    record = replace(commissioning(world.clock()), nodes=replace(ASSUMED, channels=(5,)))
    await world.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=record.to_json())
    async with world.pad() as pad, world.uav() as uav:
        result = await uav.prove("pad-1", "land")
        assert pad.status()["reach"]["assurance"] >= 2
    assert result.verdict.outcome == "verified"


async def test_nodes_that_have_channel_five_alone_answer_the_roll(world):
    only_channel_five(world)
    macs = {name: 0xA000 + index for index, name in enumerate(ANCHORS)}
    async with ready_radios(world) as radios:
        await radios.call_roll(macs, 9)
        assert [state.state for state in radios.states()] == ["up"] * len(ANCHORS)
        assert len(await radios.measure_between(macs, rounds=1, channel=9)) == len(ANCHORS) * (len(ANCHORS) - 1)


async def test_the_roll_is_not_called_on_a_channel_that_the_region_lacks(world):
    only_channel_five(world)
    macs = {name: 0xA000 + index for index, name in enumerate(ANCHORS)}
    async with ready_radios(world, region="JP") as radios:
        assert await radios.measure_between(macs, rounds=1, channel=9) == {}


async def test_nodes_with_long_slots_answer_the_roll(world):
    says(world, world.ports, slot=(12_000).to_bytes(4, "little"))
    for port in world.ports.values():
        port.node.profile = replace(port.node.profile, least_slot_rstu=12_000)
    macs = {name: 0xA000 + index for index, name in enumerate(ANCHORS)}
    async with ready_radios(world) as radios:
        await radios.call_roll(macs, 9)
        assert [state.state for state in radios.states()] == ["up"] * len(ANCHORS)


@pytest.mark.parametrize("octets", [48, 60])
async def test_words_are_cut_to_what_nodes_take(world, octets):
    says(world, ["uav"], payload=octets.to_bytes(2, "little"))
    for port in world.ports.values():
        port.node.quirks = replace(port.node.quirks, max_data_octets=octets)
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


@pytest.mark.parametrize("slot_us", [10_000, 20_000])
def test_steps_wait_for_long_slots(make_duo, slot_us):
    duo = make_duo(nodes=replace(ASSUMED, slot_us=slot_us, word_octets=48))
    duo.run()
    assert duo.pad.plan.interval_ms >= 12 * slot_us / 1_000
    assert duo.verdict.outcome == "verified"


async def test_a_drone_with_slots_of_twenty_milliseconds_is_proved(world):
    says(world, ["uav"], slot=(24_000).to_bytes(4, "little"))
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"
    session = await world.contract("uav").read_session(result.session_id)
    assert session.node.slot_us == 20_000


def test_a_shared_lack_is_blamed_on_both_and_an_unknown_pad_is_not_cleared():
    weak = replace(ASSUMED, blinks="none")
    policy = Policy(min_assurance=3)
    record = replace(commissioning(NOW_MS, timed=True), nodes=weak)
    assert "the pad's nodes and the drone's node cannot do blinks" in out_of_reach(record, weak, policy)
    unknown = commissioning(NOW_MS, timed=True)
    found = out_of_reach(unknown, weak, policy)
    assert "what the pad's nodes can do is not in its commissioning" in found


def test_a_region_is_asked_of_the_plan_and_not_of_the_nodes():
    five = replace(ASSUMED, channels=(5,))
    record = commissioning(NOW_MS)
    assert no_plan(record, ASSUMED, "JP") == ""
    assert "channel 5" in no_plan(record, five, "JP")
    assert no_plan(record, five) == no_plan(record, five, "EU") == ""


async def test_a_pad_whose_record_tells_no_nodes_says_what_its_own_cannot_do(world, caplog):
    says(world, world.ports, roles=b"\x03\x00")
    await world.policy(min_assurance=3)
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert result.end == "assurance_out_of_reach"
    assert "the pad's nodes and the drone's node cannot do blinks" in caplog.text


# --- a pad that is commissioned from a recording ----------------------------------------------------------------------


async def test_a_commissioning_from_a_recording_asks_the_nodes(world):
    says(world, ["A1", "A2", "A3"], channels=b"\x09")
    says(world, ["A3"], slot=(6_000).to_bytes(4, "little"))
    told = await ask_nodes(world.settings(uwb={"region": "JP"}), list(ANCHORS))
    assert told.note == ""
    assert told.nodes == replace(ASSUMED, channels=(9,), slot_us=5_000, blinks=told.nodes.blinks)


async def test_a_commissioning_whose_nodes_an_agent_holds_says_that_it_did_not_ask(world):
    settings = world.settings()
    with alone(settings.spool):
        told = await ask_nodes(settings, list(ANCHORS))
    assert told.nodes is None
    assert "not on the record (the pad's agent seems to run" in told.note


async def test_a_commissioning_whose_nodes_are_not_there_says_so(world):
    anchors = [{"anchor_id": name, "port": str(world.directory / "nowhere" / name)} for name in ANCHORS]
    told = await ask_nodes(world.settings(anchors=anchors), list(ANCHORS))
    assert told.nodes is None
    assert "no port for A1, A2, A3, A4" in told.note


async def test_a_node_that_no_plan_can_use_is_not_commissioned(world):
    says(world, ["A2"], schedules=b"\x01")
    with pytest.raises(RadioError, match="the node of anchor A2 cannot do time-scheduled ranging"):
        await ask_nodes(world.settings(), list(ANCHORS))
