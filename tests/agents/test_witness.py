"""Two pads, one drone: the second one listens to its blinks, testifies by itself, and the verdict has assurance 4."""

from __future__ import annotations

import contextlib
import math
import random
from dataclasses import replace

import pytest
from kit.proof_world import START_MS
from kit.proof_world import World as Proofs

from wonderland.proofs.differences import Stamped, halved, judge_times
from wonderland.proofs.hyperbolic import Heard, TimeFix
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Party, Witness
from wonderland_edge_agent.session import actions as pad_do
from wonderland_edge_agent.session import events as pad_on
from wonderland_edge_agent.witness import frames_wanted
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration

OTHERS = {
    "W1": (8_000, 2_000, 1_200),
    "W2": (5_000, 2_000, 200),
    "W3": (5_000, -2_000, 200),
    "W4": (8_000, -2_000, 200),
}


async def second_pad(world) -> None:
    """A pad beside the first one, with its own identity, nodes and clock."""
    world.anchors |= OTHERS
    DirectoryAdministration(world.ledger.directory).enrol("pad-2", role="pad", pol_id="pad-2")
    world.all_identities = Connection.load(world.directory / "ledger")
    for name in OTHERS:
        world.add_node(name)
    survey = world.commissioning(timed=True).to_json()
    survey["anchors"] = [
        anchor | {"anchor_id": name, "mac": 0xA100 + index, "east_mm": east, "north_mm": north, "up_mm": up}
        for index, (anchor, (name, (east, north, up))) in enumerate(zip(survey["anchors"], OTHERS.items(), strict=True))
    ]
    await world.call(
        "pad_operator",
        "RegisterPad",
        pad_id="pad-2",
        name="Beside",
        operator_id="harbour",
        lat_e7=survey["frame"]["lat_e7"],
        lon_e7=survey["frame"]["lon_e7"],
        height_mm=survey["frame"]["height_mm"],
    )
    await world.call("pad_operator", "CommissionPad", pad_id="pad-2", commissioning=survey)


def witness_at(world):
    return world.pad(
        pad_id="pad-2",
        identity="pad-2",
        spool="spool-2",
        anchors=[{"anchor_id": name, "port": str(world.directory / f"tty-{name}")} for name in OTHERS],
    )


def test_a_witness_listens_until_nine_honest_drones_in_ten_are_settled():
    """It testifies once; what it heard too little of ends open, however long the other pad would have gone on."""
    proofs, rng, place = (
        Proofs(anchors=[at[:2] for at in OTHERS.values()]),
        random.Random(1),
        (4_000.0, 3_000.0, 6_000.0),
    )
    proofs.share_a_clock()
    session = proofs.session(proofs.claim(place, START_MS), min_assurance=4)
    frames = frames_wanted(session, proofs.commissioning)
    settled = 0
    for _ in range(300):
        heard = []
        for index, anchor in enumerate(proofs.commissioning.anchors):
            at = (float(anchor.east_mm), float(anchor.north_mm), float(anchor.up_mm))
            white, floor = 30.0**2 / frames, float(anchor.clock_sigma_mm**2 + anchor.survey_sigma_mm**2)
            length = math.dist(place, at) + rng.gauss(0, math.sqrt(white + floor))
            heard.append(Heard(index, *at, length, white, floor))
        claimed = (place[0] + rng.gauss(0, 100), place[1] + rng.gauss(0, 100))
        stamped = Stamped(TimeFix(tuple(heard), place[2], 200.0), *claimed, frames, float(frames), 0, 0.0, 0.0)
        settled += judge_times(stamped, halved(session.policy), None, 0.0).finding == "inside"
    assert settled >= 270


async def test_a_second_pad_witnesses_and_the_verdict_has_assurance_4(world):
    await second_pad(world)
    await world.share_a_clock()
    world.flight.stamp_noise_mm = 10.0  # with the noise that was surveyed one honest drone in ten ends open
    await world.policy(min_assurance=4, witness_pad_id="pad-2", session_ttl_ms=30_000)
    async with world.pad(), witness_at(world), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
        verdict = result.verdict
        assert verdict is not None
        assert (verdict.outcome, verdict.assurance) == ("verified", 4), verdict.reasons
        assert verdict.witness.pad_id == "pad-2"
        assert verdict.witness.frames >= 10
        testimony = await world.contract("mirror").read_testimony(result.session_id)
        assert testimony.time_stamps.bound_by == "key"
        assert [anchor.anchor_id for anchor in testimony.time_stamps.anchors] == list(OTHERS)
    assert len(world.acted) == 1


async def test_without_its_witness_nothing_is_verified(world):
    await second_pad(world)
    await world.share_a_clock()
    await world.policy(min_assurance=4, witness_pad_id="pad-2", session_ttl_ms=15_000)
    async with (
        world.pad(timing=replace(world.fast_pad, witness_ms=1_500)),
        contextlib.AsyncExitStack() as stack,
        world.uav() as uav,
    ):
        await stack.enter_async_context(witness_at(world))
        world.flight.silent |= set(OTHERS)  # its nodes hear nothing
        result = await uav.prove("pad-1", "land")
    assert result.verdict is not None
    assert (result.verdict.outcome, result.verdict.permission) == ("inconclusive", "refused")
    assert "no_witness" in {reason.code for reason in result.verdict.reasons}
    assert not world.acted


# --- the pad's machine ----------------------------------------------------------------------------------------------


@pytest.fixture
def duo(make_duo):
    made = make_duo(timed=True, policy=Policy(min_assurance=4, witness_pad_id="pad-2"))
    party = Party(msp_id="PadMSP", certificate_sha256="0" * 64)
    witness = Witness(
        pad_id="pad-2", prekey_id="w", pad_key=made.session.pad_key, party=party, commissioning_sha256="0" * 64
    )
    made.pad.session = made.session = replace(made.session, witness=witness)
    made.pad._awaits_witness = True
    return made


def test_the_pad_submits_once_the_witness_has_testified(duo):
    duo.on(lambda d: "witness" in d.pad._times, lambda d: d.tell_pad(pad_on.Witnessed("c" * 64)))
    duo.run()
    steps = duo.pad.evidence.steps
    assert steps["verdict"] - steps["confirm"] < 1_000
    assert len(duo.of(duo.pad_actions, pad_do.Submit)) == 1


def test_a_witness_that_is_early_is_not_waited_for(duo):
    duo.on(lambda d: d.pad.phase.value == "ranging", lambda d: d.tell_pad(pad_on.Witnessed("c" * 64)))
    duo.run()
    assert len(duo.of(duo.pad_actions, pad_do.Submit)) == 1
    assert duo.pad.evidence.steps["verdict"] - duo.pad.evidence.steps["confirm"] < 1_000


def test_a_witness_that_stays_away_is_waited_for_a_while(duo):
    duo.run()
    assert len(duo.of(duo.pad_actions, pad_do.Submit)) == 1
    waited_ms = duo.pad.evidence.steps["verdict"] - duo.pad.evidence.steps["confirm"]
    assert 6_000 <= waited_ms < 7_000
    assert duo.verdict.permission == "refused"
