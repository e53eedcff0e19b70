"""One session on a virtual node: its state, its configuration, the data that waits for its frames, its reports."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from wonderland_fira_uci.uci.airtime import frame_us, slot_us
from wonderland_fira_uci.uci.config import (
    AppConfig,
    ParameterId,
    RangingUsage,
    RframeConfig,
    SessionConfig,
    decode_time_base,
)
from wonderland_fira_uci.uci.data import DataReceive, DataSend, encode_data_receive
from wonderland_fira_uci.uci.packets import DataFormat, Group, MessageType, encode_control, encode_data
from wonderland_fira_uci.uci.ranging import (
    MeasurementType,
    OneWayMeasurement,
    RangeData,
    TwoWayMeasurement,
    encode_range_data,
)
from wonderland_fira_uci.uci.session import SessionControlOp
from wonderland_fira_uci.uci.status import SessionState, SessionType, Status, TransferStatus

if TYPE_CHECKING:
    from wonderland_simulator.uci_node.node import VirtualNode


class NodeSession:
    """What the node keeps of a session, under its handle."""

    def __init__(self, node: VirtualNode, session_id: int, session_type: int, handle: int) -> None:
        self.node = node
        self.session_id = session_id
        self.session_type = session_type
        self.handle = handle
        self.state = SessionState.INIT
        self.parameters: dict[int, bytes] = {}
        self.config: SessionConfig | None = None
        self.sequence = 0
        self.blink_payload = b""
        self.deinit_refused = False
        self._data: deque[tuple[int, int, bytes]] = deque()

    @property
    def app(self) -> AppConfig:
        """The configuration; only for sessions that were configured."""
        assert self.config is not None
        return self.config.app

    @property
    def carries_data(self) -> bool:
        """Whether its frames have a payload: SP3 frames end with their scrambled sequence."""
        return self.app.rframe_config is not RframeConfig.SP3 or self.node.quirks.data_in_sp3

    def queue_data(self, message: DataSend) -> TransferStatus:
        """Takes data for the next round, or says why not."""
        if self.session_type == SessionType.RANGING:
            return TransferStatus.SESSION_TYPE_NOT_SUPPORTED
        if self.state is not SessionState.ACTIVE or not self.carries_data:
            return TransferStatus.REJECTED
        if len(message.data) > self.node.quirks.max_data_octets or not self._fits(len(message.data)):
            return TransferStatus.INVALID_FORMAT
        if len(self._data) >= self.node.quirks.data_queue:
            return TransferStatus.NO_CREDIT
        self._data.append((message.destination & 0xFFFF, message.sequence, message.data))
        return TransferStatus.OK

    def _fits(self, octets: int) -> bool:
        """Into a slot of two-way ranging; a blink's payload is part of the blink."""
        profile = self.node.profile
        if not profile.checks_timing or self.app.ranging_usage is RangingUsage.UL_TDOA:
            return True
        needed_us = frame_us(self.app.rframe_config, octets) + profile.turn_us
        return needed_us <= slot_us(self.app.slot_duration_rstu)

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

    @property
    def time_base(self) -> tuple[int, int] | None:
        """(session id, µs) of the session whose blocks this one's follow, as long as the node has it."""
        value = self.parameters.get(ParameterId.SESSION_TIME_BASE)
        base = None if value is None or not self.node.quirks.obeys_time_base else decode_time_base(value)
        if base is None:
            return None
        other = self.node.sessions.get(base[0])
        return None if other is None else (other.session_id, base[1])

    def report(self, records: list[TwoWayMeasurement], received: list[DataReceive]) -> None:
        """The end of a round at this node's port."""
        if self.state is not SessionState.ACTIVE or self.node.sessions.get(self.handle) is not self:
            return
        if not self.node.quirks.report_failures:
            records = [r for r in records if r.status == Status.OK]
        out = b"".join(encode_data(DataFormat.RECEIVE, encode_data_receive(each)) for each in received)
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
