"""A real ArduPilot lands by the ranges: its GPS is led away *after* the verdict, and it comes down on the pad."""

from __future__ import annotations

import asyncio

import pytest
from kit.above_a_pad import above_a_pad
from kit.ground_station import dialect

from wonderland_uav_agent.flight.approach import Phase

pytestmark = pytest.mark.timeout(420)

TOUCH_DOWN_M = 0.3
"""One that slides along by its GPS is not on the ground for an autopilot, for long."""
PRECISION = {"PLND_ENABLED": 1, "PLND_TYPE": 1}


def height_m(scene):
    return scene.world.flight.truth[2] / 1e3


async def landed(scene, *, drag):
    """Metres from the pad's middle, as the simulation has it, and how far the receiver is off by then."""
    scene.mark("land")
    await scene.station.done(dialect.MAV_CMD_NAV_LAND)
    await scene.until(lambda: scene.pilot.gatekeeper.phase is Phase.LANDING, "the verdict permits it")
    scene.mark("verdict")
    dragging = asyncio.create_task(scene.drag()) if drag else None
    await scene.until(lambda: scene.seen.on_ground or height_m(scene) < TOUCH_DOWN_M, "it lands")
    scene.mark("down")
    if dragging is not None:
        dragging.cancel()
    print(f"{scene.aside_m():.2f} m from the middle, the filter {scene.off_m():.1f} m off")
    return scene.aside_m(), scene.off_m()


@pytest.mark.parametrize("drag", [False, True])
async def test_it_lands_in_the_middle_whatever_its_gps_says_after_the_verdict(tmp_path, geoid, drag):
    async with above_a_pad(tmp_path, geoid, parameters=PRECISION) as scene:
        aside, off = await landed(scene, drag=drag)
        scene.keep(f"precision-{'dragged' if drag else 'honest'}")
    assert aside < 0.5
    assert not drag or off > 5, "the filter went along"


async def test_without_the_ranges_it_is_led_away(tmp_path, geoid):
    async with above_a_pad(tmp_path, geoid, precision=False) as scene:
        aside, off = await landed(scene, drag=True)
        scene.keep("precision-none")
    assert aside > 5
    assert off > 5
