"""Whole proofs with the paper's board: a DWM1001 tag on the drone, its ranges reported, assurance 0."""

from __future__ import annotations

import asyncio
import contextlib
import random

import pytest
from click.testing import CliRunner
from kit.agents import FAST_PAD
from msgspec import structs

from wonderland.toml_settings import Address, SettingsError
from wonderland_edge_agent.assembly import open_pad
from wonderland_edge_agent.ports import AgentError
from wonderland_edge_agent.radios.reported import ReportedRadios
from wonderland_edge_agent.settings import UwbSettings, parse
from wonderland_fira_uci.dwm1001 import BoardPosition, Generation, Mode, Timings
from wonderland_simulator.dwm1001_node import Quirks, VirtualAnchor, VirtualDwm1001
from wonderland_simulator.uci_node import PtyPort
from wonderland_uav_agent.commands import uav as uav_command
from wonderland_uav_agent.radio.tag import TagRadio

ANCHOR_NAMES = ("A1", "A2", "A3", "A4")
QUICK = Timings(poll_ms=25, listen_ms=50, prompt_ms=300)


@contextlib.asynccontextmanager
async def proofs(world, *, generation=Generation.PANS_R2, mode=Mode.TLV, quirks=None):
    """A pad of DWM1001 anchors, a drone with a tag; both agents at work."""
    anchors = [VirtualAnchor(0xA000 + index, name, BoardPosition(0, 0, 0)) for index, name in enumerate(ANCHOR_NAMES)]
    tag = VirtualDwm1001(
        "uav",
        anchors,
        world.measure,
        rng=random.Random(1),
        generation=generation,
        quirks=quirks or Quirks(update_ms=50),
    )
    port = PtyPort(tag, world.directory / "tty-tag")
    port.plug()
    world.ports["tag"] = port
    try:
        async with world.pad(anchors=[], uwb={"kind": "dwm1001", "listen": "127.0.0.1:0"}) as pad:
            radios = pad._radios
            assert isinstance(radios, ReportedRadios)
            async with (
                TagRadio(port.path, radios.address, world.clock, mode=mode, timings=QUICK) as radio,
                world.uav(radio=radio) as uav,
            ):
                yield pad, uav
    finally:
        port.close()


@pytest.mark.parametrize(
    ("generation", "mode"),
    [(Generation.PANS_R2, Mode.TLV), (Generation.LEAPS, Mode.TLV), (Generation.PANS_R2, Mode.LEC)],
)
async def test_where_the_policy_takes_the_drones_word_it_is_verified_at_assurance_0(world, generation, mode):
    await world.policy(min_assurance=0)
    async with proofs(world, generation=generation, mode=mode) as (pad, uav):
        result = await uav.prove("pad-1", "land")
        anchors = {anchor["anchor_id"] for anchor in pad.status()["anchors"]}
    assert (result.verdict.outcome, result.verdict.assurance) == ("verified", 0)
    assert (result.state, result.end) == ("completed", "done")
    assert anchors == set(ANCHOR_NAMES)
    assert world.acted


async def test_the_default_policy_never_verifies_what_a_drone_says_of_itself(world):
    async with proofs(world) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("cancelled", "assurance_out_of_reach")
    assert not world.acted


async def test_a_spoofed_position_is_found_out_though_the_drone_reports_itself(world):
    """What level 0 is good for: an honest drone whose GNSS is dragged away."""
    await world.policy(min_assurance=0)
    world.flight.truth = (16_000.0, 3_000.0, 6_000.0)
    async with proofs(world) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "refuted"
    assert not world.acted


async def test_spliced_lines_and_noise_cost_rounds_and_nothing_else(world):
    await world.policy(min_assurance=0)
    quirks = Quirks(update_ms=25, splice=0.3, garbage=0.2, nan=0.2)
    async with proofs(world, mode=Mode.LEC, quirks=quirks) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


async def test_distances_that_the_board_itself_rates_low_are_left_out(world):
    await world.policy(min_assurance=0)
    async with proofs(world, quirks=Quirks(update_ms=25, poor=0.6)) as (_, uav):
        result = await uav.prove("pad-1", "land")
    assert result.verdict.outcome == "verified"


