"""A virtual UWB node: the device side of UCI, with the manners and faults of real ones. No I/O of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland_fira_uci.uci.codec import DeviceCodec, MalformedMessage
from wonderland_fira_uci.uci.config import (
    AppConfig,
    DeviceType,
    ParameterId,
    RangingUsage,
    SessionConfig,
    UciParameterError,
    encode_parameters,
    least_slots,
)
from wonderland_fira_uci.uci.data import (
    DataCredit,
    DataReceive,
    DataSend,
    DataTransferStatus,
    encode_data_credit,
    encode_data_receive,
    encode_data_transfer_status,
)
from wonderland_fira_uci.uci.errors import UciDecodeError
from wonderland_fira_uci.uci.packets import DataFormat, Group, MessageType, encode_control, encode_data
from wonderland_fira_uci.uci.ranging import (
    MeasurementType,
    OneWayMeasurement,
    RangeData,
    TwoWayMeasurement,
    encode_range_data,
)
from wonderland_fira_uci.uci.session import (
    Command,
    Core,
    DeviceInfo,
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

MAX_SESSIONS: Final = 8
RSTU_PER_MS: Final = 1200
CAPABILITIES: Final[tuple[tuple[int, bytes], ...]] = (
    (0x00, b"\xef\x07"),
    (0x01, b"\xff\x00"),
    (0x02, b"\x01\x01\x02\x00"),
    (0x03, b"\x01\x01\x02\x00"),
    (0x04, b"\x03"),
    (0x05, b"\x1f\x00"),
    (0x06, b"\x1f\x00"),
    (0x07, b"\x1f"),
    (0x08, b"\x03"),
    (0x09, b"\x02"),
    (0x0A, b"\x03"),
    (0x0E, b"\xff"),
    (0x0F, b"\x0b"),
    (0x11, b"\x3f"),
)
"""As since UCI 2: every role and method that a proof needs, uplink time stamps with them."""
# What the nodes of `uwb.md` accept; any other id is answered as malformed.
SUPPORTED: Final = frozenset(ParameterId)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """Ways in which nodes differ from each other and from the standard.

    ``drift``: relative error of the interval (0.005: one millisecond in 200). ``handle_offset``: the session handle
    differs from the id by that much (UCI 2). ``report_failures``: a peer that is not heard is reported with an error
    status, else it is missing. ``empty_data``: an empty data packet every round. ``transfer_status``: success of data
    is reported. ``max_data_octets``, ``frames_per_round``, ``data_queue``: limits of in-band data. ``no_ready``: no
    device READY after a reset. ``keeps_duplicate``: a second INIT does not remove the session.
    """

    drift: float = 0.0
    handle_offset: int = 0
    report_failures: bool = True
    empty_data: bool = False
    transfer_status: bool = False
    max_data_octets: int = 84
    frames_per_round: int = 4
    data_queue: int = 4
    no_ready: bool = False
    keeps_duplicate: bool = False
    knows_get_state: bool = True


class NodeSession:
    """One session on a virtual node."""

    def __init__(self, node: VirtualNode, session_id: int, session_type: int) -> None:
        self.node = node
        self.session_id = session_id
        self.session_type = session_type
        self.handle = (session_id + node.quirks.handle_offset) & 0xFFFFFFFF
        self.state = SessionState.INIT
        self.parameters: dict[int, bytes] = {}
        self.config: SessionConfig | None = None
        self.sequence = 0
        self.blink_payload = b""
        self._data: deque[tuple[int, int, bytes]] = deque()

    @property
    def app(self) -> AppConfig:
        """The configuration; only for sessions that were configured."""
        assert self.config is not None
        return self.config.app

    def queue_data(self, message: DataSend) -> TransferStatus:
        """Takes data for the next round, or says why not."""
        if self.session_type == SessionType.RANGING:
            return TransferStatus.SESSION_TYPE_NOT_SUPPORTED
        if self.state is not SessionState.ACTIVE:
            return TransferStatus.REJECTED
        if len(message.data) > self.node.quirks.max_data_octets:
            return TransferStatus.INVALID_FORMAT
        if len(self._data) >= self.node.quirks.data_queue:
            return TransferStatus.NO_CREDIT
        self._data.append((message.destination & 0xFFFF, message.sequence, message.data))
        return TransferStatus.OK

    @property
    def credits(self) -> int:
        """1 while another data packet would be taken."""
        return int(len(self._data) < self.node.quirks.data_queue)

    def take_data(self) -> list[tuple[int, bytes]]:
        """What goes on air in this round, as (destination, data)."""
        if not self._data:
            return []
        had_credit = bool(self.credits)
        out: list[tuple[int, bytes]] = []
        while self._data and len(out) < self.node.quirks.frames_per_round:
            destination, sequence, data = self._data.popleft()
            out.append((destination, data))
            if self.node.quirks.transfer_status:
                self.node.notify_transfer(self.handle, sequence, TransferStatus.OK)
        if not had_credit:
            self.node.notify_credit(self)
        return out

    def report(self, records: list[TwoWayMeasurement], received: DataReceive | None) -> None:
        """The end of a round at this node's port."""
        if self.state is not SessionState.ACTIVE or self.node.sessions.get(self.handle) is not self:
            return
        if not self.node.quirks.report_failures:
            records = [r for r in records if r.status == Status.OK]
        out = b""
        if received is not None:
            out = encode_data(DataFormat.RECEIVE, encode_data_receive(received))
        out += self._notification(MeasurementType.TWO_WAY, two_way=tuple(records))
        self.node.transmit(out)

    def report_blink(self, records: tuple[OneWayMeasurement, ...]) -> None:
        """What this anchor time-stamped of one blink."""
        if self.state is SessionState.ACTIVE and self.node.sessions.get(self.handle) is self:
            self.node.transmit(self._notification(MeasurementType.ONE_WAY, one_way=records))

    def _notification(
        self,
        kind: MeasurementType,
        *,
        two_way: tuple[TwoWayMeasurement, ...] = (),
        one_way: tuple[OneWayMeasurement, ...] = (),
    ) -> bytes:
        report = RangeData(self.sequence, self.handle, 0, self.app.interval_ms, kind, 0, two_way, one_way)
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        payload = encode_range_data(report)
        return encode_control(MessageType.NOTIFICATION, Group.SESSION_CONTROL, SessionControlOp.START, payload)


