"""A pad as a node of ROS 2: its state, sessions, verdicts, estimates, ranges, frames and health.

Verdicts and sessions come from committed, valid transactions alone; steps, estimates and health are the word of the
pad's own agent. What peers of ROS send changes nothing of either.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Mapping
from typing import Any, Final, Protocol

from wonderland import telemetry
from wonderland.asset_contract import CommittedBlock, CommittedEvent
from wonderland.clock import Clock
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.sessions import Session
from wonderland.proofs.records.verdicts import Verdict
from wonderland.telemetry import Body
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_rmw_zenoh import wire
from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node, Publication
from wonderland_rmw_zenoh.wire import Qos
from wonderland_ros_bridge.ros2 import pad_messages as says
from wonderland_ros_bridge.ros2.interfaces_command import DIRECTORIES
from wonderland_ros_bridge.ros2.open_rmf import OpenRmf
from wonderland_ros_bridge.ros2.parameters import Parameters
from wonderland_ros_bridge.ros2.prove_location import ProveLocation
from wonderland_ros_bridge.ros2.settings import PadNodeSettings
from wonderland_ros_bridge.together import run_together

_log = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
LOOK_BACK: Final = 200
"""Blocks that are read at the start, so that the last verdict is there for who comes later."""
SILENT_MS: Final = 25_000
"""An agent tells its health every ten seconds; one that has not for so long is not reporting."""
TELL_S: Final = 1.0
WATCH_S: Final = 3.0
MAX_WAITING: Final = 1_000
_ACTIVE: Final = {"id": 3, "label": "active"}
_INACTIVE: Final = {"id": 2, "label": "inactive"}


class PadLedger(Protocol):
    """What is committed, and the pad's record (``wonderland.asset_contract.AssetContract``)."""

    async def height(self) -> int:
        """How many blocks there are."""
        ...

    def committed(self, start_block: int) -> AsyncIterator[CommittedBlock]:
        """Every block from there on, for ever; events of valid transactions alone."""
        ...

    async def read_pad(self, pad_id: str) -> Pad:
        """The pad."""
        ...


