"""One node as the host drives it: boot, commands one at a time, several sessions, recovery. Sans-I/O, time injected.

Port up → RESET → device information → capabilities → ready; then each session by its own ``SessionMachine``. A
command that gets no answer, a device error, a port that vanishes: the node counts as having lost everything, and
everything is done again. The owner calls an input (``port_up``, ``receive_data``, ``advance`` …), then writes
``data_to_send()``, reads ``events()`` and calls ``advance`` again at ``next_timeout_ms()``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from wonderland_fira_uci.uci.capabilities import Capabilities, decode_capabilities
from wonderland_fira_uci.uci.codec import HostCodec, MalformedMessage
from wonderland_fira_uci.uci.config import SessionConfig
from wonderland_fira_uci.uci.data import DataCredit, DataReceive, DataSend, DataTransferStatus
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
from wonderland_fira_uci.uci.errors import UciDecodeError, UciStateError
from wonderland_fira_uci.uci.ranging import RangeData
from wonderland_fira_uci.uci.session import (
    Command,
    DeviceInfo,
    DeviceStatus,
    GenericError,
    Response,
    SessionStatus,
    capabilities_command,
    decode_device_info,
    device_info_command,
    reset_command,
    set_config_command,
)
from wonderland_fira_uci.uci.session_machine import SessionMachine, StateChanged
from wonderland_fira_uci.uci.status import DeviceState, Status, status_name

MAX_MESSAGE_RETRIES: Final = 3
MAX_DATA_OCTETS: Final = 2031


@dataclass(frozen=True, slots=True, kw_only=True)
class Timings:
    """Milliseconds to wait. ``backoff_ms`` doubles up to ``backoff_max_ms`` while a node does not answer RESET."""

    command_ms: int = 800
    reset_ms: int = 500
    ready_ms: int = 500
    backoff_ms: int = 250
    backoff_max_ms: int = 5_000
    quiet_ms: int = 30
    incomplete_ms: int = 200
    desynchronised_ms: int = 2_000
    silence_ms: int = 2_000
    alive_ms: int = 1_500
    """A node that has said nothing for so long is asked for its information: whoever does not answer hangs."""


class Phase(Enum):
    """Where the node is on its way to ready."""

    DOWN = auto()
    BACKOFF = auto()
    RESETTING = auto()
    AWAITING_READY = auto()
    INFO = auto()
    CAPABILITIES = auto()
    SETTINGS = auto()
    READY = auto()


class UciDevice:
    """The host's view of one node."""

    def __init__(self, timings: Timings | None = None, settings: Sequence[tuple[bytes, bytes]] = ()) -> None:
        """``settings``: (id, value) that the node is given after each reset (CORE_SET_CONFIG)."""
        self.timings = timings or Timings()
        self._settings = set_config_command(settings) if settings else None
        self.phase = Phase.DOWN
        self.info: DeviceInfo | None = None
        self.capabilities: Capabilities | None = None
        self._codec = HostCodec()
        self._events: list[DeviceEvent] = []
        self._sessions: dict[int, SessionMachine] = {}
        self._by_handle: dict[int, SessionMachine] = {}
        self._command: Command | None = None
        self._command_session: SessionMachine | None = None
        self._command_deadline_ms = 0
        self._command_retries = 0
        self._phase_deadline_ms = 0
        self._backoff_ms = self.timings.backoff_ms
        self._ready_heard = False
        self._received_ms = 0
        self._asks_alive = False
        self._desynchronised_ms: int | None = None
        self._handlers: dict[type, Callable[..., None]] = {
            RangeData: self._on_report,
            Response: self._on_response,
            SessionStatus: self._on_session_status,
            DeviceStatus: self._on_device_status,
            GenericError: self._on_generic_error,
            DataReceive: self._on_session_message,
            DataTransferStatus: self._on_session_message,
            DataCredit: self._on_credit,
            MalformedMessage: self._on_malformed,
        }

    # Inputs

    def port_up(self, now_ms: int) -> None:
        """The port is open: reset the node and begin."""
        self._backoff_ms = self.timings.backoff_ms
        self._begin(now_ms)

    def port_down(self, detail: str) -> None:
        """The port is gone."""
        if self.phase is not Phase.DOWN:
            self._lose(detail)
        self.phase = Phase.DOWN
        self._codec = HostCodec()

    def receive_data(self, data: bytes, now_ms: int) -> None:
        """Octets from the port; during the pause before a reset they mean nothing."""
        if self.phase in (Phase.DOWN, Phase.BACKOFF):
            return
        self._received_ms = now_ms
        self._asks_alive = False
        self._codec.receive_data(data)
        for event in self._codec.events():
            handler = self._handlers.get(type(event))
            if handler is not None:
                handler(event, now_ms)
        if self._codec.reader.desynchronised and self._desynchronised_ms is None:
            self._desynchronised_ms = now_ms
        self._pump(now_ms)

    def advance(self, now_ms: int) -> None:
        """Lets time pass; call at ``next_timeout_ms`` and whenever convenient."""
        if self.phase is Phase.DOWN:
            return
        self._check_stream(now_ms)
        if self.phase is Phase.BACKOFF and now_ms >= self._phase_deadline_ms:
            self._begin(now_ms)
        elif self.phase is Phase.AWAITING_READY and now_ms >= self._phase_deadline_ms:
            self._next_phase(Phase.INFO)
        elif self._command is not None and now_ms >= self._command_deadline_ms:
            self._fail(f"{self._command.name} was not answered within {self._command_limit_ms()} ms", now_ms)
        for session in self._sessions.values():
            if session.advance(now_ms):
                self._events.append(CreditGranted(session.session_id))
            if session.active and now_ms - session.heard_ms >= self._silence_ms(session):
                session.heard_ms = now_ms
                session.verify()
        if self.phase is Phase.READY and now_ms - self._received_ms >= self.timings.alive_ms:
            self._asks_alive = True
        self._pump(now_ms)

    def open_session(self, config: SessionConfig, now_ms: int) -> None:
        """Sets a session up as soon as the node is ready; ``SessionChanged`` to ACTIVE or ``SessionEnded`` follows.

        Raises ``UciStateError`` when the session id is in use here.
        """
        if config.session_id in self._sessions:
            raise UciStateError(f"session {config.session_id:#010x} is already open on this node")
        self._sessions[config.session_id] = SessionMachine(config, self._sessions.get)
        self._pump(now_ms)

    def close_session(self, session_id: int, now_ms: int) -> None:
        """STOP and DEINIT; ``SessionEnded`` follows, at once when the node is away."""
        session = self._sessions.get(session_id)
        if session is None:
            return
        session.close()
        if self.phase in (Phase.DOWN, Phase.BACKOFF):
            session.forget()
            self._reap()
        else:
            self._pump(now_ms)

    def is_closing(self, session_id: int) -> bool:
        """Whether a session of that id is still being taken down; ``SessionEnded`` follows."""
        session = self._sessions.get(session_id)
        return session is not None and not session.wanted

    def credit_timeouts(self, session_id: int) -> int:
        """How many data packets running the node has given no credit back for."""
        session = self._sessions.get(session_id)
        return 0 if session is None else session.credit_timeouts

    def has_credit(self, session_id: int) -> bool:
        """Whether ``send_data`` would be taken."""
        session = self._sessions.get(session_id)
        return session is not None and session.active and session.credit

    def send_data(self, session_id: int, destination: int, data: bytes, now_ms: int) -> None:
        """Hands one data packet to the node; raises ``UciStateError`` without an active session or credit."""
        if not 0 < len(data) <= MAX_DATA_OCTETS:
            raise UciStateError(f"{len(data)} octets of data; 1 to {MAX_DATA_OCTETS} can be sent")
        session = self._sessions.get(session_id)
        if session is None or not self.has_credit(session_id):
            raise UciStateError(f"session {session_id:#010x} is not active or has no credit; wait for CreditGranted")
        sequence = session.spend_credit(now_ms)
        limit = None if self.capabilities is None else self.capabilities.max_data_payload_octets
        self._codec.send_data(DataSend(session.handle, destination, sequence, data), limit)

    # Outputs

    def events(self) -> list[DeviceEvent]:
        """What happened since the last call."""
        out = self._events
        self._events = []
        return out

    def data_to_send(self) -> bytes:
        """Octets for the port since the last call."""
        return self._codec.data_to_send()

    def next_timeout_ms(self) -> int | None:
        """When ``advance`` must be called at the latest; None while the port is down."""
        if self.phase is Phase.DOWN:
            return None
        times: list[int] = []
        if self.phase in (Phase.BACKOFF, Phase.AWAITING_READY):
            times.append(self._phase_deadline_ms)
        if self._command is not None:
            times.append(self._command_deadline_ms)
        elif self.phase is Phase.READY:
            times.append(self._received_ms + self.timings.alive_ms)
        reader = self._codec.reader
        if reader.desynchronised:
            times.append(self._received_ms + self.timings.quiet_ms)
        elif reader.incomplete:
            times.append(self._received_ms + self.timings.incomplete_ms)
        for session in self._sessions.values():
            due_ms = session.next_timeout_ms()
            if due_ms is not None:
                times.append(due_ms)
            if session.active:
                times.append(session.heard_ms + self._silence_ms(session))
        return min(times, default=None)

    # Boot and recovery

    def _begin(self, now_ms: int) -> None:
        self._codec = HostCodec()
        self._desynchronised_ms = None
        self._ready_heard = False
        self.phase = Phase.RESETTING
        self._command = None
        self._pump(now_ms)

    def _next_phase(self, phase: Phase) -> None:
        self.phase = phase
        if phase is Phase.READY:
            self._backoff_ms = self.timings.backoff_ms
            self._events.append(DeviceReady(self.info))

    def _fail(self, detail: str, now_ms: int) -> None:
        """The node cannot be relied on: forget everything, and reset it, after a pause that grows."""
        self._lose(detail)
        self._codec.reader.reset()
        self.phase = Phase.BACKOFF
        self._phase_deadline_ms = now_ms + self._backoff_ms
        self._backoff_ms = min(2 * self._backoff_ms, self.timings.backoff_max_ms)

    def _lose(self, detail: str) -> None:
        self._command = self._command_session = None
        self._events.append(DeviceLost(detail))
        self._by_handle.clear()
        for session in self._sessions.values():
            if session.forget():
                self._events.append(SessionLost(session.session_id, detail))
        self._reap()

    def _check_stream(self, now_ms: int) -> None:
        reader = self._codec.reader
        if reader.desynchronised:
            started_ms = self._desynchronised_ms if self._desynchronised_ms is not None else now_ms
            if now_ms - self._received_ms < self.timings.quiet_ms:
                if now_ms - started_ms >= self.timings.desynchronised_ms:
                    self._events.append(StreamResynchronised(reader.reset()))
                    self._fail("the line carries nothing but garbage; check baud rate and firmware", now_ms)
                return
        elif not reader.incomplete or now_ms - self._received_ms < self.timings.incomplete_ms:
            return
        self._desynchronised_ms = None
        self._events.append(StreamResynchronised(reader.reset()))
        for session in self._sessions.values():  # a notification may have been among what was thrown away
            session.verify()

    # Commands

    def _command_limit_ms(self) -> int:
        return self.timings.reset_ms if self.phase is Phase.RESETTING else self.timings.command_ms

    def _pump(self, now_ms: int) -> None:
        """Sends the next command if none is under way: at most one at a time, as the standard wants."""
        while self._command is None:
            command: Command | None = None
            session: SessionMachine | None = None
            if self.phase is Phase.RESETTING:
                command = reset_command()
            elif self.phase is Phase.INFO:
                command = device_info_command()
            elif self.phase is Phase.CAPABILITIES:
                command = capabilities_command()
            elif self.phase is Phase.SETTINGS:
                command = self._settings
            elif self.phase is Phase.READY:
                for session in self._sessions.values():
                    command = session.next_command(now_ms)
                    if command is not None:
                        break
                self._reap()
                if command is None and self._asks_alive:
                    self._asks_alive, session, command = False, None, device_info_command()
            if command is None:
                return
            self._command, self._command_session, self._command_retries = command, session, 0
            self._transmit(now_ms)

    def _transmit(self, now_ms: int) -> None:
        assert self._command is not None
        self._command_deadline_ms = now_ms + self._command_limit_ms()
        self._codec.send_command(self._command)

    def _reap(self) -> None:
        for session_id in [i for i, s in self._sessions.items() if s.ended]:
            session = self._sessions.pop(session_id)
            self._by_handle = {h: s for h, s in self._by_handle.items() if s is not session}
            self._events.append(SessionEnded(session_id, session.error))

    def _silence_ms(self, session: SessionMachine) -> int:
        return max(self.timings.silence_ms, 10 * session.config.app.interval_ms)

    # What the node says

    def _on_response(self, response: Response, now_ms: int) -> None:
        command, session = self._command, self._command_session
        if command is None or (response.group, response.opcode) != (command.group, command.opcode):
            # A late answer, but for a node that refuses a whole group: it answers with that group's number.
            if command is None or response.group != command.group or response.status != Status.UNKNOWN_GID:
                return
            response = Response(command.group, command.opcode, response.status, response.body)
        if response.status == Status.MESSAGE_RETRY and self._command_retries < MAX_MESSAGE_RETRIES:
            self._command_retries += 1
            self._transmit(now_ms)
            return
        self._command = self._command_session = None
        if session is not None:
            self._report_change(session, session.on_response(response, now_ms))
            self._by_handle[session.handle] = session
        elif self.phase is Phase.RESETTING:
            if response.status != Status.OK:
                self._fail(f"CORE_RESET was answered by {status_name(response.status)}", now_ms)
            elif self._ready_heard:
                self._next_phase(Phase.INFO)
            else:
                self._phase_deadline_ms = now_ms + self.timings.ready_ms
                self._next_phase(Phase.AWAITING_READY)
        elif self.phase is Phase.INFO:
            try:
                self.info = decode_device_info(response.body) if response.status == Status.OK else None
            except UciDecodeError as error:
                self.info = None
                self._on_malformed(MalformedMessage(response.group, response.opcode, error), now_ms)
            self._next_phase(Phase.CAPABILITIES)
        elif self.phase is Phase.CAPABILITIES:
            self._on_capabilities(response, now_ms)
            self._next_phase(Phase.READY if self._settings is None else Phase.SETTINGS)
        elif self.phase is Phase.SETTINGS:
            if response.status != Status.OK:
                said = status_name(response.status)
                self._fail(f"CORE_SET_CONFIG (device_config) was answered by {said} {response.body.hex()}", now_ms)
                return
            self._next_phase(Phase.READY)

    def _on_capabilities(self, response: Response, now_ms: int) -> None:
        """A node whose answer cannot be read ranges all the same; what it can do is not known then."""
        self.capabilities = None
        if response.status != Status.OK:
            return
        try:
            self.capabilities = decode_capabilities(response.body, None if self.info is None else self.info.uci_version)
        except UciDecodeError as error:
            self._on_malformed(MalformedMessage(response.group, response.opcode, error), now_ms)

    def _on_device_status(self, status: DeviceStatus, now_ms: int) -> None:
        if status.state == DeviceState.READY:
            if self.phase is Phase.AWAITING_READY:
                self._next_phase(Phase.INFO)
            elif self.phase is Phase.RESETTING:
                self._ready_heard = True
            else:
                # READY ends the last active session, or follows a reboot: a session that should run may be gone.
                for session in self._sessions.values():
                    if session.active and session.wanted:
                        session.verify()
        elif status.state == DeviceState.ERROR and self.phase not in (Phase.RESETTING, Phase.BACKOFF):
            self._fail("the node reports a device error", now_ms)

    def _on_generic_error(self, error: GenericError, now_ms: int) -> None:
        if self._command is not None:
            self._on_response(Response(self._command.group, self._command.opcode, error.status, b""), now_ms)

    def _session(self, handle: int) -> SessionMachine | None:
        return self._by_handle.get(handle) or self._sessions.get(handle)

    def _on_session_status(self, status: SessionStatus, _now_ms: int) -> None:
        session = self._session(status.handle)
        if session is None and self._command_session is not None:
            # UCI 2 nodes may announce the new handle before the response has told it.
            session = self._command_session if self._command_session.state is None else None
        if session is not None:
            self._report_change(session, session.on_state(status.state, status.reason))

    def _report_change(self, session: SessionMachine, change: StateChanged | None) -> None:
        if change is None:
            return
        if change.state is not None and session.active:
            session.heard_ms = self._received_ms
        self._events.append(SessionChanged(session.session_id, change))
        if change.state is None and session.wanted:
            self._events.append(SessionLost(session.session_id, "the node no longer knows the session"))

    def _on_report(self, report: RangeData, now_ms: int) -> None:
        session = self._by_handle.get(report.handle) or self._sessions.get(report.handle)
        if session is not None:
            session.heard_ms = now_ms
            self._events.append(SessionMessage(session.session_id, report))

    def _on_session_message(self, message: DataReceive | DataTransferStatus, _now_ms: int) -> None:
        session = self._session(message.handle)
        if session is not None:
            self._events.append(SessionMessage(session.session_id, message))

    def _on_credit(self, credit: DataCredit, _now_ms: int) -> None:
        session = self._session(credit.handle)
        if session is not None:
            session.set_credit(granted=credit.credits > 0)
            if credit.credits:
                self._events.append(CreditGranted(session.session_id))

    def _on_malformed(self, message: MalformedMessage, _now_ms: int) -> None:
        self._events.append(message)
