"""The drones' companion computers: one agent for each, in one process, doing what fleet operators' drones do.

When the autopilot holds before a pad, the agent proves; with a permission the drone lands, without one it leaves.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

from wonderland.clock import Clock, SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland.proofs.records.verdicts import Verdict
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway
from wonderland_simulator.mission import Mode
from wonderland_simulator.scenario import DroneSpec
from wonderland_simulator.world import Ports, drone_path
from wonderland_uav_agent.agent import ProofResult, UavAgent, UavAgentError
from wonderland_uav_agent.ledger_events import LedgerEvents
from wonderland_uav_agent.position import PositionSource
from wonderland_uav_agent.radio import UavRadio

_log = logging.getLogger(__name__)
RETRY_S: Final = 2.0
ATTEMPTS: Final = 3
ACT_LIMIT_S: Final = 60.0
OpenPosition = Callable[[int, Clock], Any]
"""Port and clock → an asynchronous context whose value is a PositionSource."""


class Modes(asyncio.DatagramProtocol):
    """How each mission stands, as the autopilots report."""

    def __init__(self) -> None:
        self._now: dict[str, tuple[str, int]] = {}
        self._changed = asyncio.Condition()
        self._tasks: set[asyncio.Task[None]] = set()

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Note the mode that a drone's agent reports."""
        del addr
        with contextlib.suppress(ValueError, KeyError, TypeError):
            value = json.loads(data[:1024])
            uav_id, now = str(value["uav_id"]), (str(value["mode"]), int(value["proofs"]))
            if self._now.get(uav_id) != now:
                self._now[uav_id] = now
                task = asyncio.ensure_future(self._notify())
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)

    async def _notify(self) -> None:
        async with self._changed:
            self._changed.notify_all()

    async def until(self, uav_id: str, *modes: Mode, after: int = 0) -> tuple[str, int]:
        """Waits until the drone's mission is in one of the modes, with more proofs asked for than ``after``."""

        def reached() -> bool:
            mode, proofs = self._now.get(uav_id, ("", 0))
            return mode in modes and proofs > after

        async with self._changed:
            await self._changed.wait_for(reached)
            return self._now[uav_id]


class Fleet:
    """All drones' agents; ``run`` until cancelled. ``on_result`` hears how each proof ended."""

    def __init__(
        self,
        connection: Connection,
        drones: Sequence[DroneSpec],
        directory: Path,
        ports: Ports,
        *,
        open_position: OpenPosition,
        on_result: Callable[[ProofResult], None] = lambda _: None,
    ) -> None:
        self._connection = connection
        self._drones = drones
        self._directory = directory
        self._ports = ports
        self._open_position = open_position
        self._on_result = on_result
        self._modes = Modes()
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    async def run(self, ready: Callable[[], None]) -> None:
        """Until cancelled; calls ``ready`` once the autopilots are heard."""
        self._out.setblocking(False)
        loop = asyncio.get_running_loop()
        async with AsyncExitStack() as stack:
            stack.callback(self._out.close)
            ear, _ = await loop.create_datagram_endpoint(
                lambda: self._modes, local_addr=("127.0.0.1", self._ports.modes)
            )
            stack.callback(ear.close)
            channel = self._connection.open_channel()
            stack.push_async_callback(channel.close)
            ready()
            async with asyncio.TaskGroup() as group:
                for drone in self._drones:
                    group.create_task(self._drone(drone, channel), name=drone.uav_id)

    async def _drone(self, drone: DroneSpec, channel: Any) -> None:
        connection = self._connection
        identity, signer = connection.identity(drone.uav_id), connection.signer(drone.uav_id)
        contract = ProofContract(Gateway(channel, identity, signer).network(connection.channel), connection.chaincode)
        clock = SteadyClock()
        async with AsyncExitStack() as stack:
            radio = await stack.enter_async_context(UavRadio(drone_path(self._directory, drone.uav_id), clock))
            position: PositionSource = await stack.enter_async_context(
                self._open_position(self._ports.position[drone.uav_id], clock)
            )
            events = await stack.enter_async_context(LedgerEvents(contract))
            agent = UavAgent(
                uav_id=drone.uav_id,
                ledger=contract,
                events=events,
                identity=identity,
                signer=signer,
                radio=radio,
                position=position,
                act=lambda verdict: self._act(drone, verdict),
                clock=clock,
            )
            asked = 0
            while True:
                _, asked = await self._modes.until(drone.uav_id, Mode.HOLDING, after=asked)
                if not await self._prove(agent, drone):
                    self._tell(drone, "leave")

    async def _prove(self, agent: UavAgent, drone: DroneSpec) -> bool:
        """Whether the pad granted what the drone asked for."""
        for _ in range(ATTEMPTS):
            try:
                result = await agent.prove(drone.pad_id, drone.action)
            except UavAgentError as error:
                if error.code != "no_prekey":
                    _log.warning("%s: %s", drone.uav_id, error)
                    return False
            except LedgerError as error:
                _log.warning("%s: %s", drone.uav_id, error)
            else:
                self._on_result(result)
                return result.verdict is not None and result.verdict.permission == "granted"
            await asyncio.sleep(RETRY_S)
        return False

    async def _act(self, drone: DroneSpec, verdict: Verdict) -> str:
        """Land, and say when it is done. Only a committed verdict leads here."""
        del verdict
        self._tell(drone, "land")
        try:
            async with asyncio.timeout(ACT_LIMIT_S):
                await self._modes.until(drone.uav_id, Mode.LANDED)
        except TimeoutError:
            return "aborted"
        return "done"

    def _tell(self, drone: DroneSpec, command: str) -> None:
        data = json.dumps({"uav_id": drone.uav_id, "command": command}).encode()
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            self._out.sendto(data, ("127.0.0.1", self._ports.commands))
