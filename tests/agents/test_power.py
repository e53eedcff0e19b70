"""A node that hangs is given its power anew by the operator's command, and comes back by itself."""

from __future__ import annotations

import asyncio
import functools
import sys

from kit.agents import cured, hang

from wonderland_edge_agent.radios import AnchorState
from wonderland_edge_agent.radios.power import PowerCycles


async def until(condition, limit_s=10):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.05)


def anchors(**conditions):
    return [AnchorState(name, condition, "", None) for name, condition in conditions.items()]


def test_only_what_has_hung_for_long_is_due_and_not_again_at_once():
    cycles = PowerCycles(hangs_ms=20_000, again_ms=120_000)
    assert cycles.due(anchors(A1="down", A2="up"), 0) == []
    assert cycles.due(anchors(A1="down", A2="up"), 19_999) == []
    assert cycles.due(anchors(A1="down", A2="down"), 20_000) == ["A1"]
    assert cycles.due(anchors(A1="down", A2="up"), 60_000) == []
    assert cycles.due(anchors(A1="down", A2="down"), 140_000) == ["A1"]
    assert cycles.due(anchors(A1="up", A2="down"), 160_000) == ["A2"]


def test_one_that_came_back_starts_anew():
    cycles = PowerCycles(hangs_ms=20_000, again_ms=120_000)
    cycles.due(anchors(A1="down"), 0)
    cycles.due(anchors(A1="up"), 19_000)
    assert cycles.due(anchors(A1="down"), 21_000) == []


async def test_a_hung_node_is_back_after_its_power_was_cycled(world, monkeypatch, tmp_path):
    monkeypatch.setattr("wonderland_edge_agent.radios.power.PowerCycles", functools.partial(PowerCycles, 1_000))
    switched = tmp_path / "switched"
    command = [sys.executable, "-c", f"open({str(switched)!r}, 'a').write('x')"]
    names = list(world.own)
    nodes = [{"anchor_id": name, "port": str(world.directory / f"tty-{name}")} for name in names]
    nodes[0]["power_cycle"] = command
    port = world.ports[names[0]]
    async with world.pad(anchors=nodes) as pad:
        await until(lambda: all(each["state"] == "up" for each in pad.status()["anchors"]))
        hang(port)
        await until(switched.exists, 15)
        port.unplug()
        cured(port)
        port.plug()
        await until(lambda: all(each["state"] == "up" for each in pad.status()["anchors"]), 15)
        await asyncio.sleep(0.5)
    assert switched.read_text() == "x"


async def test_a_command_that_is_not_there_is_said(world, monkeypatch, caplog):
    monkeypatch.setattr("wonderland_edge_agent.radios.power.PowerCycles", functools.partial(PowerCycles, 200))
    names = list(world.own)
    nodes = [{"anchor_id": name, "port": str(world.directory / f"tty-{name}")} for name in names]
    nodes[1]["power_cycle"] = ["/nowhere/hub"]
    world.ports[names[1]].unplug()
    async with world.pad(anchors=nodes, ready=False):
        await until(lambda: "its power was not cycled: /nowhere/hub cannot be run" in caplog.text, 10)
