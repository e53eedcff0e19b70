"""One UWB node on one serial port, asynchronous: ``UwbNode`` and its ``UwbSession``."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from wonderland_fira_uci.errors import NodeClosedError, NodeUnavailableError
from wonderland_fira_uci.events import (
    DataFailed,
    DataReceived,
    FrameStamped,
    RangeMeasurement,
    RangingSilent,
    SessionFailed,
    SessionInterrupted,
    SessionStateChanged,
)
from wonderland_fira_uci.serial_port import Opener, PortTimings, ReconnectingPort, serial_opener
from wonderland_fira_uci.session import UwbSession
from wonderland_fira_uci.uci.capabilities import Capabilities
from wonderland_fira_uci.uci.config import SessionConfig
from wonderland_fira_uci.uci.data import DataReceive, DataTransferStatus
from wonderland_fira_uci.uci.device import Timings, UciDevice
from wonderland_fira_uci.uci.device_events import (
    CreditGranted,
    DeviceEvent,
    DeviceLost,
    DeviceReady,
    SessionChanged,
    SessionEnded,
    SessionLost,
    SessionMessage,
    StreamResynchronised,
)
from wonderland_fira_uci.uci.ranging import FrameType, RangeData
from wonderland_fira_uci.uci.session import DeviceInfo
from wonderland_fira_uci.uci.status import Status, TransferStatus

_DATA_SENT: Final = (TransferStatus.OK, TransferStatus.REPETITION_OK)

_log = logging.getLogger(__name__)


def monotonic_ms() -> int:
    """Milliseconds of the monotonic clock."""
    return time.monotonic_ns() // 1_000_000


class UwbNode:
    """One node. Use as an asynchronous context manager; it connects, resets the node, and keeps doing so.

    ``port``: path of the serial device (a stable link as under /dev/serial/by-id is best), or an ``Opener``.
    ``clock``: milliseconds for ``t_ms`` of all events. ``on_status``: told (ready, detail) when the node comes and
    goes. ``settings``: parameters of the node's maker, (id, value), given after each reset. ``name``: for messages and
    logs (default: the path).
    """

    def __init__(
        self,
        port: Path | str | Opener,
        *,
        name: str = "",
        clock: Callable[[], int] = monotonic_ms,
        on_status: Callable[[bool, str], None] | None = None,
        timings: Timings | None = None,
        settings: Sequence[tuple[bytes, bytes]] = (),
        port_timings: PortTimings | None = None,
    ) -> None:
        opener = serial_opener(port) if isinstance(port, (str, Path)) else port
        self.name = name or (str(port) if isinstance(port, (str, Path)) else "UWB node")
        self.device = UciDevice(timings, settings)
        self.detail = "not started"
        """Why the node is not ready; empty while it is."""
        self._clock = clock
        self._on_status = on_status
        self._port = ReconnectingPort(opener, self, timings=port_timings, not_opened=self._set_detail)
        self._sessions: dict[int, UwbSession] = {}
        self._status_changed = asyncio.Event()
        self._session_gone = asyncio.Event()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ms = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False

    async def __aenter__(self) -> Self:
        self._loop = asyncio.get_running_loop()
        self.detail = "looking for the port"
        self._port.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    @property
    def is_ready(self) -> bool:
        """Whether the node is there, was reset and answers."""
        return not self.detail

    @property
    def info(self) -> DeviceInfo | None:
        """What the node said about itself at its last reset."""
        return self.device.info

    @property
    def capabilities(self) -> Capabilities | None:
        """What the node said that it can do; None before it has, or where its answer could not be read."""
        return self.device.capabilities

    async def wait_ready(self, timeout_s: float = 5.0) -> None:
        """Until the node answers; raises ``NodeUnavailableError``, at once where waiting mends nothing."""
        try:
            async with asyncio.timeout(timeout_s):
                while not self.is_ready:
                    if self._closed:
                        raise NodeClosedError(f"{self.name} is closed")
                    if self._port.hopeless:
                        raise NodeUnavailableError(f"{self.name}: {self._reason()}")
                    self._status_changed.clear()
                    await self._status_changed.wait()
        except TimeoutError as error:
            raise NodeUnavailableError(f"{self.name}: not ready within {timeout_s:g} s: {self._reason()}") from error

    async def open_session(self, config: SessionConfig, *, timeout_s: float = 5.0) -> UwbSession:
        """Until the session is ACTIVE. Several sessions may run at once.

        Raises ``NodeUnavailableError`` (node silent or away), ``UciConfigRejectedError`` and other ``UciError``
        (the node refuses; text and parameters say what), ``UciStateError`` when the id is in use on this node,
        ``NodeClosedError``.
        """
        if self._closed or self._loop is None:
            raise NodeClosedError(f"{self.name} is closed or was never entered")
        session: UwbSession | None = None
        try:
            async with asyncio.timeout(timeout_s):
                while self.device.is_closing(config.session_id):  # its predecessor, not yet confirmed gone
                    self._session_gone.clear()
                    await self._session_gone.wait()
                self.device.open_session(config, monotonic_ms())
                session = self._sessions[config.session_id] = UwbSession(self, config)
                self._after_input()
                await session.wait_active()
        except TimeoutError as error:
            if session is not None:
                await session.close()
            text = f"{self.name}: session {config.session_id:#010x} not active within {timeout_s:g} s"
            raise NodeUnavailableError(f"{text}: {self._reason()}") from error
        except asyncio.CancelledError:
            if session is not None:
                self.close_session(session)
                session.ended(None)
            raise
        return session

    async def close(self) -> None:
        """Closes all sessions, then the port. Never raises."""
        if self._closed:
            return
        self._closed = True
        await asyncio.gather(*(session.close() for session in list(self._sessions.values())))
        self._port.close()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._set_detail("closed")

    def _reason(self) -> str:
        return self.detail or "the node answers, but the session did not start"

    # Called by sessions

    def send_data(self, session: UwbSession, destination: int, data: bytes) -> None:
        """Hands data to the state machine, which has said that there is credit."""
        self.device.send_data(session.session_id, destination, data, monotonic_ms())
        self._after_input()

    def close_session(self, session: UwbSession) -> None:
        """Begins to close a session."""
        self.device.close_session(session.session_id, monotonic_ms())
        self._after_input()

    # Called by the port

    def port_up(self) -> None:
        """Resets the node that appeared."""
        self._set_detail("resetting the node")
        self.device.port_up(monotonic_ms())
        self._after_input()

    def port_down(self, detail: str) -> None:
        """Tells every session that the node is away."""
        self.device.port_down(detail)
        self._after_input()
        self._set_detail(detail)

    def data_received(self, data: bytes) -> None:
        """Feeds the state machine."""
        self.device.receive_data(data, monotonic_ms())
        self._after_input()

    def _after_input(self) -> None:
        out = self.device.data_to_send()
        if out:
            self._port.write(out)
        for event in self.device.events():
            self._handle(event)
        due_ms = self.device.next_timeout_ms()
        if due_ms is None or self._loop is None:
            return
        # A timer that fires too early only looks again; most inputs move the next timeout back, so keep it.
        if self._timer is None or due_ms < self._timer_ms:
            if self._timer is not None:
                self._timer.cancel()
            self._timer_ms = due_ms
            self._timer = self._loop.call_later(max(due_ms - monotonic_ms(), 0) / 1000, self._timeout)

    def _timeout(self) -> None:
        self._timer = None
        self.device.advance(monotonic_ms())
        self._after_input()

    def _handle(self, event: DeviceEvent) -> None:
        if isinstance(event, SessionMessage):
            session = self._sessions.get(event.session_id)
            if session is not None:
                self._deliver(session, event.message)
        elif isinstance(event, CreditGranted):
            session = self._sessions.get(event.session_id)
            if session is not None:
                session.credit_granted()
        elif isinstance(event, (SessionChanged, SessionLost, SessionEnded)):
            self._handle_session(event)
        elif isinstance(event, DeviceReady):
            self._set_detail("")
        elif isinstance(event, DeviceLost):
            self._set_detail(event.detail)
        elif isinstance(event, StreamResynchronised):
            _log.warning("%s: %d octets on the line made no sense and were dropped", self.name, event.octets)
        else:
            _log.warning("%s: %s", self.name, event.error)

    def _handle_session(self, event: SessionChanged | SessionLost | SessionEnded) -> None:
        session = self._sessions.get(event.session_id)
        if session is None:
            return
        now_ms = self._clock()
        if isinstance(event, SessionChanged):
            if event.change.state is not None:
                session.push(SessionStateChanged(now_ms, event.session_id, event.change.state, event.change.reason))
            session.settle(event.change.state)
        elif isinstance(event, SessionLost):
            session.push(SessionInterrupted(now_ms, event.session_id, event.detail))
            session.settle(None)
        else:
            del self._sessions[event.session_id]
            self._session_gone.set()
            if event.error is not None:
                session.push(SessionFailed(now_ms, event.session_id, event.error))
            session.ended(event.error)

    def _deliver(self, session: UwbSession, message: RangeData | DataReceive | DataTransferStatus) -> None:
        now_ms = self._clock()
        session_id = session.session_id
        if isinstance(message, RangeData):
            if not message.two_way and not message.one_way:
                session.push(RangingSilent(now_ms, session_id, message.sequence))
            for m in message.two_way:
                session.push(
                    RangeMeasurement(
                        now_ms,
                        session_id,
                        message.sequence,
                        m.mac_address,
                        m.status,
                        m.range_mm,
                        m.obstructed,
                        m.rssi_dbm,
                    )
                )
            for blink in message.one_way:
                if blink.frame_type == FrameType.BLINK:  # what keeps the anchors' clocks together is their own affair
                    session.push(
                        FrameStamped(
                            now_ms,
                            session_id,
                            blink.mac_address & 0xFFFF,
                            blink.frame_number,
                            blink.timestamp_ticks,
                            blink.obstructed,
                            blink.blink_payload,
                        )
                    )
        elif isinstance(message, DataReceive):
            if message.data and message.status == Status.OK:  # nodes send empty ones when there was nothing to hear
                session.push(DataReceived(now_ms, session_id, message.source & 0xFFFF, message.data))
        elif message.status not in _DATA_SENT:
            session.push(DataFailed(now_ms, session_id, message.sequence, message.status))

    def _set_detail(self, detail: str) -> None:
        if detail == self.detail:
            return
        was_ready, self.detail = self.is_ready, detail
        self._status_changed.set()
        if was_ready != self.is_ready:
            _log.info("%s: %s", self.name, detail or "ready")
            if self._on_status is not None:
                self._on_status(self.is_ready, detail)
