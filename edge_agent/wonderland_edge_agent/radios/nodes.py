"""Four nodes, four serial ports: kept connected all the time, and put into a session's two UWB sessions on demand."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Self

from wonderland.clock import Clock
from wonderland.telemetry.fields import AnchorCondition
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.radios.between import PairRanges, measure_between
from wonderland_edge_agent.session.events import AnchorRange, DataHeard, FrameHeard, PadEvent, RadiosFailed
from wonderland_fira_uci.errors import NodeError, UwbError
from wonderland_fira_uci.events import DataReceived, FrameStamped, RangeMeasurement, SessionFailed
from wonderland_fira_uci.node import UwbNode, UwbSession
from wonderland_fira_uci.serial_port import Opener
from wonderland_fira_uci.uci.capabilities import Capabilities
from wonderland_fira_uci.uci.config import SessionConfig

_log = logging.getLogger(__name__)

MIN_ANCHORS: Final = 3
"""A horizontal position needs three ranges."""
READY_GRACE_S: Final = 0.5
"""A node that is away when a session begins gets this long to come back."""
ECHO_MS: Final = 30
"""All nodes hear the same data; copies within this time are one."""
_REMEMBERED: Final = 64

Sink = Callable[[PadEvent], None]


class RadiosError(Exception):
    """The pad's nodes cannot range now; the text says which and why."""


@dataclass(frozen=True, slots=True)
class AnchorPort:
    """Which anchor hangs on which serial port."""

    anchor_id: str
    port: str | Opener


@dataclass(frozen=True, slots=True)
class AnchorState:
    """One anchor's node, for people. ``state``: up, down (port or node away), or silent (no report when ranging)."""

    anchor_id: str
    state: AnchorCondition
    detail: str
    firmware: str | None
    capabilities: Capabilities | None = None
    """What the node says that it can do; None where it has not said."""


