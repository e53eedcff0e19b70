"""What both sides' nodes can do decides the plan; what cannot work is said before anything goes on the air."""

import asyncio
from collections import Counter
from dataclasses import replace

import pytest
from kit.agents import commissioning

from wonderland.proofs import keys
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.radios import NodeAbility
from wonderland.proofs.transcript import transcript_of
from wonderland.uwb.agreed import ASSUMED, PREAMBLE_CODES_OF_ALL, ability_of, agreed_plan, no_plan, out_of_reach
from wonderland.uwb.layout import STEPS_MS
from wonderland_fira_uci.uci.capabilities import decode_capabilities
from wonderland_uav_agent.agent import UavAgentError
from wonderland_uav_agent.results import lines

NOW_MS = 1_700_000_000_000
DWM3001CDK = bytes.fromhex(
    "0c 00020301 0102ff00 020402000200 030402000200 040103 05020300 06021e00 070119 080103 090102 0a0102 0e0109"
)
"""What such a board said that the plan depends on: the first of its 26 parameters, its schedule and its channels."""


async def commissioned(world, nodes: NodeAbility) -> None:
    record = replace(commissioning(world.clock()), nodes=nodes)
    await world.call("pad_operator", "CommissionPad", pad_id="pad-1", commissioning=record.to_json())


def test_a_dwm3001cdk_gives_assurance_two_on_its_channels():
    found = ability_of(decode_capabilities(DWM3001CDK, 0x0002))
    assert found == replace(ASSUMED, channels=(5, 9), blinks="none")


def test_a_node_that_says_nothing_is_taken_for_what_published_stacks_can():
    assert ability_of(None) is None
    assert no_plan(commissioning(NOW_MS), None) == ""
    assert out_of_reach(commissioning(NOW_MS, timed=True), None, Policy(min_assurance=4)) == ""
    assert "share no clock" in out_of_reach(commissioning(NOW_MS), None, Policy(min_assurance=3))


@pytest.mark.parametrize(
    ("pad", "drone", "level", "said"),
    [
        ({"blinks": "none"}, {}, 3, "the pad's nodes cannot do blinks"),
        ({}, {"blinks": "none"}, 4, "the drone's node cannot do blinks"),
        ({"sts": "static"}, {}, 2, "the pad's nodes cannot do provisioned STS"),
        ({"blinks": "none"}, {"blinks": "none"}, 2, ""),
    ],
)
def test_what_stands_in_the_way_of_a_level_is_named(pad, drone, level, said):
    record = replace(commissioning(NOW_MS), nodes=replace(ASSUMED, **pad))
    found = out_of_reach(record, replace(ASSUMED, **drone), Policy(min_assurance=level))
    assert said in found
    assert bool(found) == bool(said)


async def test_nodes_that_carry_data_as_initiators_only_take_two_sessions_on_one_time_base(world):
    for port in world.ports.values():
        port.node.quirks = replace(port.node.quirks, responder_data=False)
    await commissioned(world, replace(ASSUMED, words="initiator"))
    async with world.pad(uwb={"words": "initiator"}), world.uav(words="initiator") as uav:
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"
    assert world.air.collisions == 0
    session = await world.contract("uav").read_session(result.session_id)
    assert session.node.words == "initiator"
    assert transcript_of(session, "wonderland").node == session.node


async def test_the_drone_that_names_another_node_has_another_transcript(world):
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    session = await world.contract("uav").read_session(result.session_id)
    assert session.node is not None
    said = transcript_of(session, "wonderland").digest()
    other = replace(session, node=replace(session.node, words="initiator"))
    assert transcript_of(other, "wonderland").digest() != said


async def test_a_policy_above_what_the_nodes_reach_is_refused_at_the_pad_and_said_beforehand(world, capsys):
    await commissioned(world, replace(ASSUMED, blinks="none"))
    await world.policy(min_assurance=3)
    async with world.pad() as pad, world.uav() as uav:
        async with asyncio.timeout(20):
            while any("not known yet" in each for each in pad.status()["cannot_prove"]):
                await asyncio.sleep(0.05)
        (reason,) = pad.status()["cannot_prove"]
        assert "the policy demands assurance 3, and the pad's nodes cannot do blinks" in reason
        assert "(to land, take off, dock)" in reason
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "assurance_out_of_reach")
    said = "the policy demands assurance 3, and the pad's nodes and the drone's node cannot do blinks (UL-TDoA)"
    assert (await world.contract("uav").read_session(result.session_id)).note == said
    print("\n".join(lines(result)))
    assert capsys.readouterr().out == (
        "No verdict: the policy demands more assurance than the nodes of pad and drone can reach. "
        f"{said[:1].upper()}{said[1:]}.\n"
    )


async def test_nodes_without_a_common_channel_ask_for_nothing(world):
    await commissioned(world, replace(ASSUMED, channels=(11,)))
    async with world.pad(), world.uav() as uav:
        with pytest.raises(UavAgentError, match=r"channels \(11,\)") as caught:
            await uav.prove("pad-1", "land")
    assert caught.value.code == "no_radio_plan"


def test_sessions_draw_every_code_with_every_length_of_block():
    """By other bits of the id, and by none that is the same in all of them."""
    drawn = Counter()
    for number in range(1_600):
        derived = keys.derive(number.to_bytes(32, "big"), bytes(32))
        plan = agreed_plan(derived, commissioning(NOW_MS), None)
        drawn[plan.preamble_code, plan.interval_ms] += 1
    assert {code for code, _ in drawn} == {*PREAMBLE_CODES_OF_ALL}
    assert len(drawn) == len(PREAMBLE_CODES_OF_ALL) * STEPS_MS
    assert min(drawn.values()) > 60


def test_a_record_names_the_weakest_of_its_nodes_and_keeps_its_bytes():
    record = replace(commissioning(NOW_MS), nodes=ASSUMED)
    assert Commissioning.decode(record.encode()) == record


def test_words_are_cut_to_the_smallest_frame(make_duo):
    duo = make_duo(nodes=replace(ASSUMED, word_octets=48))
    lengths = []
    for machine in (duo.pad, duo.uav):
        send = machine.frames_to_send
        machine.frames_to_send = lambda now_ms, send=send: (
            lengths.append(sum(map(len, frames := send(now_ms)))) or frames
        )
    duo.run()
    assert duo.verdict.outcome == "verified"
    assert max(lengths) == 48
