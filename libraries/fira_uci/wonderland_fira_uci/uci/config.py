"""Application configuration of a UCI session: named, typed, and in the order that real nodes accept.

Source: FiRa UCI, SESSION_SET_APP_CONFIG: a count octet, then ``id length value`` per parameter, integers
little-endian. Nodes parse in order, so the address mode comes before any address and the number of controlees
before their addresses.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final, Self

from wonderland_fira_uci.uci.errors import UciDecodeError, UciEncodeError
from wonderland_fira_uci.uci.status import Status


class DeviceType(IntEnum):
    """Who decides about the session (0x00)."""

    CONTROLEE = 0
    CONTROLLER = 1


class DeviceRole(IntEnum):
    """Who transmits first in a round (0x11)."""

    RESPONDER = 0
    INITIATOR = 1
    UT_SYNCHRONISATION_ANCHOR = 2
    UT_ANCHOR = 3
    UT_TAG = 4


class MultiNodeMode(IntEnum):
    """Topology (0x03)."""

    UNICAST = 0
    ONE_TO_MANY = 1


class RangingUsage(IntEnum):
    """Ranging method (0x01)."""

    UL_TDOA = 0
    SS_TWR_DEFERRED = 1
    DS_TWR_DEFERRED = 2
    SS_TWR = 3
    DS_TWR = 4


class StsConfig(IntEnum):
    """How the scrambled timestamp sequence is keyed (0x02). Static keys are public: useless as evidence."""

    STATIC = 0
    DYNAMIC = 1
    DYNAMIC_RESPONDER_KEY = 2
    PROVISIONED = 3
    PROVISIONED_RESPONDER_KEY = 4


class RframeConfig(IntEnum):
    """What a ranging frame is made of (0x12). Only SP0 and SP1 carry data; SP3 ends with its scrambled sequence."""

    SP0 = 0
    SP1 = 1
    SP3 = 3


class ScheduleMode(IntEnum):
    """Whether each frame has its slot (0x22), or whoever wants to speak contends for one."""

    CONTENTION = 0
    TIME_SCHEDULED = 1


class ParameterId(IntEnum):
    """Parameter ids, named as in the standard."""

    DEVICE_TYPE = 0x00
    RANGING_ROUND_USAGE = 0x01
    STS_CONFIG = 0x02
    MULTI_NODE_MODE = 0x03
    CHANNEL_NUMBER = 0x04
    NUMBER_OF_CONTROLEES = 0x05
    DEVICE_MAC_ADDRESS = 0x06
    DST_MAC_ADDRESS = 0x07
    SLOT_DURATION = 0x08
    RANGING_INTERVAL = 0x09
    STS_INDEX = 0x0A
    MAC_FCS_TYPE = 0x0B
    RANGING_ROUND_CONTROL = 0x0C
    AOA_RESULT_REQ = 0x0D
    RNG_DATA_NTF = 0x0E
    DEVICE_ROLE = 0x11
    RFRAME_CONFIG = 0x12
    RSSI_REPORTING = 0x13
    PREAMBLE_CODE_INDEX = 0x14
    SFD_ID = 0x15
    PSDU_DATA_RATE = 0x16
    SLOTS_PER_RR = 0x1B
    RESPONDER_SLOT_INDEX = 0x1E
    SCHEDULE_MODE = 0x22
    MAC_ADDRESS_MODE = 0x26
    VENDOR_ID = 0x27
    STATIC_STS_IV = 0x28
    NUMBER_OF_STS_SEGMENTS = 0x29
    MAX_RR_RETRY = 0x2A
    UWB_INITIATION_TIME = 0x2B
    HOPPING_MODE = 0x2C
    RESULT_REPORT_CONFIG = 0x2E
    IN_BAND_TERMINATION_ATTEMPT_COUNT = 0x2F
    SUB_SESSION_ID = 0x30
    UL_TDOA_TX_INTERVAL = 0x33
    UL_TDOA_RANDOM_WINDOW = 0x34
    STS_LENGTH = 0x35
    UL_TDOA_NTF_REPORT_CONFIG = 0x37
    UL_TDOA_DEVICE_ID = 0x38
    UL_TDOA_TX_TIMESTAMP = 0x39
    SESSION_KEY = 0x45
    SUBSESSION_KEY = 0x46
    SESSION_TIME_BASE = 0x48


def parameter_name(parameter: int) -> str:
    """The standard's name of a parameter id, or ``"parameter 0x7f"``."""
    try:
        return ParameterId(parameter).name
    except ValueError:
        return f"parameter 0x{parameter:02x}"


