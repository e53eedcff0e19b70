"""A pilot on a real link, with a fake autopilot that flies; what proves is handed in."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
from dataclasses import astuple, replace
from types import SimpleNamespace

import pytest
from kit.agents import commissioning
from kit.fake_autopilot import OverUdp
from kit.flying_autopilot import ARDUPILOT, PX4, FlyingAutopilot

from wonderland.clock import SteadyClock
from wonderland.proofs.frame import to_local
from wonderland_edge_agent.geodesy import frame_at
from wonderland_uav_agent.flight import FlightSettings, Gate, Pilot
from wonderland_uav_agent.flight.approach import Phase
from wonderland_uav_agent.flight.arming import PERMIT
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.session.events import OwnRange

FRAME = frame_at(604_518_000, 222_666_000, 30_000)
LONG_S = 30.0


async def until(condition, what):
    async with asyncio.timeout(LONG_S):
        while not condition():
            await asyncio.sleep(0.01)
    assert condition(), what


class Proofs:
    """Begins what it is asked to; a test says how each ends."""

    def __init__(self):
        self.begun = []
        self.ends = []

    def begin(self, pad_id, action, ended):
        self.begun.append((pad_id, action))
        self.ends.append(ended)
        return ""


@contextlib.asynccontextmanager
async def flying(drone, settings=None):
    clock, proofs = SteadyClock(), Proofs()
    pilot = Pilot(settings or FlightSettings(gate_m=6.0), clock=clock)
    pilot.gatekeeper.know([Gate("pad-1", FRAME)])
    pilot.prove_with(proofs.begin)
    link = MavlinkPosition(UdpAddress("127.0.0.1", 0), clock)
    pilot.board(link)
    async with link, OverUdp(drone, link.address) as wire:
        await until(lambda: pilot.vehicle(clock()) is not None, "mode, place and state are known")
        yield SimpleNamespace(pilot=pilot, proofs=proofs, clock=clock, wire=wire, keeper=pilot.gatekeeper)


def permission(action="land"):
    return SimpleNamespace(action=action, pad_id="pad-1", session_id="s")


@pytest.mark.parametrize("stack", [ARDUPILOT, PX4])
async def test_from_a_landing_that_is_held_to_one_that_a_verdict_permits(stack):
    drone = FlyingAutopilot(frame=FRAME, stack=stack, lost=2)
    async with flying(drone) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "held above the pad, a proof begins")
        assert here.proofs.begun == [("pad-1", "land")]
        assert drone.mode == "guided"
        assert 4_000 < drone.place[2] < 8_500
        assert abs(drone.place[0]) < 2_500
        await asyncio.sleep(0.5)
        assert 21 not in drone.commands, "nothing lands it before the verdict"
        assert await here.pilot.act(permission()) == "done"
        assert (drone.on_ground, drone.mode) == (True, "land")
        assert drone.commands == [192, 21]
        here.proofs.ends[0]("")
        assert here.keeper.phase is Phase.WATCHING


async def test_a_proof_that_refuses_leaves_it_above_the_pad(caplog):
    drone = FlyingAutopilot(frame=FRAME)
    async with flying(drone, FlightSettings(gate_m=6.0, attempts=1)) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "a proof begins")
        here.proofs.ends[0]("refuted: it is elsewhere")
        await until(lambda: here.keeper.phase is Phase.REFUSED, "refused")
        await asyncio.sleep(1.0)
        assert (drone.mode, drone.on_ground) == ("guided", False)
        assert "no permission to land at pad-1: refuted: it is elsewhere; holding" in caplog.text


async def test_the_pilot_takes_it_and_what_he_does_without_permission_is_said(caplog):
    drone = FlyingAutopilot(frame=FRAME)
    async with flying(drone) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "a proof begins")
        drone.mode = "land"
        await until(lambda: here.keeper.phase is Phase.OVERRIDDEN, "he insists")
        sent = len(drone.commands)
        assert (await here.pilot.act(permission())).startswith("overridden")
        await until(lambda: drone.on_ground and here.keeper.phase is Phase.WATCHING, "he lands")
        assert len(drone.commands) == sent
    (grave,) = [record for record in caplog.records if record.levelno == logging.ERROR]
    assert grave.getMessage().startswith("on the ground at pad-1 without a permission: the pilot")


@pytest.mark.parametrize("stack", [ARDUPILOT, PX4])
async def test_an_autopilot_that_goes_nowhere_stops_at_least(stack, caplog):
    """A fence, say, forbids the place above the pad."""
    drone = FlyingAutopilot(frame=FRAME, stack=stack, denies={192}, place=[6_000.0, 0.0, 40_000.0])
    async with flying(drone) as here:
        drone.mode = "land"
        await until(lambda: drone.mode == "guided", "stopped")
        assert drone.commands == [192, 176]
        assert not drone.on_ground
        assert here.keeper.phase is Phase.TO_GATE
    assert "the autopilot answers command 192 with denied" in caplog.text


async def test_one_that_denies_everything_is_asked_again():
    drone = FlyingAutopilot(frame=FRAME, denies={192, 176}, place=[6_000.0, 0.0, 60_000.0])
    async with flying(drone):
        drone.mode = "land"
        await until(lambda: drone.commands.count(192) == 2, "asked again")


async def test_a_permission_that_ends_on_the_way_down_brings_it_back_to_the_gate():
    drone = FlyingAutopilot(frame=FRAME, place=[0.0, 0.0, 60_000.0])
    async with flying(drone, FlightSettings(gate_m=60.0)) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "a proof begins")
        landing = asyncio.create_task(here.pilot.act(permission()))
        await until(lambda: drone.mode == "land", "it lands")
        landing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await landing
        await until(lambda: drone.mode == "guided", "held again")
        assert not drone.on_ground


@pytest.mark.parametrize("wrong_m", [(0.0, 0.0), (2.5, -2.0)])
async def test_a_gust_at_the_ground_makes_it_go_around_by_the_ranges(wrong_m, caplog):
    """`wrong_m` is what the receiver has it off, east and north."""
    drone, pad = FlyingAutopilot(frame=FRAME), replace(commissioning(10**7), frame=FRAME)

    def truth_m():
        return [mm / 1e3 - wrong for mm, wrong in zip(drone.place, (*wrong_m, 0.0), strict=True)]

    async def ranging(here):
        while True:
            for anchor in pad.anchors:
                place = (anchor.east_mm / 1e3, anchor.north_mm / 1e3, anchor.up_mm / 1e3)
                range_mm = round(1e3 * math.dist(truth_m(), place))
                here.pilot.on_range(pad, OwnRange(anchor.mac, here.clock(), range_mm))
            await asyncio.sleep(0.05)

    async with flying(drone, FlightSettings(gate_m=6.0)) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "held above the pad, a proof begins")
        ranges = asyncio.create_task(ranging(here))
        landing = asyncio.create_task(here.pilot.act(permission()))
        await until(lambda: drone.mode == "land" and drone.place[2] < 4_000, "it lands")
        async with asyncio.timeout(LONG_S):
            while drone.mode == "land":  # as ArduPilot does with a target aside: it hardly sinks, and the gust has time
                drone.place[:] = [min(drone.place[0] + 25.0, 20_000.0), drone.place[1], 2_000.0]
                await asyncio.sleep(0.025)
        assert not drone.on_ground
        east_mm, north_mm, _ = to_local(FRAME, *astuple(here.keeper._standing))
        wrong = math.dist((east_mm / 1e3, north_mm / 1e3), wrong_m)
        assert wrong < 1.5, "sent above the pad, whatever the receiver says"
        assert await landing == "done"
        ranges.cancel()
    assert "beside pad-1 by the ranges: going around (1 of 3)" in caplog.text


async def test_px4_asks_before_it_arms():
    drone = FlyingAutopilot(frame=FRAME, stack=PX4, armed=False, on_ground=True, place=[0.0, 0.0, 0.0], mode="loiter")
    async with flying(drone) as here:
        here.wire.transport.sendto(drone.asks_to_arm())
        await until(lambda: drone.arming_answers, "answered")
        assert drone.arming_answers == [(1, 0)], "not yet"
        assert here.proofs.begun == [("pad-1", "takeoff")]
        taking_off = asyncio.create_task(here.pilot.act(permission("takeoff")))
        await asyncio.sleep(0)
        here.wire.transport.sendto(drone.asks_to_arm())
        await until(lambda: len(drone.arming_answers) == 2, "answered")
        result, valid_s = drone.arming_answers[1]
        assert (result, 100 <= valid_s <= 120) == (0, True)
        drone.armed, drone.on_ground = True, False
        assert await taking_off == "done"
        here.wire.transport.sendto(drone.asks_to_arm())
        await until(lambda: len(drone.arming_answers) == 3, "answered")
        assert drone.arming_answers[2][0] == 1, "one take-off, not two"


@pytest.mark.parametrize(("elsewhere", "result"), [("refuse", 2), ("allow", 0)])
async def test_px4_far_from_any_pad_is_armed_as_its_settings_say(elsewhere, result):
    drone = FlyingAutopilot(
        frame=FRAME, stack=PX4, armed=False, on_ground=True, place=[90_000.0, 0.0, 0.0], mode="loiter"
    )
    async with flying(drone, FlightSettings(take_off_elsewhere=elsewhere)) as here:
        here.wire.transport.sendto(drone.asks_to_arm())
        await until(lambda: drone.arming_answers, "answered")
        assert drone.arming_answers[0][0] == result
        assert here.proofs.begun == []


async def test_ardupilots_script_is_told_and_told_again_when_it_is_over():
    drone = FlyingAutopilot(frame=FRAME, armed=False, on_ground=True, place=[0.0, 0.0, 0.0])
    async with flying(drone) as here:
        assert drone.parameters == {}
        taking_off = asyncio.create_task(here.pilot.act(permission("takeoff")))
        await until(lambda: PERMIT in drone.parameters, "permitted")
        assert 100 <= drone.parameters[PERMIT] <= 120
        drone.armed, drone.on_ground = True, False
        assert await taking_off == "done"
        await until(lambda: drone.parameters[PERMIT] == -1, "withdrawn")


async def test_an_agent_that_starts_again_takes_up_the_drone_that_it_held(tmp_path):
    settings = FlightSettings(gate_m=6.0, memory=tmp_path / "flight.json")
    drone = FlyingAutopilot(frame=FRAME)
    async with flying(drone, settings) as here:
        drone.mode = "land"
        await until(lambda: here.proofs.begun, "held, a proof begins")
    assert (drone.mode, drone.on_ground) == ("guided", False)
    async with flying(drone, settings) as here:
        await until(lambda: here.proofs.begun, "held on, a proof begins anew")
        assert await here.pilot.act(permission()) == "done"
        await until(lambda: not settings.memory.exists(), "landed: nothing to take up")
    drone.on_ground, drone.place, drone.mode = False, [0.0, 0.0, 6_000.0], "guided"
    drone.goes = None
    async with flying(drone, settings) as here:
        await asyncio.sleep(1.0)
        assert here.proofs.begun == [], "who hovers there of his own will is left alone"


async def test_a_memory_that_does_not_hold_any_more_is_gone_with_the_first_look(tmp_path):
    settings = FlightSettings(memory=tmp_path / "flight.json")
    settings.memory.write_text(json.dumps({"pad_id": "pad-1", "t_ms": SteadyClock()() - 1_000}))
    async with flying(FlyingAutopilot(frame=FRAME, on_ground=True, place=[0.0, 0.0, 0.0]), settings):
        await until(lambda: not settings.memory.exists(), "it stands: nothing to take up, now or later")


@pytest.mark.parametrize("text", ["{", "[]", '{"pad_id": 1, "t_ms": 2}', '{"pad_id": "pad-1", "t_ms": 5}'])
async def test_a_memory_that_is_damaged_or_old_takes_up_nothing(tmp_path, text):
    path = tmp_path / "flight.json"
    path.write_text(text)
    pilot = Pilot(FlightSettings(memory=path), clock=SteadyClock())
    assert pilot.gatekeeper.held_at is None
