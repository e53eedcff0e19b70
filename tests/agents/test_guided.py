"""While a permitted drone comes down, its node ranges on: the way down is found by the ranges, and nothing else is."""

from __future__ import annotations

import asyncio

import pytest

pytestmark = pytest.mark.timeout(90)


async def until(condition, limit_s=10.0):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.01)


class Ranges:
    """What the drone's node measures, beside the survey that it belongs to."""

    def __init__(self):
        self.heard = []

    def __call__(self, commissioning, event):
        self.heard.append((commissioning, event))


async def test_ranges_come_until_the_drone_is_down_and_the_next_proof_begins_as_ever(world):
    ranges, during = Ranges(), []

    async def act(verdict):
        before = len(ranges.heard)
        await until(lambda: len(ranges.heard) >= before + 60)
        during.append(ranges.heard[before:])
        return "done"

    async with world.pad(), world.uav(act=act, on_range=ranges) as uav:
        result = await uav.prove("pad-1", "land")
        assert (result.verdict.outcome, result.end) == ("verified", "done")
        again = await uav.prove("pad-1", "land")
    assert (again.verdict.outcome, again.end) == ("verified", "done")
    for heard in during:
        assert {event.mac for _, event in heard} == {anchor.mac for anchor in heard[0][0].anchors}


async def test_a_drone_that_is_led_by_its_own_position_lets_the_nodes_rest(world):
    """It closes its side; the pad's nodes close theirs when no range has come for a while, before the drone is down."""
    async with world.pad() as pad:
        radios = pad._radios

        async def act(verdict):
            await until(lambda: not radios._sessions)
            assert {each["state"] for each in pad.status()["anchors"]} == {"up"}
            assert pad.status()["accepts_sessions"]
            return "done"

        async with world.uav(act=act) as uav:
            result = await uav.prove("pad-1", "land")
    assert (result.verdict.outcome, result.end) == ("verified", "done")


async def test_a_take_off_is_not_guided(world):
    ranges, counted = Ranges(), []

    async with world.pad() as pad:
        radios = pad._radios

        async def act(verdict):
            await until(lambda: not radios._sessions)
            counted.append(len(ranges.heard))
            return "done"

        async with world.uav(act=act, on_range=ranges) as uav:
            result = await uav.prove("pad-1", "takeoff")
    assert result.verdict.outcome == "verified"
    assert counted == [len(ranges.heard)]


async def test_anchors_that_die_on_the_way_down_end_nothing(world):
    """The permission stands: it was granted for what was proved. The guidance ends, and the autopilot goes on alone."""
    ranges = Ranges()

    async def act(verdict):
        before = len(ranges.heard)
        await until(lambda: len(ranges.heard) > before + 20)
        for name in ("A1", "A2", "A3", "A4"):
            world.ports[name].unplug()
        silent = len(ranges.heard)
        await asyncio.sleep(1)
        assert len(ranges.heard) < silent + 8
        return "done"

    async with world.pad(), world.uav(act=act, on_range=ranges) as uav:
        result = await uav.prove("pad-1", "land")
    assert (result.verdict.outcome, result.state, result.end) == ("verified", "completed", "done")