P = ParameterId

# Attribute, id, size in octets: in the order of transmission.
_SCALARS: Final[tuple[tuple[str, ParameterId, int], ...]] = (
    ("device_type", P.DEVICE_TYPE, 1),
    ("device_role", P.DEVICE_ROLE, 1),
    ("multi_node_mode", P.MULTI_NODE_MODE, 1),
    ("ranging_usage", P.RANGING_ROUND_USAGE, 1),
    ("schedule_mode", P.SCHEDULE_MODE, 1),
    ("mac_address", P.DEVICE_MAC_ADDRESS, 2),
    ("destination_macs", P.DST_MAC_ADDRESS, 0),  # written by hand: its length is the count that precedes it
    ("channel", P.CHANNEL_NUMBER, 1),
    ("slot_duration_rstu", P.SLOT_DURATION, 2),
    ("slots_per_round", P.SLOTS_PER_RR, 1),
    ("interval_ms", P.RANGING_INTERVAL, 4),
    ("round_control", P.RANGING_ROUND_CONTROL, 1),
    ("rframe_config", P.RFRAME_CONFIG, 1),
    ("preamble_code", P.PREAMBLE_CODE_INDEX, 1),
    ("sfd_id", P.SFD_ID, 1),
    ("result_report", P.RESULT_REPORT_CONFIG, 1),
    ("aoa_request", P.AOA_RESULT_REQ, 1),
    ("rssi_reporting", P.RSSI_REPORTING, 1),
    ("sts_config", P.STS_CONFIG, 1),
)
_BY_ID: Final = {identifier: (name, size) for name, identifier, size in _SCALARS}
_ENUMS: Final = {
    "device_type": DeviceType,
    "device_role": DeviceRole,
    "multi_node_mode": MultiNodeMode,
    "ranging_usage": RangingUsage,
    "sts_config": StsConfig,
    "rframe_config": RframeConfig,
    "schedule_mode": ScheduleMode,
}
SESSION_KEY_SIZES: Final = (16, 32)
MAX_CONTROLEES: Final = 8


_TIME_BASE: Final = struct.Struct("<BII")
REPORTED_AND_CONTROLLED: Final = 0x03
"""``round_control`` of a round with a control message (bit 1) and result reports (bit 0)."""


def least_slots(responders: int, round_control: int = REPORTED_AND_CONTROLLED) -> int:
    """Slots that a round of deferred two-way ranging takes, with so many responders.

    Control message, initiation, a response of each, final and measurement report; and a result report of each. FiRa
    MAC: 12, 16 and 20 for four, six and eight responders.
    """
    return 3 + responders + (round_control >> 1 & 1) + (responders if round_control & 1 else 0)


def slots_to_middle(responders: int, round_control: int = REPORTED_AND_CONTROLLED) -> float:
    """Slots from a round's begin to the middle of its measurement: between the initiation and the final message."""
    return (round_control >> 1 & 1) + (responders + 2) / 2


class UciParameterError(UciDecodeError):
    """A parameter that a node must refuse: its id and the status octet to answer with."""

    def __init__(self, parameter: int, status: Status, why: str) -> None:
        super().__init__(f"{parameter_name(parameter)} (0x{parameter:02x}): {why}")
        self.parameter = parameter
        self.status = status


