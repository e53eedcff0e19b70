"""A real ArduPilot whose GPS is dragged away, above a real pad and ledger: the proof refuses it, and it stays up."""

from __future__ import annotations

import asyncio

import pytest
from kit.above_a_pad import LONG_S, above_a_pad
from kit.ground_station import dialect

from wonderland_uav_agent.flight.approach import Phase
from wonderland_uav_agent.flight.vehicle import Mode

pytestmark = pytest.mark.timeout(420)


@pytest.fixture
async def scene(tmp_path, geoid):
    async with above_a_pad(tmp_path, geoid) as made:
        yield made


async def test_an_honest_one_proves_itself_and_lands(scene):
    scene.mark("land")
    await scene.station.done(dialect.MAV_CMD_NAV_LAND)
    await scene.until(lambda: scene.pilot.gatekeeper.phase is Phase.LANDING, "the verdict permits it")
    scene.mark("verdict")
    await scene.until(lambda: scene.seen.on_ground, "it lands")
    scene.keep("honest")
    events = scene.world.contract("mirror").events(start_block=0, names=frozenset({"InteractionCompleted"}))
    async with asyncio.timeout(LONG_S):
        assert (await anext(events)).record["end"] == "done"


async def test_a_gps_that_is_dragged_away_is_seen_by_the_proof_alone(scene):
    calm = dict(scene.samples[-1])
    dragging = asyncio.create_task(scene.drag())
    scene.mark("land")
    await scene.station.done(dialect.MAV_CMD_NAV_LAND)
    await scene.until(lambda: scene.pilot.gatekeeper.phase in {Phase.REFUSED, Phase.LANDING}, "a verdict")
    scene.mark("verdict")
    refused_off_m = scene.off_m()
    assert scene.pilot.gatekeeper.phase is Phase.REFUSED
    assert scene.pilot.gatekeeper.why.startswith("refuted")
    await asyncio.sleep(15)
    dragging.cancel()
    scene.keep("dragged")
    last = scene.samples[-1]
    print(f"refused {refused_off_m:.1f} m off, {scene.marks['verdict'] - scene.marks['drag']} ms after the drag began")
    assert last["off_m"] > 10, "the filter went along"
    for name in ("ekf_flags", "fix_type", "h_acc_mm"):
        assert {sample[name] for sample in scene.samples if sample["t_ms"] > scene.marks["drag"]} == {calm[name]}, name
    assert (scene.seen.mode, scene.seen.on_ground) == (Mode.HELD, False)


async def test_a_drag_that_begins_with_the_proof_is_refused_or_still_within_the_buffer(scene):
    """At 1 m/s a proof of two seconds cannot see more; what comes after the verdict it does not speak of."""
    await scene.station.done(dialect.MAV_CMD_NAV_LAND)
    await scene.until(lambda: scene.pilot.gatekeeper.phase is Phase.PROVING, "a proof")
    dragging = asyncio.create_task(scene.drag())
    await scene.until(lambda: scene.pilot.gatekeeper.phase in {Phase.REFUSED, Phase.LANDING}, "a verdict")
    off_m, phase = scene.off_m(), scene.pilot.gatekeeper.phase
    dragging.cancel()
    print(f"{phase.value} {off_m:.2f} m off: {scene.pilot.gatekeeper.why}")
    assert off_m < 2.0, "two buffers"
    assert phase is Phase.REFUSED or off_m <= 1.0
