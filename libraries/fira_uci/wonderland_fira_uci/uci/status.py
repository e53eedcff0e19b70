"""Status, state and reason codes of UCI (FiRa UWB Command Interface Generic Technical Specification, status codes)."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Status octet of responses, of measurements and of data transfers.

    A node may send a code that is not listed here; ``status_name`` names any octet.
    """

    OK = 0x00
    REJECTED = 0x01
    FAILED = 0x02
    SYNTAX_ERROR = 0x03
    INVALID_PARAMETER = 0x04
    INVALID_RANGE = 0x05
    INVALID_MESSAGE_SIZE = 0x06
    UNKNOWN_GID = 0x07
    UNKNOWN_OID = 0x08
    READ_ONLY = 0x09
    MESSAGE_RETRY = 0x0A
    UNKNOWN = 0x0B
    NOT_APPLICABLE = 0x0C
    SESSION_NOT_EXIST = 0x11
    SESSION_DUPLICATE = 0x12
    SESSION_ACTIVE = 0x13
    MAX_SESSIONS_EXCEEDED = 0x14
    SESSION_NOT_CONFIGURED = 0x15
    ACTIVE_SESSIONS_ONGOING = 0x16
    MULTICAST_LIST_FULL = 0x17
    ADDRESS_NOT_FOUND = 0x18
    ADDRESS_ALREADY_PRESENT = 0x19
    INITIATION_TIME_TOO_OLD = 0x1A
    NEGATIVE_DISTANCE = 0x1B
    RANGING_TX_FAILED = 0x20
    RANGING_RX_TIMEOUT = 0x21
    RANGING_RX_PHY_DECODE_FAILED = 0x22
    RANGING_RX_PHY_TOA_FAILED = 0x23
    RANGING_RX_PHY_STS_FAILED = 0x24
    RANGING_RX_MAC_DECODE_FAILED = 0x25
    RANGING_RX_MAC_IE_DECODE_FAILED = 0x26
    RANGING_RX_MAC_IE_MISSING = 0x27
    DATA_MAX_TX_SIZE_EXCEEDED = 0x30
    DATA_RX_CRC_ERROR = 0x31


def status_name(code: int) -> str:
    """``"INVALID_PARAMETER (0x04)"``, or ``"status 0x7f"`` for a code outside the standard."""
    try:
        return f"{Status(code).name} (0x{code:02x})"
    except ValueError:
        return f"status 0x{code:02x}"


class DeviceState(IntEnum):
    """State octet of CORE_DEVICE_STATUS_NTF."""

    READY = 0x01
    ACTIVE = 0x02
    ERROR = 0xFF


class SessionState(IntEnum):
    """State octet of SESSION_STATUS_NTF and of the SESSION_GET_STATE response."""

    INIT = 0x00
    DEINIT = 0x01
    ACTIVE = 0x02
    IDLE = 0x03


class SessionType(IntEnum):
    """Type octet of SESSION_INIT."""

    RANGING = 0x00
    RANGING_WITH_DATA = 0x01
    DATA = 0x02


class TransferStatus(IntEnum):
    """Status octet of SESSION_DATA_TRANSFER_STATUS_NTF."""

    REPETITION_OK = 0x00
    OK = 0x01
    DATA_TRANSFER_ERROR = 0x02
    NO_CREDIT = 0x03
    REJECTED = 0x04
    SESSION_TYPE_NOT_SUPPORTED = 0x05
    DATA_TRANSFER_IN_PROGRESS = 0x06
    INVALID_FORMAT = 0x07
