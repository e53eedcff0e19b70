"""Whole sessions, one after the other: ledger, backend and pad are processes, the air and the drone's agent are here."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import time
from dataclasses import replace

from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs.records.sessions import TICKS_PER_SECOND
from wonderland.uwb.agreed import ability_of
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_simulator.channel import Channel
from wonderland_simulator.pads_air import LIGHT_M_S
from wonderland_simulator.playback import Playback
from wonderland_simulator.recording import RecordedRound, Recording
from wonderland_simulator.scenario import PADS, STAMP_SIGMA_M, Behaviour, DroneSpec
from wonderland_simulator.stage import Stage, StageSettings
from wonderland_simulator.world import drone_path
from wonderland_uav_agent.agent import UavAgent
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.position.autopilot import AutopilotPosition
from wonderland_uav_agent.radio import UavRadio

UAV_ID = "BENCH"
HOVER_M = (5.0, -6.0, 6.0)


def hovering(pad, rounds, seed=1):
    """A recording of a drone that hovers, drawn from the demo's radio channel, nothing lost."""
    channel = Channel(random.Random(seed), anchor_bias_m={site.mac: site.bias_m for site in pad.anchors}, loss=0.0)
    sites = {site.anchor_id: (site.east_m, site.north_m, site.up_m) for site in pad.anchors}

    def ranged():
        return {
            site.anchor_id: channel.measure(math.dist(sites[site.anchor_id], HOVER_M), site.mac).range_m
            for site in pad.anchors
        }

    return Recording(tuple(RecordedRound(0.05 * number, ranged(), HOVER_M) for number in range(rounds)), sites)


def commissioned(pad, board):
    """The pad's record, its nodes being of that kind."""
    return replace(pad.commissioning(time.time_ns() // 1_000_000), nodes=ability_of(board.said()))


def stamping(pad, seed=1):
    """What the pad's common clock shows when an anchor hears the hovering drone."""
    rng = random.Random(seed)
    sites = {f"{pad.pad_id}/{site.anchor_id}": site for site in pad.anchors}

    def stamp(anchor, _tag, t_s):
        site = sites[anchor]
        away_m = math.dist((site.east_m, site.north_m, site.up_m), HOVER_M)
        away_m += site.clock_error_m + rng.gauss(0.0, STAMP_SIGMA_M)
        return round(t_s * TICKS_PER_SECOND) + round(away_m / LIGHT_M_S * TICKS_PER_SECOND)

    return stamp


class Sessions:
    """Proves on demand at one pad."""

    def __init__(self, stage, agent, identity):
        self.stage = stage
        self.agent = agent
        self.identity = identity
        self.pad_id = stage.settings.pads[0].pad_id

    async def attempt(self):
        """One proof, however it ends."""
        return await self.agent.prove(self.pad_id, "land")

    async def prove(self):
        """One proof; asserts that it was verified."""
        result = await self.attempt()
        assert result.verdict is not None, (result.end, result.detail)
        assert result.verdict.outcome == "verified", result.verdict.reasons
        return result

    def pid(self, name):
        """Process id of one of the stage's children."""
        return next(child.handle.pid for child in self.stage.processes._children if child.name == name)


@contextlib.asynccontextmanager
async def played(
    directory, *, policy, rounds=10_000, ledger="embedded", pad=PADS[0], board=None, starting=contextlib.nullcontext
):
    """A stage with one pad at work and the nodes and position of one drone, whose agent is the caller's.

    ``policy``: of the pad; ``rounds``: of the recording; ``board``: of all nodes, the pad's own unless given;
    ``starting``: entered while the pad's agent is started.
    """
    board = board or pad.board
    drone = DroneSpec(UAV_ID, "Bench", pad.pad_id, "land", Behaviour.HONEST, HOVER_M, HOVER_M, 0.0)
    settings = StageSettings(
        (pad,), (drone,), policy=lambda _: policy, ledger=ledger, commissioning=lambda _: commissioned(pad, board)
    )
    async with Stage(directory, settings) as stage:
        port = stage.ports.position[UAV_ID]
        playback = Playback(hovering(pad, rounds), pad, UAV_ID, directory, port, lambda truth: truth, board=board)
        if pad.clock_sigma_mm is not None:
            playback._air.stamp = stamping(pad)  # recordings have none
        air = asyncio.ensure_future(playback.run())
        try:
            await asyncio.sleep(0)
            with starting():
                await stage.start_pads()
            yield stage
        finally:
            air.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await air


@contextlib.asynccontextmanager
async def sessions(directory, **of_the_stage):
    """As `played`, and the drone's agent in this process, ready to prove."""
    async with contextlib.AsyncExitStack() as stack:
        stage = await stack.enter_async_context(played(directory, **of_the_stage))
        connection, clock = stage.connection, SteadyClock()
        identity, signer = connection.identity(UAV_ID), connection.signer(UAV_ID)
        channel = await stack.enter_async_context(connection.open_channel())
        network = Gateway(channel, identity, signer).network(connection.channel)
        contract = ProofContract(network, connection.chaincode)
        radio = await stack.enter_async_context(UavRadio(drone_path(directory, UAV_ID), clock))
        port = ("127.0.0.1", stage.ports.position[UAV_ID])
        position = await stack.enter_async_context(AutopilotPosition(port, clock))
        events = await stack.enter_async_context(LedgerEvents(contract))

        async def land(_verdict):
            return "done"

        agent = UavAgent(
            uav_id=UAV_ID,
            ledger=contract,
            events=events,
            identity=identity,
            signer=signer,
            radio=radio,
            position=position,
            act=land,
            clock=clock,
        )
        await position.wait(10)
        yield Sessions(stage, agent, identity)
