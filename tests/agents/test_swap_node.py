"""A broken node is replaced in minutes: by its neighbours' ranges and a signed record; never where more has changed."""

from __future__ import annotations

import asyncio
import json
import time

import pytest
from click.testing import CliRunner

from wonderland.cli import main
from wonderland_edge_agent.drift.baseline import Baseline, summary
from wonderland_edge_agent.radios import AnchorPort, PadRadios

DELAY_MM = 240.0
"""As units of one chip differ whose antenna delay nobody has set."""


async def pad_file(world):
    path = world.directory / "pad.toml"
    anchors = "".join(f'[[anchors]]\nanchor_id = "{name}"\nport = "{world.ports[name].path}"\n' for name in world.own)
    path.write_text(f'pad_id = "pad-1"\nconnection = "ledger/connection.json"\nspool = "spool"\n{anchors}')
    return path


async def keep_baseline(world):
    """What the anchors measured when the pad was commissioned."""
    pad = await world.contract("mirror").read_pad("pad-1")
    ports = [AnchorPort(name, world.ports[name].path) for name in world.own]
    async with PadRadios(ports, world.clock) as radios:
        await asyncio.sleep(0.5)
        ranges = await radios.measure_between({a.anchor_id: a.mac for a in pad.commissioning.anchors}, 20, 9)
    baseline = Baseline(summary(ranges), world.clock(), "commissioning")
    baseline.save(world.directory / "spool" / "anchors.json", pad.commissioning_sha256)


async def swap(path, *more):
    """The command's exit code and what it says."""
    arguments = ["pad", "swap-node", "--config", str(path), "--anchor", "A3", "--json", *more]
    result = await asyncio.to_thread(CliRunner().invoke, main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def replaced(world):
    """Another node in the mount of A3, with an antenna delay of its own."""
    world.ports["A3"].unplug()
    world.delay_mm["A3"] = DELAY_MM
    world.ports["A3"].plug()


async def outcome(world):
    async with world.pad(), world.uav() as uav:
        return (await uav.prove("pad-1", "land")).verdict.outcome


@pytest.mark.parametrize("kept", [True, False])
async def test_a_new_node_is_taken_in_and_drones_are_verified_again(world, kept):
    if kept:
        await keep_baseline(world)
    path = await pad_file(world)
    replaced(world)
    assert await outcome(world) != "verified"  # with the old record it is wrong by its delay
    began = time.monotonic()
    code, said = await swap(path, "--yes")
    assert code == 0, said
    assert time.monotonic() - began < 60
    found = json.loads(said)
    assert found["published"]
    assert abs(found["delay_mm"] - DELAY_MM) < (20 if kept else 60)
    pad = await world.contract("mirror").read_pad("pad-1")
    assert pad.commissioning_sha256 == found["commissioning_sha256"]
    assert "node of A3 replaced" in pad.commissioning.method
    fresh, other = (next(a for a in pad.commissioning.anchors if a.anchor_id == name) for name in ("A3", "A1"))
    assert abs(fresh.bias[0].bias_mm - DELAY_MM) < (20 if kept else 60)
    assert fresh.bias[0].sigma_mm > 30 > other.bias[0].sigma_mm  # it is known less well, and the record says so
    assert Baseline.load(world.directory / "spool" / "anchors.json", pad.commissioning_sha256)
    assert await outcome(world) == "verified"


async def test_a_dry_run_and_a_stranger_change_nothing(world):
    path = await pad_file(world)
    replaced(world)
    before = (await world.contract("mirror").read_pad("pad-1")).commissioning_sha256
    code, said = await swap(path, "--dry-run")
    assert (code, json.loads(said)["published"]) == (0, False)
    code, said = await swap(path, "--yes", "--identity", "fleet_operator")
    assert code == 1
    assert "the ledger refuses" in said
    assert (await world.contract("mirror").read_pad("pad-1")).commissioning_sha256 == before


async def test_nothing_is_sent_where_more_has_changed_than_the_node(world):
    await keep_baseline(world)
    path = await pad_file(world)
    replaced(world)
    east, north, up = world.stand["A1"]
    world.stand["A1"] = (east + 90, north, up)
    code, said = await swap(path, "--yes")
    assert code == 1
    assert "A1" in said
    assert "commission the pad again" in said


async def test_nothing_is_sent_where_the_new_node_stands_elsewhere(world):
    await keep_baseline(world)
    path = await pad_file(world)
    replaced(world)
    east, north, up = world.stand["A3"]
    world.stand["A3"] = (east + 200, north - 200, up)
    code, said = await swap(path, "--yes")
    assert code == 1
    assert "does not stand where its predecessor did" in said


async def test_what_keeps_it_from_being_measured_is_said(world):
    path = await pad_file(world)
    world.mute = {"A3"}
    code, said = await swap(path, "--yes")
    assert code == 1
    assert "ranges nobody; 3 neighbours are needed" in said
    world.ports["A3"].unplug()
    code, said = await swap(path, "--yes")
    assert code == 1
    assert "the new node does not answer" in said
    async with world.pad():
        code, said = await swap(path, "--yes")
    assert code == 1
    assert "stop it while commissioning" in said
