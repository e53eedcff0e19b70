"""A virtual UWB node: the device side of UCI, with the manners and faults of real ones. No I/O of its own."""

from __future__ import annotations

import random
from collections.abc import Callable

from wonderland_fira_uci.uci.codec import DeviceCodec, MalformedMessage
from wonderland_fira_uci.uci.config import (
    AppConfig,
    ParameterId,
    SessionConfig,
    UciParameterError,
    encode_parameters,
)
from wonderland_fira_uci.uci.data import (
    DataCredit,
    DataSend,
    DataTransferStatus,
    encode_data_credit,
    encode_data_transfer_status,
)
from wonderland_fira_uci.uci.errors import UciDecodeError
from wonderland_fira_uci.uci.packets import Group, MessageType, encode_control
from wonderland_fira_uci.uci.session import (
    Command,
    Core,
    Response,
    SessionConfigOp,
    SessionControlOp,
    SessionStatus,
    decode_handle,
    decode_init,
    decode_set_app_config,
    encode_config_refusal,
    encode_device_info,
    encode_device_status,
    encode_session_status,
)
from wonderland_fira_uci.uci.status import DeviceState, SessionState, SessionType, Status, TransferStatus
from wonderland_simulator.uci_node.air import Air
from wonderland_simulator.uci_node.profiles import DWM3001CDK, NodeProfile, Quirks
from wonderland_simulator.uci_node.refusals import accepted
from wonderland_simulator.uci_node.session import NodeSession