class PadRadios:
    """All nodes of a pad. Use as an asynchronous context manager; the nodes are connected as long as it is open."""

    measured_by: Final = "pad"
    sts: Final = "provisioned"

    def __init__(self, ports: Sequence[AnchorPort], clock: Clock) -> None:
        self._nodes = {
            entry.anchor_id: UwbNode(entry.port, name=f"anchor {entry.anchor_id}", clock=clock) for entry in ports
        }
        self._clock = clock
        self._words: UwbSession | None = None
        self._sessions: list[UwbSession] = []
        self._readers: list[asyncio.Task[None]] = []
        self._heard: OrderedDict[bytes, int] = OrderedDict()
        self._reported: dict[str, int] = {}
        self._between: asyncio.Task[PairRanges] | None = None

    async def __aenter__(self) -> Self:
        for node in self._nodes.values():
            await node.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close_session()
        await asyncio.gather(*(node.close() for node in self._nodes.values()))

    def states(self) -> list[AnchorState]:
        """Every anchor's node as it is now."""
        ranging = bool(self._sessions)
        now_ms = self._clock()
        out: list[AnchorState] = []
        for anchor_id, node in self._nodes.items():
            state: AnchorCondition = "up" if node.is_ready else "down"
            if node.is_ready and ranging and now_ms - self._reported.get(anchor_id, now_ms) > 1_000:
                state = "silent"
            out.append(AnchorState(anchor_id, state, node.detail, _firmware(node), node.capabilities))
        return out

    async def open_session(self, plan: RangingPlan, anchor_ids: Sequence[str], sink: Sink) -> str | None:
        """Start session A on every node and B on the first; reports go to ``sink`` from now on.

        ``anchor_ids`` in the order of ``plan.pad_macs``. Returns the nodes' firmware, where they say it. Raises
        RadiosError when fewer than three nodes, or the one that speaks, take part.
        """
        await self.close_session()
        self._heard.clear()
        self._reported = dict.fromkeys(anchor_ids, self._clock())
        outcomes = await asyncio.gather(
            *(self._open_anchor(plan, index, anchor_id, sink) for index, anchor_id in enumerate(anchor_ids))
        )
        missing = [f"{anchor_id} ({why})" for anchor_id, why in zip(anchor_ids, outcomes, strict=True) if why]
        if missing:
            _log.warning("session %#010x: without %s", plan.session_a_id, ", ".join(missing))
        if len(anchor_ids) - len(missing) < MIN_ANCHORS or outcomes[0]:
            await self.close_session()
            raise RadiosError(f"nodes that cannot range: {', '.join(missing)}")
        if plan.blinks is not None:  # not waited for: ranging begins meanwhile
            self._read(self._stamp_blinks(plan.blinks, anchor_ids, sink))
        firmware = {_firmware(self._nodes[anchor_id]) for anchor_id in anchor_ids if anchor_id in self._nodes}
        firmware.discard(None)
        return "; ".join(sorted(str(entry) for entry in firmware))[:64] or None

    async def listen(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        """Only time-stamp blinks, as a witness does, until ``close_session``. Raises RadiosError where no node can."""
        await self.close_session()
        self._reported = dict.fromkeys(anchor_ids, self._clock())
        if not await self._open_blinks(plan, anchor_ids, sink):
            await self.close_session()
            raise RadiosError("no node can time-stamp blinks")

    async def measure_between(self, macs: Mapping[str, int], rounds: int) -> PairRanges:
        """Let the nodes range each other; a session that is opened ends it at once, and there is nothing then."""
        if self._sessions or self._between is not None:
            return {}
        task = self._between = asyncio.create_task(measure_between(self._nodes, macs, rounds=rounds))
        try:
            await asyncio.wait({task})
            return {} if task.cancelled() else task.result()
        finally:
            await self._stop_between()

    async def _stop_between(self) -> None:
        task, self._between = self._between, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def send(self, frame: bytes) -> None:
        """Hand a frame to the node that speaks. Raises NodeError; whether it is heard nobody knows."""
        if self._words is None:
            raise NodeError("no session is open")
        await self._words.send(frame)

    async def close_session(self) -> None:
        """Stop both UWB sessions on all nodes. Never raises."""
        await self._stop_between()
        readers, self._readers = self._readers, []
        sessions, self._sessions = self._sessions, []
        self._words = None
        for reader in readers:
            reader.cancel()
        for reader in readers:
            with contextlib.suppress(asyncio.CancelledError):
                await reader
        await asyncio.gather(*(session.close() for session in sessions))

    async def _open_anchor(self, plan: RangingPlan, index: int, anchor_id: str, sink: Sink) -> str:
        """Why the anchor does not take part; empty where it does."""
        node = self._nodes.get(anchor_id)
        if node is None:
            return "no port configured"
        speaks = index == 0
        try:
            await node.wait_ready(READY_GRACE_S)
            ranging = await self._started(node, plan.pad_ranging(index))
            self._read(self._reports(ranging, anchor_id, plan.uav_mac, sink, speaks=speaks))
            if speaks:
                self._words = await self._started(node, plan.pad_words())
                self._read(self._drain(self._words, sink))
        except UwbError as error:
            return str(error)
        return ""

    async def _stamp_blinks(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        await self._open_blinks(plan, anchor_ids, sink)

    async def _open_blinks(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> int:
        """Session C on every node that can; returns how many. Without it the proof has no time differences."""
        outcomes = await asyncio.gather(
            *(self._open_anchor_blinks(plan, index, anchor_id, sink) for index, anchor_id in enumerate(anchor_ids))
        )
        missing = [f"{anchor_id} ({why})" for anchor_id, why in zip(anchor_ids, outcomes, strict=True) if why]
        if missing:
            _log.warning("session %#010x: no time stamps from %s", plan.session_id, ", ".join(missing))
        return len(anchor_ids) - len(missing)

    async def _open_anchor_blinks(self, plan: BlinkPlan, index: int, anchor_id: str, sink: Sink) -> str:
        node = self._nodes.get(anchor_id)
        if node is None:
            return "no port configured"
        try:
            await node.wait_ready(READY_GRACE_S)
            session = await self._started(node, plan.pad_anchor(index))
        except UwbError as error:
            return str(error)
        self._read(self._stamps(session, anchor_id, plan.uav_mac, sink))
        return ""

    async def _stamps(self, session: UwbSession, anchor_id: str, uav_mac: int, sink: Sink) -> None:
        async for event in session.events():
            match event:
                case FrameStamped() if event.tag_mac == uav_mac:
                    self._reported[anchor_id] = event.t_ms
                    sink(FrameHeard(anchor_id, event.t_ms, event.number, event.ticks, event.payload))
                case SessionFailed():
                    _log.warning("anchor %s: no time stamps any more: %s", anchor_id, event.error)
                case _:
                    pass

    async def _started(self, node: UwbNode, config: SessionConfig) -> UwbSession:
        session = await node.open_session(config)
        self._sessions.append(session)
        return session

    def _read(self, reader: Coroutine[None, None, None]) -> None:
        self._readers.append(asyncio.create_task(reader))

    async def _reports(self, session: UwbSession, anchor_id: str, uav_mac: int, sink: Sink, *, speaks: bool) -> None:
        async for event in session.events():
            match event:
                case RangeMeasurement() if event.peer_mac == uav_mac:
                    self._reported[anchor_id] = event.t_ms
                    sink(AnchorRange(anchor_id, event.t_ms, event.range_mm, bool(event.nlos)))
                case DataReceived():
                    if self._is_first(event.data, event.t_ms):
                        sink(DataHeard(event.data))
                case SessionFailed() if speaks:
                    sink(RadiosFailed(f"anchor {anchor_id}: {event.error}"))
                case SessionFailed():
                    _log.warning("anchor %s: out of the session: %s", anchor_id, event.error)
                case _:
                    pass

    async def _drain(self, session: UwbSession, sink: Sink) -> None:
        """Session B's reports: its range is one more of an anchor that reports already, so only its end matters."""
        async for event in session.events():
            if isinstance(event, SessionFailed):
                sink(RadiosFailed(f"session for words: {event.error}"))

    def _is_first(self, data: bytes, t_ms: int) -> bool:
        """Whether this is the first copy: every node hears the same frame, but a repetition counts anew."""
        before_ms = self._heard.get(data)
        if before_ms is not None and t_ms - before_ms < ECHO_MS:
            return False
        self._heard[data] = t_ms
        self._heard.move_to_end(data)
        if len(self._heard) > _REMEMBERED:
            self._heard.popitem(last=False)
        return True


def _firmware(node: UwbNode) -> str | None:
    info = node.info
    return None if info is None else f"UCI {_version(info.uci_version)}, PHY {_version(info.phy_version)}"


def _version(value: int) -> str:
    """Major in the low octet, minor in the upper half of the high one, patch in the lower."""
    return f"{value & 0xFF}.{value >> 12}.{value >> 8 & 0xF}"
