"""One ranging session on a node, as its user has it: events, data, an end."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import AsyncIterator
from typing import Final, Protocol

from wonderland_fira_uci.errors import NodeClosedError, NodeUnavailableError
from wonderland_fira_uci.events import SessionEvent
from wonderland_fira_uci.uci.config import SessionConfig
from wonderland_fira_uci.uci.device import UciDevice
from wonderland_fira_uci.uci.status import SessionState

MAX_QUEUED_EVENTS: Final = 4096
CLOSE_TIMEOUT_S: Final = 2.0

_log = logging.getLogger(__name__)


class SessionNode(Protocol):
    """What a session needs of its node."""

    name: str
    device: UciDevice

    @property
    def detail(self) -> str:
        """Why the node is not ready; empty where it is."""
        ...

    def send_data(self, session: UwbSession, destination: int, data: bytes) -> None:
        """Hand a data unit over, for which there is credit."""
        ...

    def close_session(self, session: UwbSession) -> None:
        """Begin to stop the session."""
        ...


class UwbSession:
    """One ranging session on a node; made by ``UwbNode.open_session``. Survives unplugging of the node."""

    def __init__(self, node: SessionNode, config: SessionConfig) -> None:
        self._node = node
        self._queue: deque[SessionEvent] = deque()
        self._wake = asyncio.Event()
        self._credit = asyncio.Event()
        self._settled = asyncio.Event()
        self._ended = False
        self._closing = False
        self._error: Exception | None = None
        self.config = config
        self.state: SessionState | None = None
        """The node's last word; None while it is away or does not have the session."""
        self.events_dropped = 0
        """Events lost because nobody read them (the queue holds 4096, the oldest go first)."""

    @property
    def session_id(self) -> int:
        """The id shared by all nodes of the session."""
        return self.config.session_id

    @property
    def mac_address(self) -> int:
        """This node's short address in the session."""
        return self.config.app.mac_address

    @property
    def active(self) -> bool:
        """Whether the node is ranging now."""
        return self.state is SessionState.ACTIVE

    @property
    def closed(self) -> bool:
        """Whether the session is gone for good."""
        return self._ended

    @property
    def credit(self) -> bool:
        """Whether ``send`` would go through at once."""
        return self._node.device.has_credit(self.session_id)

    @property
    def credit_timeouts(self) -> int:
        """How many data units running the node has given no credit back for, each within a second."""
        return self._node.device.credit_timeouts(self.session_id)

    async def events(self) -> AsyncIterator[SessionEvent]:
        """Every event in order; one reader. Ends after ``close`` or ``SessionFailed``."""
        while True:
            while self._queue:
                yield self._queue.popleft()
            if self._ended:
                return
            self._wake.clear()
            await self._wake.wait()

    def events_nowait(self) -> list[SessionEvent]:
        """What is queued, without waiting."""
        out = list(self._queue)
        self._queue.clear()
        return out

    def send_nowait(self, data: bytes, *, destination: int | None = None) -> bool:
        """As ``send``, but returns False where that would wait."""
        if self._ended or self._closing:
            raise NodeClosedError(f"session {self.session_id:#010x} is closed")
        if not self.credit:
            return False
        self._node.send_data(self, self.config.app.destination_macs[0] if destination is None else destination, data)
        return True

    async def send(self, data: bytes, *, destination: int | None = None, timeout_s: float = 2.0) -> None:
        """Hands one data unit to the node as soon as it gives credit; it goes on air in the next round.

        Only the session's initiator is heard (session A: the drone, B: the pad), and in session A by every pad node
        whatever the ``destination`` (default: the first peer). No word on whether anybody heard it. Raises
        ``NodeUnavailableError`` when no credit comes in time or the node is away, ``NodeClosedError``,
        ``UciStateError`` for data of a wrong size.
        """
        try:
            async with asyncio.timeout(timeout_s):
                while not self.send_nowait(data, destination=destination):
                    self._credit.clear()
                    await self._credit.wait()
        except TimeoutError as error:
            detail = "gave no credit" if self.active else f"is away ({self._node.detail})"
            raise NodeUnavailableError(f"{self._node.name}: {detail} within {timeout_s:g} s") from error

    async def close(self) -> None:
        """STOP and DEINIT; returns when the node has confirmed, or cannot be reached. Never raises."""
        if not self._ended and not self._closing:
            self._closing = True
            self._node.close_session(self)
        try:
            async with asyncio.timeout(CLOSE_TIMEOUT_S):
                while not self._ended:
                    self._settled.clear()
                    await self._settled.wait()
        except TimeoutError:
            _log.warning("%s: session %#010x was not confirmed closed", self._node.name, self.session_id)
            self.ended(None)

    async def wait_active(self) -> None:
        """Until the node ranges; raises what the node refused with, or ``NodeClosedError``. Bound it with a timeout."""
        while not self.active:
            if self._ended:
                raise self._error or NodeClosedError(f"session {self.session_id:#010x} is closed")
            self._settled.clear()
            await self._settled.wait()

    # Called by the node

    def push(self, event: SessionEvent) -> None:
        """Queues an event for the reader."""
        if len(self._queue) >= MAX_QUEUED_EVENTS:
            self._queue.popleft()
            self.events_dropped += 1
        self._queue.append(event)
        self._wake.set()

    def settle(self, state: SessionState | None) -> None:
        """Notes the node's word about the session."""
        self.state = state
        self._settled.set()
        if self.active:
            self._credit.set()

    def credit_granted(self) -> None:
        """Lets a waiting ``send`` try again."""
        self._credit.set()

    def ended(self, error: Exception | None) -> None:
        """The session is gone for good."""
        if self._ended:
            return
        self._ended, self._error, self.state = True, error, None
        for event in (self._settled, self._credit, self._wake):
            event.set()
