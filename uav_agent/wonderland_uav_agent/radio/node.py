"""One node in several sessions: it leads the ranging session, hears the pad's words there or in another, and blinks.

Blinks (session C, and another for a witness) are for the pads' time stamps; a node that cannot blink ranges all the
same, and the proof has no time differences.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from wonderland.clock import Clock
from wonderland.proofs.records.radios import NodeAbility
from wonderland.uwb.agreed import ability_of
from wonderland.uwb.blinks import BlinkPlan
from wonderland.uwb.layout import RangingPlan, WordWays
from wonderland_fira_uci.errors import NodeError, UwbError
from wonderland_fira_uci.events import DataReceived, RangeMeasurement, SessionFailed
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import Opener
from wonderland_fira_uci.session import UwbSession
from wonderland_uav_agent.session.events import DataHeard, OwnRange, RadiosFailed
from wonderland_uav_agent.session.ports import Sink

_log = logging.getLogger(__name__)

READY_GRACE_S = 3.0
"""A node that is away when a session begins gets this long to come back."""


class UavRadio:
    """Use as an asynchronous context manager; the node is connected as long as it is open."""

    measures: Final = True

    def __init__(
        self, port: Path | str | Opener, clock: Clock, *, name: str = "drone's node", words: WordWays = "both_ways"
    ) -> None:
        """``words``: whether the node carries data as a responder, too."""
        self._node = UwbNode(port, name=name, clock=clock)
        self._carries = words
        self._ranging: UwbSession | None = None
        self._blinks: UwbSession | None = None
        self._answer = b""
        self._sessions: list[UwbSession] = []
        self._readers: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        await self._node.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close_session()
        await self._node.close()

    @property
    def trouble(self) -> str:
        """Why the node is not ready; empty where it is."""
        return self._node.detail

    async def wait_ready(self) -> None:
        """Until the node answers. Raises NodeError, with the reason, where it does not."""
        await self._node.wait_ready(READY_GRACE_S)

    async def ability(self) -> NodeAbility | None:
        """What the node says that it can do; None where it is away or does not say.

        Raises RangingPlanError where it lacks what no plan can do without.
        """
        with contextlib.suppress(UwbError):  # a session with a node that is away ends with its reason
            await self._node.wait_ready(READY_GRACE_S)
        return ability_of(self._node.capabilities, self._carries)

    async def open_session(self, plan: RangingPlan, sink: Sink) -> None:
        """Start all sessions; reports go to ``sink`` from now on. Raises UwbError."""
        await self.close_session()
        await self._node.wait_ready(READY_GRACE_S)
        self._ranging = await self._node.open_session(plan.uav_ranging())
        self._sessions.append(self._ranging)
        self._read(self._measure(self._ranging, frozenset(plan.pad_macs), sink))
        # The pad polls once it has a range, when its first round is over: that is time enough.
        words = plan.uav_words()
        if words is not None:
            heard = await self._node.open_session(words)
            self._sessions.append(heard)
            self._read(self._hear(heard, sink))
        # Not waited for: ranging begins meanwhile, and goes on where the node cannot blink.
        blinks, for_witness = plan.timed_blinks(), plan.timed_witness_blinks()
        if blinks is not None:
            self._read(self._blink(blinks))
        if for_witness is not None:
            self._read(self._blink(for_witness, for_witness=True))

    async def answer_in_blinks(self, answer: bytes) -> None:
        """Let each blink for the pad carry this from now on. Raises UwbError."""
        self._answer = answer
        if self._blinks is not None:
            await self._blinks.send(answer)

    async def _blink(self, plan: BlinkPlan, *, for_witness: bool = False) -> None:
        try:
            session = await self._node.open_session(plan.uav_tag())
            self._sessions.append(session)
            payload = plan.payload
            if not for_witness:
                self._blinks = session
                payload = self._answer or payload
            if payload:
                await session.send(payload)
        except UwbError as error:
            _log.warning("no blinks in session %#010x: %s", plan.session_id, error)
            return
        async for event in session.events():
            if isinstance(event, SessionFailed):
                _log.warning("no blinks any more: %s", event.error)

    async def send(self, frame: bytes) -> None:
        """Hand a frame to the node. Raises NodeError; whether it is heard nobody knows."""
        if self._ranging is None:
            raise NodeError("no session is open")
        await self._ranging.send(frame)

    async def close_session(self) -> None:
        """Stop all sessions. Never raises."""
        readers, self._readers = self._readers, []
        sessions, self._sessions = self._sessions, []
        self._ranging = self._blinks = None
        self._answer = b""
        for reader in readers:
            reader.cancel()
        for reader in readers:
            with contextlib.suppress(asyncio.CancelledError):
                await reader
        await asyncio.gather(*(session.close() for session in sessions))

    def _read(self, reader: Coroutine[None, None, None]) -> None:
        self._readers.append(asyncio.create_task(reader))

    @staticmethod
    async def _measure(session: UwbSession, pad_macs: frozenset[int], sink: Sink) -> None:
        async for event in session.events():
            match event:
                case RangeMeasurement(range_mm=int(range_mm), peer_mac=mac) if mac in pad_macs:
                    sink(OwnRange(mac, event.t_ms, range_mm))
                case DataReceived():
                    sink(DataHeard(event.data))
                case SessionFailed():
                    sink(RadiosFailed(str(event.error)))
                case _:
                    pass

    @staticmethod
    async def _hear(session: UwbSession, sink: Sink) -> None:
        async for event in session.events():
            match event:
                case DataReceived():
                    sink(DataHeard(event.data))
                case SessionFailed():
                    sink(RadiosFailed(str(event.error)))
                case _:
                    pass
