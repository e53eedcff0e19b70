"""The paper's boards turned round: an anchor on the drone, a tag behind each serial port of the pad; still assurance 0."""

from __future__ import annotations

import asyncio
import contextlib
import random

import pytest

from wonderland_edge_agent.radios.reported import TagRadios
from wonderland_fira_uci.dwm1001 import BoardPosition, Timings
from wonderland_fira_uci.errors import NodeError
from wonderland_simulator.dwm1001_node import Quirks, VirtualAnchor, VirtualDwm1001
from wonderland_simulator.uci_node import PtyPort
from wonderland_uav_agent.radio.tag import TagRadio

ANCHOR_NAMES = ("A1", "A2", "A3", "A4")
QUICK = Timings(poll_ms=25, listen_ms=50, prompt_ms=300)
BOARD = 0x1A2B


@contextlib.asynccontextmanager
async def proofs(world, *, board=BOARD, anchors_by_mistake=()):
    """A pad of four tags, a drone with an anchor; both agents at work. ``board``: what the drone says that it carries."""
    drone = [VirtualAnchor(BOARD, "uav", BoardPosition(0, 0, 0))]
    ports = {}
    for index, name in enumerate((*ANCHOR_NAMES, "uav")):
        tag = VirtualDwm1001(
            name, drone if name != "uav" else [], world.measure, rng=random.Random(index), quirks=Quirks(update_ms=100)
        )
        if name in anchors_by_mistake or name == "uav":
            tag.mode = "ain"
        ports[name] = PtyPort(tag, world.directory / f"tty-dwm-{name}")
        ports[name].plug()
    anchors = [{"anchor_id": name, "port": str(ports[name].path)} for name in ANCHOR_NAMES]
    try:
        async with world.pad(anchors=anchors, uwb={"kind": "dwm1001-tags", "listen": "127.0.0.1:0"}) as pad:
            radios = pad._radios
            assert isinstance(radios, TagRadios)
            async with (
                TagRadio(ports["uav"].path, radios.address, world.clock, timings=QUICK, board=board) as radio,
                world.uav(radio=radio) as uav,
            ):
                yield pad, uav
    finally:
        for port in ports.values():
            port.close()


async def test_the_pads_own_ranges_that_nothing_binds_have_assurance_0(world):
    await world.policy(min_assurance=0)
    async with proofs(world) as (pad, uav):
        result = await uav.prove("pad-1", "land")
        assert {each["state"] for each in pad.status()["anchors"]} == {"up"}
    assert (result.verdict.outcome, result.verdict.assurance) == ("verified", 0)
    said = {reason.code: reason.facts for reason in result.verdict.reasons}
    assert said["ranges_unbound"] == {"measured_by": "pad"}
    assert "upper_bound" not in said
    assert result.verdict.within_mm is None
    assert (result.state, result.end) == ("completed", "done")


async def test_the_default_policy_refuses_what_any_board_with_that_address_would_pass(world):
    """Before anything is ranged, and in the pad's status before anybody asks."""
    async with proofs(world) as (pad, uav):
        status = pad.status()
        assert "the policy demands assurance 1, and nothing binds" in status["cannot_prove"][0]
        assert status["reach"]["assurance"] == 0
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "assurance_out_of_reach")
    assert "nothing binds these boards' ranges to a session" in result.detail
    assert not world.acted


async def test_a_policy_that_takes_it_leaves_the_pad_able(world):
    await world.policy(min_assurance=0)
    async with proofs(world) as (pad, _):
        assert pad.status()["accepts_sessions"]
        assert pad.status()["reach"]["assurance"] == 0


async def test_boards_in_the_wrong_role_are_named_and_the_pad_cannot_prove(world):
    await world.policy(min_assurance=0)
    async with proofs(world, anchors_by_mistake=("A2", "A4")) as (pad, _):
        async with asyncio.timeout(10):
            while "an anchor" not in str(pad.status()["anchors"]):
                await asyncio.sleep(0.05)
        states = {each["anchor_id"]: (each["state"], each.get("detail", "")) for each in pad.status()["anchors"]}
        for name in ("A2", "A4"):
            state, detail = states[name]
            assert state == "down"
            assert "configured as an anchor" in detail
            assert "uwb prepare" in detail
        assert not pad.status()["accepts_sessions"]


async def test_a_lie_of_three_metres_is_refuted_all_the_same(world):
    await world.policy(min_assurance=0)
    east, north, up = world.flight.truth
    world.flight.claimed = (east + 3_000, north, up)
    async with proofs(world) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "refuted"


async def test_a_board_that_no_tag_measures_ends_in_a_recorded_state(world):
    async with proofs(world, board=0x0BAD) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert result.verdict is None or result.verdict.outcome == "inconclusive"
    assert result.state in {"cancelled", "decided"}


async def test_the_drones_anchor_is_called_by_that_name(world, monkeypatch):
    monkeypatch.setattr("wonderland_uav_agent.radio.tag.READY_GRACE_S", 0.1)
    for board, name in ((BOARD, "drone's anchor"), (None, "drone's tag")):
        radio = TagRadio(world.directory / "tty-none", ("127.0.0.1", 9), world.clock, board=board)
        async with radio:
            with pytest.raises(NodeError, match=name):
                await radio.open_session(None, lambda _: None)