class PadNode:
    """Publishes on a node that is open. ``report`` takes what the pad's agent tells."""

    def __init__(self, settings: PadNodeSettings, node: Node, ledger: PadLedger, clock: Clock) -> None:
        self._settings = settings
        self._node = node
        self._ledger = ledger
        self._clock = clock
        self._types = Interfaces(DIRECTORIES)
        self._parameters = Parameters()
        self._pad: Pad | None = None
        self._health: telemetry.Health | None = None
        self._heard_ms = 0
        self._session_id = ""
        self._on_ledger = False
        self._told: Mapping[str, Any] = {}
        self._queue: asyncio.Queue[tuple[int, Body]] = asyncio.Queue(MAX_WAITING)
        self._topics: dict[str, Publication] = {}
        self._next = 0
        self._height = 0
        self._action = ProveLocation(node, self._types, settings.pad_id, clock)
        rmf = settings.open_rmf
        self._door = None if rmf is None else OpenRmf(rmf, node, self._types, settings.pad_id, clock, self._is_there)
        self.placed: Final = asyncio.Event()
        """From now on nothing that is committed is missed."""

    async def wait_placed(self) -> None:
        """Until nothing that is committed from now on is missed."""
        await self.placed.wait()

    def report(self, t_ms: int, body: Body) -> None:
        """Something that the pad's agent told; where too much waits it is left out."""
        try:
            self._queue.put_nowait((t_ms, body))
        except asyncio.QueueFull:
            _log.debug("a report is left out: too many wait")

    async def run(self) -> None:
        """Publish until cancelled. Raises BridgeError, Ros2Error."""
        self._declare()
        door = () if self._door is None else (self._door.run(),)
        await run_together(self._follow(), self._watch(), self._take_reports(), self._tell(), self._action.run(), *door)

    def _declare(self) -> None:
        for name, kind, qos in (
            ("state", "wonderland_msgs/msg/PadState", wire.STATE),
            ("session", "wonderland_msgs/msg/Session", wire.STATE),
            ("verdict", "wonderland_msgs/msg/Verdict", wire.STATE),
            ("step", "wonderland_msgs/msg/Step", Qos()),
            ("estimate", "geometry_msgs/msg/PoseWithCovarianceStamped", wire.SENSOR),
            ("origin", "sensor_msgs/msg/NavSatFix", wire.STATE),
            ("/tf_static", "tf2_msgs/msg/TFMessage", wire.STATIC_TF),
            ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Qos()),
        ):
            self._topic(name, kind, qos)
        self._parameters.values |= {
            "pad_id": self._settings.pad_id,
            "frame": self._settings.frame,
            "map_frame": self._settings.map_frame,
        }
        self._parameters.serve(self._node, self._types)
        self._node.serve(
            f"{self._node.name}/get_state", self._types.service("lifecycle_msgs/srv/GetState"), self._lifecycle
        )

    def _topic(self, name: str, kind: str, qos: Qos) -> Publication:
        if name not in self._topics:
            whole = name if name.startswith("/") else f"{self._node.name}/{name}"
            self._topics[name] = self._node.advertise(whole, self._types.message(kind), qos)
        return self._topics[name]

    async def _lifecycle(self, _: Any) -> Mapping[str, Any]:
        return {"current_state": _ACTIVE if self._reporting() is not None and self._on_ledger else _INACTIVE}

    # --- the ledger ----------------------------------------------------------------------------------------------

    async def _follow(self) -> None:
        begun = False
        trouble = ""
        while True:
            try:
                if self._pad is None:
                    await self._read_pad()
                self._height = await self._ledger.height()
                if not begun:
                    self._next, begun = max(0, self._height - LOOK_BACK), True
                self._on_ledger = self._next >= self._height
                self.placed.set()
                async for block in self._ledger.committed(self._next):
                    for event in block.events:
                        await self._take_event(event, block.number)
                    self._next = block.number + 1
                    # Not before: what a block says may be over by the next one.
                    self._on_ledger |= self._next == self._height
            except LedgerError as error:
                if str(error) != trouble:
                    _log.warning("the ledger is not followed, tried again: %s", error)
                trouble = str(error)
            self._on_ledger = False
            await asyncio.sleep(AGAIN_S)

    async def _watch(self) -> None:
        """Whether the ledger answers: its blocks go on by themselves after an interruption, and say nothing of it."""
        while True:
            await asyncio.sleep(WATCH_S)
            try:
                async with asyncio.timeout(WATCH_S):
                    height = await self._ledger.height()
            except (LedgerError, TimeoutError):
                self._on_ledger = False
            else:
                # Who was there may be a look behind, no more; who was away has to have read all.
                needed = self._height if self._on_ledger else height
                self._height, self._on_ledger = height, self.placed.is_set() and self._next >= needed

    async def _read_pad(self) -> None:
        self._pad = pad = await self._ledger.read_pad(self._settings.pad_id)
        settings, now = self._settings, self._clock()
        if pad.commissioning is None:
            _log.warning("pad %s is not commissioned: it has no frame yet", pad.pad_id)
            return
        where = pad.commissioning.frame
        self._parameters.values |= {
            "origin.latitude": where.lat_e7 / 1e7,
            "origin.longitude": where.lon_e7 / 1e7,
            "origin.height_m": where.height_mm / 1_000,
            "commissioning_sha256": pad.commissioning_sha256 or "",
        }
        frames = says.transforms(now, pad, settings.frame, settings.map_frame)
        await self._topics["/tf_static"].publish(frames)
        await self._topics["origin"].publish(says.origin(now, where, settings.frame))

    async def _take_event(self, event: CommittedEvent, block: int) -> None:
        if event.record.get("pad_id") != self._settings.pad_id:
            return
        try:
            if event.name in {"PadCommissioned", "PadRetired"}:
                await self._read_pad()
            elif event.name == "ProofDecided":
                verdict = Verdict.parse(event.record)
                message = says.verdict(verdict, event, block, self._settings.frame)
                await self._topics["verdict"].publish(message)
                self._action.decided(message)
            elif event.name in {"ProofRequested", "InteractionCompleted", "ProofCancelled"}:
                session = Session.parse(event.record)
                message = says.session(session, event, block, self._settings.frame)
                self._session_id = session.session_id if session.state == "requested" else ""
                await self._topics["session"].publish(message)
                self._action.session(message)
            if self._door is not None:
                self._door.take(event)
        except ProofError as error:
            _log.warning("transaction %s is not published: %s", event.tx_id, error)

    # --- the pad's agent -----------------------------------------------------------------------------------------

    async def _take_reports(self) -> None:
        while True:
            t_ms, body = await self._queue.get()
            if isinstance(body, telemetry.Health):
                self._health, self._heard_ms = body, self._clock()
            elif isinstance(body, telemetry.Step):
                await self._topics["step"].publish(says.step(body, self._settings.frame))
                self._action.step(body)
            elif isinstance(body, telemetry.Estimate):
                await self._take_estimate(t_ms, body)

    async def _take_estimate(self, t_ms: int, body: telemetry.Estimate) -> None:
        await self._topics["estimate"].publish(says.estimate(t_ms, body, self._settings.frame))
        self._action.rounds(body)
        if self._pad is None:
            return
        for anchor_id, message in says.ranges(t_ms, body, self._settings.frame, self._pad):
            topic = self._topic(f"range/{wire.as_name(anchor_id)}", "sensor_msgs/msg/Range", wire.SENSOR)
            await topic.publish(message)

    def _is_there(self) -> bool:
        return self._on_ledger and self._reporting() is not None

    def _reporting(self) -> telemetry.Health | None:
        return self._health if self._clock() - self._heard_ms <= SILENT_MS else None

    async def _tell(self) -> None:
        """The state, where it is another one or ten seconds old; diagnostics each second."""
        rest = 0
        while True:
            now, health = self._clock(), self._reporting()
            state = says.state(
                now,
                self._pad,
                health,
                frame=self._settings.frame,
                session_id=self._session_id,
                on_ledger=self._on_ledger,
            )
            seen = {name: value for name, value in state.items() if name != "header"}
            if seen != self._told or rest == 0:
                self._told, rest = seen, 10
                await self._topics["state"].publish(state)
            rest -= 1
            door = None if self._door is None else self._door.diagnosed()
            await self._topics["/diagnostics"].publish(
                says.diagnostics(now, self._settings.pad_id, health, on_ledger=self._on_ledger, door=door)
            )
            await asyncio.sleep(TELL_S)
