"""Four nodes, four serial ports: kept connected all the time, and put into a session's two UWB sessions on demand."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import OrderedDict
from collections.abc import Coroutine, Mapping, Sequence
from types import TracebackType
from typing import Final, Self

from wonderland.clock import Clock
from wonderland.session.pace import pace_of
from wonderland.telemetry.fields import AnchorCondition
from wonderland.uwb.agreed import outside
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan
from wonderland_edge_agent.radios.anchors import (
    MIN_ANCHORS,
    READY_GRACE_S,
    AnchorPort,
    AnchorState,
    RadiosError,
    Sink,
    firmware_of,
)
from wonderland_edge_agent.radios.attendance import Attendance
from wonderland_edge_agent.radios.between import PairRanges, RollCall, measure_between, roll_call
from wonderland_edge_agent.radios.stamping import BlinkStamps
from wonderland_edge_agent.session.events import AnchorRange, DataHeard, RadiosFailed
from wonderland_fira_uci.errors import NodeError, UwbError
from wonderland_fira_uci.events import (
    DataReceived,
    RangeMeasurement,
    SessionFailed,
    SessionInterrupted,
)
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.config import SessionConfig

_log = logging.getLogger(__name__)

ECHO_MS: Final = 30
"""All nodes hear the same data; copies within this time are one."""
_REMEMBERED: Final = 64
NO_CREDIT: Final = 2
"""After so many data units running without a credit it was no lost notification."""
_VOICE_S: Final = 0.25
"""Between two looks whether the node that speaks still does."""


class PadRadios:
    """All nodes of a pad. Use as an asynchronous context manager; the nodes are connected as long as it is open."""

    measured_by: Final = "pad"
    sts: Final = "provisioned"
    interval_ms: Final = None
    highest: Final = None

    def __init__(self, ports: Sequence[AnchorPort], clock: Clock, *, region: str | None = None) -> None:
        """``region``: whose channels alone are used, even by a plan of others; None: any."""
        self._region = region
        self._nodes = {entry.anchor_id: entry.node(clock) for entry in ports}
        self._clock = clock
        self._words: UwbSession | None = None
        """That in which the pad speaks: session B, or its node's session A where that carries data both ways."""
        self._ranging: dict[str, UwbSession] = {}
        """Session A by anchor."""
        self._sessions: list[UwbSession] = []
        self._readers: list[asyncio.Task[None]] = []
        self._heard: OrderedDict[bytes, int] = OrderedDict()
        self._attendance = Attendance()
        self._voice = ""
        """The anchor that speaks to the drone."""
        self._voice_lost = asyncio.Event()
        self._blinks = BlinkStamps(self._nodes, self._started, self._read)
        self._between: asyncio.Task[PairRanges] | asyncio.Task[RollCall] | None = None

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
        now_ms = self._clock()
        out: list[AnchorState] = []
        for anchor_id, node in self._nodes.items():
            state: AnchorCondition = "up" if node.is_ready else "down"
            detail, fault, mute = node.detail, "", self._attendance.mute(anchor_id)
            if node.is_ready:
                fault = self._attendance.fault(anchor_id, now_ms)
                if fault or mute or self._attendance.is_silent(anchor_id, now_ms):
                    state, detail = "silent", fault or mute or self._attendance.status(anchor_id)
            else:
                self._attendance.restarted(anchor_id)
            out.append(
                AnchorState(
                    anchor_id,
                    state,
                    detail,
                    firmware_of(node),
                    node.capabilities,
                    faulty=bool(fault),
                    unproven=node.is_ready and self._attendance.is_unproven(anchor_id),
                    speaks=not mute,
                    unseen=node.is_ready and self._attendance.is_unseen(anchor_id),
                )
            )
        return out

    async def open_session(self, plan: RangingPlan, anchor_ids: Sequence[str], sink: Sink) -> str | None:
        """Start session A on every node, and B on one where the plan has it; reports go to ``sink`` from now on.

        ``anchor_ids`` in the order of ``plan.pad_macs``. Returns the nodes' firmware, where they say it. Raises
        RadiosError when fewer than three nodes take part, or none of them can speak.
        """
        await self.close_session()
        self._permit(plan.channel)
        self._heard.clear()
        self._attendance.begin(anchor_ids, self._clock(), pace_of(plan))
        voice = self._voices(anchor_ids)[:1]
        outcomes = await asyncio.gather(
            *(
                self._open_anchor(plan, index, anchor_id, sink, speaks=anchor_id in voice)
                for index, anchor_id in enumerate(anchor_ids)
            )
        )
        missing = [f"{anchor_id} ({why})" for anchor_id, why in zip(anchor_ids, outcomes, strict=True) if why]
        if missing:
            _log.warning("session %#010x: without %s", plan.session_a_id, ", ".join(missing))
        if len(anchor_ids) - len(missing) < MIN_ANCHORS:
            await self.close_session()
            raise RadiosError(f"nodes that cannot range: {', '.join(missing)}")
        if self._words is None:
            there = [anchor_id for anchor_id, why in zip(anchor_ids, outcomes, strict=True) if not why]
            problem = await self._speak(plan, self._voices(there))
            if problem:
                await self.close_session()
                raise RadiosError(f"no node can speak to the drone: {problem}")
        self._read(self._keep_voice(plan, anchor_ids, sink))
        blinks = plan.timed_blinks()
        if blinks is not None:  # not waited for: ranging begins meanwhile
            self._read(self._stamp(blinks, anchor_ids, sink))
        firmware = {firmware_of(self._nodes[anchor_id]) for anchor_id in anchor_ids if anchor_id in self._nodes}
        firmware.discard(None)
        return "; ".join(sorted(str(entry) for entry in firmware))[:64] or None

    async def listen(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        """Only time-stamp blinks, as a witness does, until ``close_session``. Raises RadiosError where no node can."""
        await self.close_session()
        self._permit(plan.channel)
        if not await self._blinks.open(plan, anchor_ids, sink):
            await self.close_session()
            raise RadiosError("no node can time-stamp blinks")

    async def measure_between(self, macs: Mapping[str, int], rounds: int, channel: int) -> PairRanges:
        """Let the nodes range each other; a session that is opened ends it at once, and there is nothing then."""
        if self._sessions or self._between is not None:
            return {}
        task = asyncio.create_task(
            measure_between(self._nodes, macs, rounds=rounds, channel=channel, region=self._region)
        )
        self._between = task
        try:
            await asyncio.wait({task})
            return {} if task.cancelled() else task.result()
        finally:
            await self._stop_between()

    async def call_roll(self, macs: Mapping[str, int], channel: int, *, expected: bool = False) -> bool | None:
        """Look whether all nodes that answer also range; ``states`` says it. A session that is opened ends it.

        ``expected``: these anchors hear each other where all is well. Returns whether any was heard; None: no look.
        """
        if self._sessions or self._between is not None:
            return None
        task = asyncio.create_task(roll_call(self._nodes, macs, channel=channel, region=self._region))
        self._between = task
        try:
            await asyncio.wait({task})
            if task.cancelled():
                return None
            found = task.result()
            for anchor_id, fault in self._attendance.called(found, expected=expected).items():
                _log.warning("anchor %s: %s", anchor_id, fault or "ranges again")
            return bool(found.heard) if found.heard or found.unheard else None
        finally:
            await self._stop_between()

    @property
    def roll_wanted(self) -> bool:
        """Whether a node has come back since the last roll call."""
        return any(node.is_ready and self._attendance.has_returned(name) for name, node in self._nodes.items())

    def _permit(self, channel: int) -> None:
        problem = outside(channel, self._region)
        if problem:
            raise RadiosError(problem)

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
        """Stop all UWB sessions on all nodes. Never raises."""
        await self._stop_between()
        readers, self._readers = self._readers, []
        sessions, self._sessions = self._sessions, []
        self._words, self._voice = None, ""
        self._ranging.clear()
        self._attendance.end()
        for reader in readers:
            reader.cancel()
        for reader in readers:
            with contextlib.suppress(asyncio.CancelledError):
                await reader
        await asyncio.gather(*(session.close() for session in sessions))

    async def _open_anchor(self, plan: RangingPlan, index: int, anchor_id: str, sink: Sink, *, speaks: bool) -> str:
        """Why the anchor does not take part; empty where it does."""
        node = self._nodes.get(anchor_id)
        if node is None:
            return "no port configured"
        try:
            await node.wait_ready(READY_GRACE_S)
            ranging = self._ranging[anchor_id] = await self._started(node, plan.pad_ranging(index))
            self._read(self._reports(ranging, anchor_id, plan.uav_mac, sink))
        except UwbError as error:
            if node.is_ready:
                self._attendance.refused(anchor_id, f"does not take the session: {error}")
            return str(error)
        if speaks:
            problem = await self._speak(plan, [anchor_id])
            if problem:
                _log.warning("session %#010x: another node has to speak: %s", plan.session_b_id, problem)
        return ""

    def _voices(self, anchor_ids: Sequence[str]) -> list[str]:
        """Nodes in the order in which they are asked to speak: those that are well first."""
        states = {state.anchor_id: state for state in self.states()}

        def rank(anchor_id: str) -> int:
            state = states.get(anchor_id)
            return 2 if state is None or state.state == "down" else int(state.state == "silent")

        return sorted(anchor_ids, key=rank)

    async def _speak(self, plan: RangingPlan, anchor_ids: Sequence[str]) -> str:
        """Let the first of these that can speak for the pad; why none can, or empty.

        In session B it uses the address that the plan gives to the pad's words, so that the drone need not know who it
        is; in session A the drone hears all of them.
        """
        troubles: list[str] = []
        config = plan.pad_words()
        for anchor_id in anchor_ids:
            ranging = self._ranging.get(anchor_id)
            if ranging is None or ranging.closed:
                continue
            self._words = ranging
            if config is not None:
                try:
                    self._words = await self._started(self._nodes[anchor_id], config)
                except UwbError as error:
                    self._words = None
                    troubles.append(str(error))
                    continue
                self._read(self._drain(self._words))
            self._voice = anchor_id
            self._voice_lost.clear()
            return ""
        return "; ".join(troubles) or "no node is left"

    async def _keep_voice(self, plan: RangingPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        """Where the node that speaks goes, or is not heard while others are, another takes its part."""
        unheard = 0
        """Data that no credit was given for while the node that speaks did not range the drone."""
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_VOICE_S):
                    await self._voice_lost.wait()
            now_ms = self._clock()
            problem = self._attendance.other_key(now_ms)
            if problem:
                sink(RadiosFailed(problem))
                return
            waiting = 0 if self._words is None else self._words.credit_timeouts
            # A responder sends its data in rounds of the drone's: where there are none it is the drone that is missing.
            unheard = min(unheard, waiting) if self._attendance.is_ranging(self._voice, now_ms) else waiting
            if waiting - unheard >= NO_CREDIT:
                self._attendance.takes_no_words(self._voice, "accepts no data (no credit)")
                _log.warning("anchor %s: accepts no data (no credit)", self._voice)
                self._voice_lost.set()
            if not (self._voice_lost.is_set() or self._attendance.fault(self._voice, now_ms)):
                continue
            lost, words, self._words = self._voice, self._words, None
            if words is not None and words is not self._ranging.get(lost):
                self._sessions.remove(words)
                self._read(words.close())  # not waited for: a node that hangs does not confirm it
            others = [anchor_id for anchor_id in self._voices(anchor_ids) if anchor_id != lost]
            problem = await self._speak(plan, others)
            if problem:
                sink(RadiosFailed(f"no node can speak to the drone any more: {problem}"))
                return
            _log.warning("session %#010x: anchor %s speaks in place of %s", plan.session_b_id, self._voice, lost)

    async def _stamp(self, plan: BlinkPlan, anchor_ids: Sequence[str], sink: Sink) -> None:
        await self._blinks.open(plan, anchor_ids, sink)

    async def _started(self, node: UwbNode, config: SessionConfig) -> UwbSession:
        session = await node.open_session(config)
        self._sessions.append(session)
        return session

    def _read(self, reader: Coroutine[None, None, None]) -> None:
        self._readers.append(asyncio.create_task(reader))

    async def _reports(self, session: UwbSession, anchor_id: str, uav_mac: int, sink: Sink) -> None:
        async for event in session.events():
            match event:
                case RangeMeasurement() if event.peer_mac == uav_mac:
                    ranged = event.range_mm is not None
                    self._attendance.measured(anchor_id, event.t_ms, status=event.status, ranged=ranged)
                    sink(AnchorRange(anchor_id, event.t_ms, event.range_mm, bool(event.nlos)))
                case DataReceived():
                    if self._is_first(event.data, event.t_ms):
                        sink(DataHeard(event.data))
                case SessionFailed() | SessionInterrupted():
                    if session is self._words:
                        self._voice_lost.set()
                    if isinstance(event, SessionFailed):
                        _log.warning("anchor %s: out of the session: %s", anchor_id, event.error)
                case _:
                    pass

    async def _drain(self, session: UwbSession) -> None:
        """Session B's reports: its range is one more of an anchor that reports already, so only its end matters."""
        async for event in session.events():
            if isinstance(event, (SessionFailed, SessionInterrupted)) and session is self._words:
                self._voice_lost.set()

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
