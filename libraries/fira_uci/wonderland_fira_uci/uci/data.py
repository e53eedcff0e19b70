"""In-band data: sending, hearing, credits and transfer status (FiRa UCI, "Data packets", groups 0/2 data opcodes)."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from wonderland_fira_uci.uci.errors import UciDecodeError, UciEncodeError

_SEND: Final = struct.Struct("<IQHH")
SEND_HEADER_OCTETS: Final = _SEND.size
"""Of a DATA_MESSAGE_SND, before its data."""
_RECEIVE: Final = struct.Struct("<IBQHH")
_CREDIT: Final = struct.Struct("<IB")
_TRANSFER: Final = struct.Struct("<IBBB")
_TRANSFER_WIDE: Final = struct.Struct("<IHBB")


class DataSend(NamedTuple):
    """Host → node: data for ``destination`` (a short address in the low 16 bits)."""

    handle: int
    destination: int
    sequence: int
    data: bytes


class DataReceive(NamedTuple):
    """Node → host: data heard from ``source``. The sequence may always be 1 and the data empty."""

    handle: int
    status: int
    source: int
    sequence: int
    data: bytes


class DataCredit(NamedTuple):
    """Node → host: how many data packets it would take now."""

    handle: int
    credits: int


class DataTransferStatus(NamedTuple):
    """Node → host: what became of a data packet; success may never be reported."""

    handle: int
    sequence: int
    status: int
    transmissions: int


def encode_data_send(message: DataSend) -> bytes:
    """Payload of a DATA_MESSAGE_SND packet."""
    return _pack("DATA_MESSAGE_SND", _SEND, *message[:3], len(message.data)) + message.data


def decode_data_send(payload: bytes) -> DataSend:
    """Raises ``UciDecodeError``."""
    handle, destination, sequence, length = _unpack("DATA_MESSAGE_SND", _SEND, payload)
    return DataSend(handle, destination, sequence, _tail("DATA_MESSAGE_SND", payload, _SEND.size, length))


def encode_data_receive(message: DataReceive) -> bytes:
    """Payload of a DATA_MESSAGE_RCV packet."""
    return _pack("DATA_MESSAGE_RCV", _RECEIVE, *message[:4], len(message.data)) + message.data


def decode_data_receive(payload: bytes) -> DataReceive:
    """Raises ``UciDecodeError``."""
    handle, status, source, sequence, length = _unpack("DATA_MESSAGE_RCV", _RECEIVE, payload)
    return DataReceive(handle, status, source, sequence, _tail("DATA_MESSAGE_RCV", payload, _RECEIVE.size, length))


def encode_data_credit(message: DataCredit) -> bytes:
    """Payload of SESSION_DATA_CREDIT_NTF."""
    return _pack("SESSION_DATA_CREDIT_NTF", _CREDIT, *message)


def decode_data_credit(payload: bytes) -> DataCredit:
    """Raises ``UciDecodeError``."""
    return DataCredit(*_unpack("SESSION_DATA_CREDIT_NTF", _CREDIT, payload))


def encode_data_transfer_status(message: DataTransferStatus) -> bytes:
    """Payload of SESSION_DATA_TRANSFER_STATUS_NTF with an 8-bit sequence number (UCI 1.1)."""
    return _pack("SESSION_DATA_TRANSFER_STATUS_NTF", _TRANSFER, *message)


def decode_data_transfer_status(payload: bytes) -> DataTransferStatus:
    """Accepts an 8-bit (7 octets, UCI 1.1) and a 16-bit sequence number (8 octets, UCI 2); ``UciDecodeError``."""
    layout = _TRANSFER_WIDE if len(payload) == _TRANSFER_WIDE.size else _TRANSFER
    if len(payload) != layout.size:
        raise UciDecodeError(f"SESSION_DATA_TRANSFER_STATUS_NTF: {len(payload)} octets where 7 or 8 are expected")
    return DataTransferStatus(*layout.unpack(payload))


def _pack(name: str, layout: struct.Struct, *fields: int | bytes) -> bytes:
    try:
        return layout.pack(*fields)
    except struct.error as error:
        raise UciEncodeError(f"{name}: {error}") from error


def _unpack(name: str, layout: struct.Struct, payload: bytes) -> tuple[int, ...]:
    if len(payload) < layout.size:
        raise UciDecodeError(f"{name}: {len(payload)} octets; at least {layout.size} are expected")
    return layout.unpack_from(payload)


def _tail(name: str, payload: bytes, at: int, length: int) -> bytes:
    if len(payload) - at != length:
        raise UciDecodeError(f"{name}: it announces {length} octets of data and carries {len(payload) - at}")
    return payload[at:]