class VirtualNode:
    """The node: feed ``receive`` with what the host wrote; it calls ``transmit`` with what the host shall read."""

    def __init__(self, name: str, air: Air, *, quirks: Quirks | None = None) -> None:
        self.name = name
        self.air = air
        self.quirks = quirks or Quirks()
        self.sessions: dict[int, NodeSession] = {}
        self.transmit: Callable[[bytes], None] = lambda _octets: None
        self._codec = DeviceCodec()
        self._was_reset = False
        self._state = DeviceState.READY

    def power_on(self) -> None:
        """Boots; the host sees device READY."""
        self.power_off()
        self.transmit(encode_device_status(DeviceState.READY))

    def power_off(self) -> None:
        """Loses everything."""
        for session in list(self.sessions.values()):
            self._remove(session, announce=False)
        self._codec = DeviceCodec()
        self._was_reset = False
        self._state = DeviceState.READY

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
        self.power_off()
        self._was_reset = True
        self._answer(command, Status.OK)
        if not self.quirks.no_ready:
            self.transmit(encode_device_status(DeviceState.READY))

    def _core(self, command: Command) -> None:
        if command.opcode == Core.GET_DEVICE_INFO:
            info = DeviceInfo(0x0002, 0x0002, 0x0002, 0x0001, b"")
            self.transmit(encode_device_info(info).encode())
        elif command.opcode == Core.GET_CAPS_INFO:
            self._answer(command, Status.OK, encode_parameters(list(CAPABILITIES)))
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
                self._answer(command, Status.OK)
                self._remove(session, announce=True)
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
        if len(self.sessions) >= MAX_SESSIONS:
            self._answer(command, Status.MAX_SESSIONS_EXCEEDED)
            return
        session = NodeSession(self, session_id, session_type)
        self.sessions[session.handle] = session
        handle = session.handle.to_bytes(4, "little") if self.quirks.handle_offset else b""
        self._answer(command, Status.OK, handle)
        self._announce(session, SessionState.INIT)

    def _configure(self, command: Command) -> None:
        handle, parameters = decode_set_app_config(command.payload)
        session = self._named(command, handle.to_bytes(4, "little"))
        if session is None:
            return
        if session.state is SessionState.ACTIVE:
            self._answer(command, Status.SESSION_ACTIVE)
            return
        if any(identifier not in SUPPORTED for identifier, _ in parameters):
            self._malformed(command)
            return
        merged = session.parameters | dict(parameters)
        order = list(merged)
        try:
            for address in (ParameterId.DEVICE_MAC_ADDRESS, ParameterId.DST_MAC_ADDRESS):
                if address in merged and ParameterId.MAC_ADDRESS_MODE not in order[: order.index(address)]:
                    raise UciParameterError(address, Status.INVALID_PARAMETER, "the address mode must come before")  # noqa: TRY301 - one answer for all
            app = AppConfig.from_parameters(list(merged.items()))
            if app.ranging_usage in (RangingUsage.DS_TWR_DEFERRED, RangingUsage.SS_TWR_DEFERRED):
                needed = least_slots(len(app.destination_macs), app.round_control)
                if app.device_type is DeviceType.CONTROLLER and app.slots_per_round < needed:
                    why = f"{needed} slots are needed"
                    raise UciParameterError(ParameterId.SLOTS_PER_RR, Status.INVALID_PARAMETER, why)  # noqa: TRY301 - one answer for all
            if app.slots_per_round * app.slot_duration_rstu > app.interval_ms * RSTU_PER_MS:
                why = "the round does not fit"
                raise UciParameterError(ParameterId.RANGING_INTERVAL, Status.INVALID_PARAMETER, why)  # noqa: TRY301 - one answer for all
        except UciParameterError as error:
            if error.status is not Status.SESSION_NOT_CONFIGURED:
                refusal = encode_config_refusal(Status.INVALID_PARAMETER, {error.parameter: error.status})
                self.transmit(refusal.encode())
                return
            session.config = None  # accepted all the same; START will fail
        else:
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
