"""From octets to typed messages and back, for the host and for the device (the virtual node). Sans-I/O.

Use as with any sans-I/O protocol: ``receive_data`` with what came, ``events`` for what it means; ``send_…`` with
what shall be said, ``data_to_send`` for the octets of it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from wonderland_fira_uci.uci.data import (
    DataCredit,
    DataReceive,
    DataSend,
    DataTransferStatus,
    decode_data_credit,
    decode_data_receive,
    decode_data_send,
    decode_data_transfer_status,
    encode_data_send,
)
from wonderland_fira_uci.uci.errors import UciDecodeError
from wonderland_fira_uci.uci.packets import MAX_DATA_PAYLOAD, DataFormat, Group, MessageType, PacketReader, encode_data
from wonderland_fira_uci.uci.ranging import RangeData, decode_range_data
from wonderland_fira_uci.uci.session import (
    Command,
    Core,
    DeviceStatus,
    GenericError,
    Response,
    SessionConfigOp,
    SessionControlOp,
    SessionStatus,
    decode_device_status,
    decode_generic_error,
    decode_response,
    decode_session_status,
)


class UnknownMessage(NamedTuple):
    """A well-framed notification of no known kind (a vendor's own, or of a newer standard)."""

    group: int
    opcode: int
    payload: bytes


class MalformedMessage(NamedTuple):
    """A well-framed message whose payload contradicts itself; the stream goes on."""

    group: int
    opcode: int
    error: UciDecodeError


HostEvent = (
    Response
    | DeviceStatus
    | GenericError
    | SessionStatus
    | RangeData
    | DataReceive
    | DataCredit
    | DataTransferStatus
    | UnknownMessage
    | MalformedMessage
)
DeviceEvent = Command | DataSend | MalformedMessage

_NOTIFICATION: Final = MessageType.NOTIFICATION << 5
_RESPONSE: Final = MessageType.RESPONSE << 5
_DECODERS: Final[dict[tuple[int, int], Callable[[bytes], HostEvent]]] = {
    (_NOTIFICATION | Group.SESSION_CONTROL, SessionControlOp.START): decode_range_data,
    (_NOTIFICATION | Group.SESSION_CONTROL, SessionControlOp.DATA_CREDIT): decode_data_credit,
    (_NOTIFICATION | Group.SESSION_CONTROL, SessionControlOp.DATA_TRANSFER_STATUS): decode_data_transfer_status,
    (_NOTIFICATION | Group.SESSION_CONFIG, SessionConfigOp.STATUS): decode_session_status,
    (_NOTIFICATION | Group.CORE, Core.DEVICE_STATUS): decode_device_status,
    (_NOTIFICATION | Group.CORE, Core.GENERIC_ERROR): decode_generic_error,
    (DataFormat.RECEIVE, 0): decode_data_receive,
}


class HostCodec:
    """The host's end of the line."""

    def __init__(self) -> None:
        self.reader = PacketReader("host")
        self._out = bytearray()

    def receive_data(self, data: bytes) -> None:
        """Octets from the node."""
        self.reader.receive_data(data)

    def events(self) -> list[HostEvent]:
        """Messages completed since the last call."""
        out: list[HostEvent] = []
        for first, second, payload in self.reader.packets():
            decode = _DECODERS.get((first, second))
            try:
                if decode is not None:
                    out.append(decode(payload))
                elif first & 0xE0 == _RESPONSE:
                    out.append(decode_response(first & 0x0F, second, payload))
                else:
                    out.append(UnknownMessage(first & 0x0F, second, payload))
            except UciDecodeError as error:
                out.append(MalformedMessage(first & 0x0F, second, error))
        return out

    def send_command(self, command: Command) -> None:
        """Queues a command; the caller waits for its response before the next."""
        self._out += command.encode()

    def send_data(self, message: DataSend, limit: int | None = None) -> None:
        """Queues a data message, in packets of ``limit`` octets at most where the node says how much it takes."""
        self._out += encode_data(DataFormat.SEND, encode_data_send(message), limit or MAX_DATA_PAYLOAD)

    def data_to_send(self) -> bytes:
        """Octets for the node since the last call."""
        out = bytes(self._out)
        self._out.clear()
        return out


class DeviceCodec:
    """The node's end of the line; whole packets are queued with ``send``."""

    def __init__(self) -> None:
        self.reader = PacketReader("device")
        self._out = bytearray()

    def receive_data(self, data: bytes) -> None:
        """Octets from the host."""
        self.reader.receive_data(data)

    def events(self) -> list[DeviceEvent]:
        """Commands and data since the last call."""
        out: list[DeviceEvent] = []
        for first, second, payload in self.reader.packets():
            if first == DataFormat.SEND:
                try:
                    out.append(decode_data_send(payload))
                except UciDecodeError as error:
                    out.append(MalformedMessage(first, second, error))
            else:
                out.append(Command(first & 0x0F, second, payload))
        return out

    def send(self, packets: bytes) -> None:
        """Queues encoded packets."""
        self._out += packets

    def data_to_send(self) -> bytes:
        """Octets for the host since the last call."""
        out = bytes(self._out)
        self._out.clear()
        return out