async def test_a_tag_that_is_away_ends_in_a_recorded_state(world, monkeypatch):
    monkeypatch.setattr("wonderland_uav_agent.radio.tag.READY_GRACE_S", 0.2)
    async with proofs(world) as (_, uav):
        world.ports["tag"].unplug()
        await asyncio.sleep(0.05)
        result = await uav.prove("pad-1", "land")
        session = await world.contract("mirror").read_session(result.session_id)
    assert result.verdict is None
    assert session.state == "cancelled"
    assert not world.acted


async def test_a_tag_pulled_while_ranging_is_judged_by_what_there_is(world):
    await world.policy(min_assurance=0)
    async with proofs(world, quirks=Quirks(update_ms=100)) as (pad, uav):
        proving = asyncio.create_task(uav.prove("pad-1", "land"))
        async with asyncio.timeout(10):
            while "up" not in {anchor["state"] for anchor in pad.status()["anchors"]}:
                await asyncio.sleep(0.01)
        world.ports["tag"].unplug()
        result = await proving
    assert result.state == "decided"
    assert result.verdict.outcome == "inconclusive"
    assert not world.acted


async def test_a_pad_that_does_not_listen_there_leaves_a_recorded_end(world, unused_udp_port):
    async with proofs(world) as (_, uav):
        uav._radio._pad = ("127.0.0.1", unused_udp_port)
        result = await uav.prove("pad-1", "land")
        session = await world.contract("mirror").read_session(result.session_id)
    assert session.state in {"decided", "cancelled"}
    assert not world.acted


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("--node", "dwm1001"), "go together"),
        (("--report-to", "pad:5481"), "go together"),
        (("--node", "dwm1001", "--report-to", "pad"), "give HOST:PORT"),
        (("--node", "dwm1001", "--report-to", "pad:0"), "give HOST:PORT"),
    ],
)
def test_a_drones_mistakes_are_named(prepared_ledger, arguments, why):
    common = ["--connection", str(prepared_ledger / "connection.json"), "--port", "x", "--position", "udp:127.0.0.1:0"]
    done = CliRunner().invoke(uav_command, ["prove", *common, "--pad", "pad-1", *arguments])
    assert done.exit_code == 2, done.output
    assert why in done.output


async def test_a_port_in_use_is_said(world):
    settings = world.settings(anchors=[], uwb={"kind": "dwm1001", "listen": "127.0.0.1:0"})
    async with ReportedRadios(("127.0.0.1", 0), world.clock) as other:
        with pytest.raises(AgentError, match=r"uwb\.listen: 127\.0\.0\.1:\d+ cannot be bound"):
            async with open_pad(
                structs.replace(settings, uwb=UwbSettings(kind="dwm1001", listen=Address(other.address))),
                timing=FAST_PAD,
            ):
                pytest.fail("it opened")


BASE = {"pad_id": "pad-1", "connection": "c.json", "spool": "s"}
UCI_ANCHORS = [{"anchor_id": name, "port": f"/dev/{name}"} for name in ANCHOR_NAMES]


def test_settings_of_a_pad_of_dwm1001(tmp_path):
    settings = parse(BASE | {"uwb": {"kind": "dwm1001", "listen": "127.0.0.1:5481"}}, tmp_path / "pad.toml")
    assert (settings.anchors, settings.uwb.listen) == ((), ("127.0.0.1", 5481))
    assert parse(BASE | {"anchors": UCI_ANCHORS, "uwb": {"kind": "uci"}}, tmp_path / "p").uwb.listen is None


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"uwb": {"kind": "dwm1001"}}, r"uwb\.listen is missing"),
        ({"uwb": {"kind": "dwm1001", "listen": "x"}}, r"uwb\.listen is not host:port"),
        ({"uwb": {"kind": "zigbee"}}, r"uwb\.kind is 'zigbee'"),
        ({"uwb": {"kind": "dwm1001", "listen": "a:1", "lisen": 1}}, r"uwb\.lisen is unknown"),
        ({"uwb": {"kind": "dwm1001", "listen": "a:1"}, "anchors": UCI_ANCHORS}, "anchors has no place"),
        ({"uwb": {"listen": "a:1"}, "anchors": UCI_ANCHORS}, r"uwb\.listen is for kind"),
        ({}, "anchors has 0 entries"),
    ],
)
def test_settings_that_make_no_sense_name_the_field(tmp_path, more, why):
    with pytest.raises(SettingsError, match=why):
        parse(BASE | more, tmp_path / "pad.toml")