@dataclass(frozen=True, slots=True, kw_only=True)
class AppConfig:
    """What one node is told about one session; field order is not wire order.

    ``session_key`` (16 or 32 octets, parameter 0x45) needs ``sts_config`` PROVISIONED. It never shows in ``repr``.
    ``slot_duration_rstu`` counts ranging scheduling time units of 416/499.2 MHz: 1200 are one millisecond.
    ``extra`` holds any other parameter as raw ``(id, value)``, sent last and in the given order.
    """

    device_type: DeviceType
    device_role: DeviceRole
    multi_node_mode: MultiNodeMode
    mac_address: int
    destination_macs: tuple[int, ...]
    interval_ms: int
    ranging_usage: RangingUsage = RangingUsage.DS_TWR_DEFERRED
    schedule_mode: ScheduleMode = ScheduleMode.TIME_SCHEDULED
    channel: int = 9
    slot_duration_rstu: int = 2400
    slots_per_round: int = 25
    round_control: int = 0x03
    rframe_config: RframeConfig = RframeConfig.SP1
    preamble_code: int = 10
    sfd_id: int = 2
    result_report: int = 0x01
    aoa_request: int = 0
    rssi_reporting: int = 0
    sts_config: StsConfig = StsConfig.PROVISIONED
    session_key: bytes | None = field(default=None, repr=False)
    extra: tuple[tuple[int, bytes], ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= len(self.destination_macs) <= MAX_CONTROLEES:
            raise UciEncodeError(f"destination_macs: {len(self.destination_macs)} given, 1 to {MAX_CONTROLEES} allowed")
        for mac in self.destination_macs:
            if not 0 <= mac <= 0xFFFF:
                raise UciEncodeError(f"destination_macs: {mac:#x} is no 16-bit short address")
        for name, _, size in _SCALARS:
            if size and not 0 <= getattr(self, name) < 1 << (8 * size):
                raise UciEncodeError(f"{name}: {getattr(self, name)} does not fit in {size} octets")
        keyed = self.sts_config in (StsConfig.PROVISIONED, StsConfig.PROVISIONED_RESPONDER_KEY)
        if keyed and (self.session_key is None or len(self.session_key) not in SESSION_KEY_SIZES):
            raise UciEncodeError("session_key: provisioned STS needs a key of 16 or 32 octets")
        if not keyed and self.session_key is not None:
            raise UciEncodeError("session_key: only provisioned STS takes a key; set sts_config")
        for identifier, value in self.extra:
            if not 0 <= identifier <= 0xFF or len(value) > 0xFF or identifier in _BY_ID:
                raise UciEncodeError(f"extra: {parameter_name(identifier)} is a field of its own or too long")

    def parameters(self) -> list[tuple[int, bytes]]:
        """``(id, value)`` of every parameter in the order of transmission."""
        out: list[tuple[int, bytes]] = [(P.MAC_ADDRESS_MODE, b"\x00")]
        for name, identifier, size in _SCALARS:
            if identifier == P.DST_MAC_ADDRESS:
                out.extend(
                    (
                        (P.NUMBER_OF_CONTROLEES, bytes((len(self.destination_macs),))),
                        (P.DST_MAC_ADDRESS, b"".join(mac.to_bytes(2, "little") for mac in self.destination_macs)),
                    )
                )
            else:
                out.append((identifier, int(getattr(self, name)).to_bytes(size, "little")))
        if self.session_key is not None:
            out.append((P.SESSION_KEY, self.session_key))
        out.extend(self.extra)
        return out

    def encode(self) -> bytes:
        """The count octet and the parameters: the part of SESSION_SET_APP_CONFIG after the session handle."""
        return encode_parameters(self.parameters())

    @classmethod
    def from_parameters(cls, parameters: list[tuple[int, bytes]]) -> Self:
        """The configuration that parameters describe; the number of controlees must come before their addresses.

        Raises ``UciParameterError`` naming the first parameter that is malformed or missing.
        """
        values: dict[str, object] = {}
        extra: list[tuple[int, bytes]] = []
        controlees: int | None = None
        for identifier, value in parameters:
            if identifier == P.MAC_ADDRESS_MODE:
                if value != b"\x00":
                    raise UciParameterError(identifier, Status.INVALID_PARAMETER, "only short addresses are supported")
            elif identifier == P.NUMBER_OF_CONTROLEES:
                controlees = _integer(identifier, value, 1)
            elif identifier == P.DST_MAC_ADDRESS:
                if controlees is None or len(value) != 2 * controlees:
                    why = "its length must follow from NUMBER_OF_CONTROLEES before it"
                    raise UciParameterError(identifier, Status.INVALID_PARAMETER, why)
                values["destination_macs"] = tuple(
                    int.from_bytes(value[at : at + 2], "little") for at in range(0, len(value), 2)
                )
            elif identifier == P.SESSION_KEY:
                values["session_key"] = value
            elif identifier in _BY_ID:
                name, size = _BY_ID[ParameterId(identifier)]
                number = _integer(identifier, value, size)
                if name in _ENUMS:
                    try:
                        values[name] = _ENUMS[name](number)
                    except ValueError:
                        why = f"{number} is not defined"
                        raise UciParameterError(identifier, Status.INVALID_PARAMETER, why) from None
                else:
                    values[name] = number
            else:
                extra.append((identifier, value))
        missing = [name for name in _REQUIRED if name not in values]
        if missing:
            identifier = next(i for n, i, _ in _SCALARS if n == missing[0])
            raise UciParameterError(identifier, Status.SESSION_NOT_CONFIGURED, "required and not given")
        try:
            return cls(**values, extra=tuple(extra))  # type: ignore[arg-type]
        except UciEncodeError as error:
            raise UciParameterError(P.SESSION_KEY, Status.INVALID_PARAMETER, str(error)) from error


_REQUIRED: Final = ("device_type", "device_role", "multi_node_mode", "mac_address", "destination_macs", "interval_ms")


def _integer(identifier: int, value: bytes, size: int) -> int:
    if len(value) != size:
        raise UciParameterError(identifier, Status.INVALID_PARAMETER, f"{len(value)} octets where {size} are expected")
    return int.from_bytes(value, "little")


def encode_parameters(parameters: list[tuple[int, bytes]]) -> bytes:
    """A count octet followed by ``id length value`` of each parameter."""
    if len(parameters) > 0xFF:
        raise UciEncodeError(f"{len(parameters)} parameters in one command; at most 255 fit")
    return bytes((len(parameters),)) + b"".join(bytes((i, len(value))) + value for i, value in parameters)


def decode_parameters(data: bytes) -> list[tuple[int, bytes]]:
    """Reverse of ``encode_parameters``; raises ``UciDecodeError`` unless ``data`` is used up exactly."""
    if not data:
        raise UciDecodeError("parameters: the count octet is missing")
    out: list[tuple[int, bytes]] = []
    at = 1
    for index in range(data[0]):
        if at + 2 > len(data) or at + 2 + data[at + 1] > len(data):
            raise UciDecodeError(f"parameters: number {index + 1} of {data[0]} ends beyond the payload")
        out.append((data[at], bytes(data[at + 2 : at + 2 + data[at + 1]])))
        at += 2 + data[at + 1]
    if at != len(data):
        raise UciDecodeError(f"parameters: {len(data) - at} octets follow the last of {data[0]}")
    return out


@dataclass(frozen=True, slots=True)
class TimeBase:
    """SESSION_TIME_BASE (0x48): a session's blocks begin ``offset_us`` after those of another one on the same node."""

    session_id: int
    offset_us: int

    def parameter(self, handle: int) -> tuple[int, bytes]:
        """As a parameter, with the handle that the node gave to the other session."""
        return P.SESSION_TIME_BASE, _TIME_BASE.pack(1, handle, self.offset_us)


def decode_time_base(value: bytes) -> tuple[int, int] | None:
    """(handle of the other session, offset in µs); None where it is switched off. Raises ``UciDecodeError``."""
    if len(value) != _TIME_BASE.size:
        raise UciDecodeError(f"SESSION_TIME_BASE: {len(value)} octets where {_TIME_BASE.size} are expected")
    enabled, handle, offset_us = _TIME_BASE.unpack(value)
    return (handle, offset_us) if enabled & 1 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionConfig:
    """A session as one node shall run it: SESSION_INIT and SESSION_SET_APP_CONFIG together.

    ``session_id`` is the 32-bit id that all nodes of the session share.
    """

    session_id: int
    app: AppConfig
    session_type: int = 0x01
    time_base: TimeBase | None = None
    """Without it the node begins the session's blocks when it pleases."""

    def __post_init__(self) -> None:
        if not 0 <= self.session_id <= 0xFFFFFFFF:
            raise UciEncodeError(f"session_id: {self.session_id} does not fit in 32 bits")