class VirtualNode:
    """The node: feed ``receive`` with what the host wrote; it calls ``transmit`` with what the host shall read."""

    def __init__(self, name: str, air: Air, *, profile: NodeProfile = DWM3001CDK, quirks: Quirks | None = None) -> None:
        """``quirks``: other manners than the profile's."""
        self.name = name
        self.air = air
        self.profile = profile
        self.quirks = quirks or profile.quirks
        self.drift = self.quirks.drift + random.Random(f"{name}/clock").uniform(-1, 1) * profile.clock_ppm / 1e6
        """How much too long the node takes for an interval."""
        self.sessions: dict[int, NodeSession] = {}
        self.transmit: Callable[[bytes], None] = lambda _octets: None
        self._codec = DeviceCodec()
        self._was_reset = False
        self._state = DeviceState.READY
        self._sessions_made = 0

    def become(self, profile: NodeProfile) -> None:
        """Another chip at the same port; whatever ran is gone."""
        self.power_off()
        self.profile, self.quirks = profile, profile.quirks

    def power_on(self) -> None:
        """Boots; the host sees device READY."""
        self.power_off()
        self.transmit(encode_device_status(DeviceState.READY))

    def power_off(self) -> None:
        """Lose sessions and settings, as a node whose supply fails."""
        for session in list(self.sessions.values()):
            self._remove(session, announce=False)
        self._codec = DeviceCodec()
        self._was_reset = False
        self._state = DeviceState.READY
        self._sessions_made = 0

    @property
    def is_in_use(self) -> bool:
        """Whether a host has reset it since it was plugged in, as every agent does first."""
        return self._was_reset

    @property
    def desynchronised(self) -> bool:
        """Whether the host's octets made no sense; ``resynchronise`` after a pause on the line."""
        return self._codec.reader.desynchronised or self._codec.reader.incomplete

    def resynchronise(self) -> None:
        """The line was quiet: start afresh with the next octet."""
        self._codec.reader.reset()

    def receive(self, data: bytes) -> None:
        """Octets from the host."""
        self._codec.receive_data(data)
        for event in self._codec.events():
            if isinstance(event, Command):
                self._command(event)
            elif isinstance(event, DataSend):
                self._send_data(event)
            else:
                assert isinstance(event, MalformedMessage)

    # Commands

    def _command(self, command: Command) -> None:
        if command.group == Group.CORE and command.opcode == Core.RESET:
            self._reset(command)
            return
        if not self._was_reset:
            self.transmit(encode_device_status(DeviceState.ERROR))
            return
        try:
            groups = {
                Group.CORE: self._core,
                Group.SESSION_CONFIG: self._session_config,
                Group.SESSION_CONTROL: self._session_control,
            }
            handler = groups.get(Group(command.group))
        except ValueError:
            handler = None
        if handler is None:
            self._answer(command, Status.UNKNOWN_GID)
            return
        try:
            handler(command)
        except UciDecodeError:
            self._malformed(command)

    def _answer(self, command: Command, status: int, body: bytes = b"") -> None:
        self.transmit(Response(command.group, command.opcode, status, body).encode())

    def _malformed(self, command: Command) -> None:
        """What nodes answer to anything that they do not understand: not the form that the standard wants."""
        self._answer(command, Status.REJECTED, bytes((Status.SYNTAX_ERROR,)))

    def _reset(self, command: Command) -> None:
        if len(command.payload) != 1:
            self._malformed(command)
            return
        if self.quirks.tells_cleared:
            for session in list(self.sessions.values()):
                self._remove(session, announce=True)
        self.power_off()
        self._was_reset = True
        if self.quirks.ready_first:
            self.transmit(encode_device_status(DeviceState.READY))
        self._answer(command, Status.OK)
        if not self.quirks.no_ready:
            self.transmit(encode_device_status(DeviceState.READY))
        for packet in self.quirks.vendor_notifications:
            self.transmit(packet)

    def _core(self, command: Command) -> None:
        if command.opcode == Core.GET_DEVICE_INFO:
            self.transmit(encode_device_info(self.profile.info).encode())
        elif command.opcode == Core.GET_CAPS_INFO:
            self._answer(command, Status.OK, encode_parameters(list(self.profile.capabilities)))
        else:
            self._malformed(command)

    def _session_config(self, command: Command) -> None:
        op = command.opcode
        if op == SessionConfigOp.INIT:
            self._init(command)
        elif op == SessionConfigOp.SET_APP_CONFIG:
            self._configure(command)
        elif op == SessionConfigOp.GET_APP_CONFIG:
            self._get_config(command)
        elif op == SessionConfigOp.GET_COUNT:
            self._answer(command, Status.OK, bytes((len(self.sessions),)))
        elif op == SessionConfigOp.DEINIT:
            session = self._named(command, command.payload)
            if session is not None:
                self._deinit(command, session)
        elif op == SessionConfigOp.GET_STATE and self.quirks.knows_get_state:
            session = self._named(command, command.payload)
            if session is not None:
                self._answer(command, Status.OK, bytes((session.state,)))
        elif op == SessionConfigOp.UPDATE_MULTICAST_LIST:
            self._multicast(command)
        else:
            self._malformed(command)

    def _named(self, command: Command, handle: bytes) -> NodeSession | None:
        session = self.sessions.get(decode_handle(command.name, handle))
        if session is None:
            self._answer(command, Status.SESSION_NOT_EXIST)
        return session

    def _init(self, command: Command) -> None:
        session_id, session_type = decode_init(command.payload)
        old = next((s for s in self.sessions.values() if s.session_id == session_id), None)
        if old is not None:
            if not self.quirks.keeps_duplicate:
                self._remove(old, announce=False)
            self._answer(command, Status.SESSION_DUPLICATE)
            return
        if len(self.sessions) >= self.profile.max_sessions:
            self._answer(command, Status.MAX_SESSIONS_EXCEEDED)
            return
        handle, told = self._handle_for(session_id)
        session = NodeSession(self, session_id, session_type, handle)
        self.sessions[handle] = session
        if self.quirks.announces_first:
            self._announce(session, SessionState.INIT)
        self._answer(command, Status.OK, handle.to_bytes(4, "little") if told else b"")
        if not self.quirks.announces_first:
            self._announce(session, SessionState.INIT)

    def _handle_for(self, session_id: int) -> tuple[int, bool]:
        """A new session's handle, and whether the host is told; in UCI 1 it is the session id."""
        if self.quirks.handles_from is not None:
            self._sessions_made += 1
            return self.quirks.handles_from + self._sessions_made - 1, True
        return (session_id + self.quirks.handle_offset) & 0xFFFFFFFF, bool(self.quirks.handle_offset)

    def _deinit(self, command: Command, session: NodeSession) -> None:
        if self.quirks.deinit_retry and not session.deinit_refused:
            session.deinit_refused = True
            payload = bytes((Status.MESSAGE_RETRY,))
            self.transmit(encode_control(MessageType.NOTIFICATION, Group.CORE, Core.GENERIC_ERROR, payload))
            return
        self._answer(command, Status.OK)
        self._remove(session, announce=True)

    def _configure(self, command: Command) -> None:
        handle, parameters = decode_set_app_config(command.payload)
        session = self._named(command, handle.to_bytes(4, "little"))
        if session is None:
            return
        if session.state is SessionState.ACTIVE:
            self._answer(command, Status.SESSION_ACTIVE)
            return
        refused: dict[int, int] = {i: Status.INVALID_PARAMETER for i, _ in parameters if i not in self.profile.known}
        if refused and not self.quirks.names_unknown:
            self._malformed(command)
            return
        merged = session.parameters | {i: value for i, value in parameters if i in self.profile.known}
        app = None
        try:
            app = accepted(self.profile, merged, self.sessions)
        except UciParameterError as error:
            if error.status is not Status.SESSION_NOT_CONFIGURED:
                refused[error.parameter] = error.status
        if refused:
            self.transmit(encode_config_refusal(Status.INVALID_PARAMETER, dict(sorted(refused.items()))).encode())
            return
        session.config = None  # accepted all the same where something is missing; START will fail
        if app is not None:
            session.config = SessionConfig(session_id=session.session_id, app=app, session_type=session.session_type)
        session.parameters = merged
        self.transmit(encode_config_refusal(Status.OK, {}).encode())
        if session.state is not SessionState.IDLE:
            session.state = SessionState.IDLE
            self._announce(session, SessionState.IDLE)

    def _get_config(self, command: Command) -> None:
        """The session key can be read back, as on some real stacks."""
        session = self._named(command, command.payload[:4])
        if session is None:
            return
        wanted = command.payload[5:]
        if len(command.payload) < 5 or command.payload[4] != len(wanted):
            raise UciDecodeError("SESSION_GET_APP_CONFIG: the count contradicts the length")
        known = [(i, session.parameters[i]) for i in wanted if i in session.parameters]
        self._answer(command, Status.OK if len(known) == len(wanted) else Status.FAILED, encode_parameters(known))

    def _multicast(self, command: Command) -> None:
        """Controlees cannot; a controller refuses to add who is there (08) or remove who is not (07)."""
        session = self._named(command, command.payload[:4])
        if session is None:
            return
        entries = command.payload[6:]
        if len(command.payload) < 6 or len(entries) != 6 * command.payload[5] or session.config is None:
            raise UciDecodeError("SESSION_UPDATE_CONTROLLER_MULTICAST_LIST: the count contradicts the length")
        if session.app.device_type != 1:
            self._answer(command, Status.REJECTED)
            return
        macs = list(session.app.destination_macs)
        for at in range(0, len(entries), 6):
            mac = int.from_bytes(entries[at : at + 2], "little")
            add = command.payload[4] == 0
            if add == (mac in macs):
                self._answer(command, Status.FAILED, bytes((0x08 if add else 0x07,)))
                return
            macs = [*macs, mac] if add else [m for m in macs if m != mac]
        if not macs:
            self._answer(command, Status.FAILED)
            return
        merged = session.parameters | {
            ParameterId.NUMBER_OF_CONTROLEES: bytes((len(macs),)),
            ParameterId.DST_MAC_ADDRESS: b"".join(mac.to_bytes(2, "little") for mac in macs),
        }
        app = AppConfig.from_parameters(list(merged.items()))
        session.parameters = merged
        session.config = SessionConfig(session_id=session.session_id, app=app, session_type=session.session_type)
        self._answer(command, Status.OK)

    def _session_control(self, command: Command) -> None:
        if command.opcode not in (SessionControlOp.START, SessionControlOp.STOP):
            self._malformed(command)
            return
        session = self._named(command, command.payload)
        if session is None:
            return
        if command.opcode == SessionControlOp.STOP:
            if session.state is not SessionState.ACTIVE:
                self._answer(command, Status.SESSION_ACTIVE)
                return
            self._answer(command, Status.OK)
            self._stop(session)
            self._announce(session, SessionState.IDLE)
            self._announce_device()
        elif session.state is SessionState.ACTIVE or session.config is None:
            self._answer(command, Status.SESSION_NOT_CONFIGURED)
        else:
            self._answer(command, Status.OK)
            session.state = SessionState.ACTIVE
            self._announce(session, SessionState.ACTIVE)
            self._announce_device()
            self.air.join(session)

    def _stop(self, session: NodeSession) -> None:
        if session.state is SessionState.ACTIVE:
            self.air.leave(session)
            session.state = SessionState.IDLE

    def _remove(self, session: NodeSession, *, announce: bool) -> None:
        self._stop(session)
        self.sessions.pop(session.handle, None)
        if announce:
            self._announce(session, SessionState.DEINIT)
            self._announce_device()

    def _announce(self, session: NodeSession, state: SessionState) -> None:
        self.transmit(encode_session_status(SessionStatus(session.handle, state, 0)))

    def _announce_device(self) -> None:
        active = any(s.state is SessionState.ACTIVE for s in self.sessions.values())
        state = DeviceState.ACTIVE if active else DeviceState.READY
        if state is not self._state:
            self._state = state
            self.transmit(encode_device_status(state))

    # Data

    def _send_data(self, message: DataSend) -> None:
        session = self.sessions.get(message.handle)
        status = TransferStatus.REJECTED if session is None else session.queue_data(message)
        if session is None or status is not TransferStatus.OK:
            self.notify_transfer(message.handle, message.sequence, status)
            if session is not None and session.session_type != SessionType.RANGING:
                self.notify_credit(session)
            return
        self.notify_credit(session)

    def notify_credit(self, session: NodeSession) -> None:
        """SESSION_DATA_CREDIT_NTF."""
        payload = encode_data_credit(DataCredit(session.handle, session.credits))
        self.transmit(
            encode_control(MessageType.NOTIFICATION, Group.SESSION_CONTROL, SessionControlOp.DATA_CREDIT, payload)
        )

    def notify_transfer(self, handle: int, sequence: int, status: int) -> None:
        """SESSION_DATA_TRANSFER_STATUS_NTF."""
        payload = encode_data_transfer_status(DataTransferStatus(handle, sequence & 0xFF, status, 1))
        op = SessionControlOp.DATA_TRANSFER_STATUS
        self.transmit(encode_control(MessageType.NOTIFICATION, Group.SESSION_CONTROL, op, payload))
