"""Core and session commands, their responses and state notifications (FiRa UCI, groups 0, 1 and 2)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from wonderland_fira_uci.uci.config import decode_parameters, encode_parameters
from wonderland_fira_uci.uci.errors import UciDecodeError, UciEncodeError
from wonderland_fira_uci.uci.packets import Group, MessageType, encode_control
from wonderland_fira_uci.uci.status import Status

_HANDLE: Final = struct.Struct("<I")
_INIT: Final = struct.Struct("<IB")
_SESSION_STATUS: Final = struct.Struct("<IBB")
_INFO: Final = struct.Struct("<HHHHB")


class Core(IntEnum):
    """Opcodes of group CORE."""

    RESET = 0x00
    DEVICE_STATUS = 0x01
    GET_DEVICE_INFO = 0x02
    GET_CAPS_INFO = 0x03
    SET_CONFIG = 0x04
    GENERIC_ERROR = 0x07


class SessionConfigOp(IntEnum):
    """Opcodes of group SESSION_CONFIG."""

    INIT = 0x00
    DEINIT = 0x01
    STATUS = 0x02
    SET_APP_CONFIG = 0x03
    GET_APP_CONFIG = 0x04
    GET_COUNT = 0x05
    GET_STATE = 0x06
    UPDATE_MULTICAST_LIST = 0x07


class SessionControlOp(IntEnum):
    """Opcodes of group SESSION_CONTROL; a notification with START's opcode is RANGE_DATA_NTF."""

    START = 0x00
    STOP = 0x01
    DATA_CREDIT = 0x04
    DATA_TRANSFER_STATUS = 0x05


_NAMES: Final[dict[tuple[int, int], str]] = (
    {(Group.CORE, op): f"CORE_{op.name}" for op in Core}
    | {(Group.SESSION_CONFIG, op): f"SESSION_{op.name}" for op in SessionConfigOp}
    | {(Group.SESSION_CONTROL, op): f"SESSION_{op.name}" for op in SessionControlOp}
)


def command_name(group: int, opcode: int) -> str:
    """``"SESSION_INIT"``, or ``"command 0x4/0x09"`` outside the standard's list."""
    return _NAMES.get((group, opcode), f"command 0x{group:x}/0x{opcode:02x}")


class Command(NamedTuple):
    """A command, either side."""

    group: int
    opcode: int
    payload: bytes

    @property
    def name(self) -> str:
        """The standard's name."""
        return command_name(self.group, self.opcode)

    def encode(self) -> bytes:
        """The packets."""
        return encode_control(MessageType.COMMAND, self.group, self.opcode, self.payload)


class Response(NamedTuple):
    """A response: its status octet and what follows."""

    group: int
    opcode: int
    status: int
    body: bytes

    def encode(self) -> bytes:
        """The packets."""
        payload = bytes((self.status,)) + self.body
        return encode_control(MessageType.RESPONSE, self.group, self.opcode, payload)


class DeviceStatus(NamedTuple):
    """CORE_DEVICE_STATUS_NTF; ``state`` is a ``DeviceState`` octet."""

    state: int


class GenericError(NamedTuple):
    """CORE_GENERIC_ERROR_NTF."""

    status: int


class SessionStatus(NamedTuple):
    """SESSION_STATUS_NTF; ``state`` is a ``SessionState`` octet, ``reason`` 0 after a command."""

    handle: int
    state: int
    reason: int


class DeviceInfo(NamedTuple):
    """CORE_GET_DEVICE_INFO response. Versions as sent: major in the low octet, minor and patch in the high one."""

    uci_version: int
    mac_version: int
    phy_version: int
    test_version: int
    vendor: bytes


def decode_response(group: int, opcode: int, payload: bytes) -> Response:
    """Raises ``UciDecodeError`` when the status octet is missing."""
    if not payload:
        raise UciDecodeError(f"the response to {command_name(group, opcode)} has no status octet")
    return Response(group, opcode, payload[0], payload[1:])


def reset_command() -> Command:
    """CORE_DEVICE_RESET, reset by host."""
    return Command(Group.CORE, Core.RESET, b"\x00")


def device_info_command() -> Command:
    """CORE_GET_DEVICE_INFO."""
    return Command(Group.CORE, Core.GET_DEVICE_INFO, b"")


def set_config_command(parameters: Sequence[tuple[bytes, bytes]]) -> Command:
    """CORE_SET_CONFIG: (id, value) as the node's maker gives them; ids have one octet, or two of a maker's own.

    Raises UciEncodeError where one does not fit.
    """
    for identifier, value in parameters:
        if not 1 <= len(identifier) <= 2 or len(value) > 0xFF:
            raise UciEncodeError(f"parameter {identifier.hex()}: ids have 1 or 2 octets, values 255 at most")
    body = b"".join(identifier + bytes((len(value),)) + value for identifier, value in parameters)
    return Command(Group.CORE, Core.SET_CONFIG, bytes((len(parameters),)) + body)


def capabilities_command() -> Command:
    """CORE_GET_CAPS_INFO."""
    return Command(Group.CORE, Core.GET_CAPS_INFO, b"")


def init_command(session_id: int, session_type: int) -> Command:
    """SESSION_INIT."""
    return Command(Group.SESSION_CONFIG, SessionConfigOp.INIT, _INIT.pack(session_id, session_type))


def set_app_config_command(handle: int, parameters: list[tuple[int, bytes]]) -> Command:
    """SESSION_SET_APP_CONFIG."""
    payload = _HANDLE.pack(handle) + encode_parameters(parameters)
    return Command(Group.SESSION_CONFIG, SessionConfigOp.SET_APP_CONFIG, payload)


def get_state_command(handle: int) -> Command:
    """SESSION_GET_STATE."""
    return Command(Group.SESSION_CONFIG, SessionConfigOp.GET_STATE, _HANDLE.pack(handle))


def deinit_command(handle: int) -> Command:
    """SESSION_DEINIT."""
    return Command(Group.SESSION_CONFIG, SessionConfigOp.DEINIT, _HANDLE.pack(handle))


def start_command(handle: int) -> Command:
    """SESSION_START (RANGE_START in UCI 1.1)."""
    return Command(Group.SESSION_CONTROL, SessionControlOp.START, _HANDLE.pack(handle))


def stop_command(handle: int) -> Command:
    """SESSION_STOP."""
    return Command(Group.SESSION_CONTROL, SessionControlOp.STOP, _HANDLE.pack(handle))


def decode_handle(name: str, payload: bytes) -> int:
    """The session handle that is a command's whole payload."""
    if len(payload) != _HANDLE.size:
        raise UciDecodeError(f"{name}: {len(payload)} octets where a handle of 4 is expected")
    return int(_HANDLE.unpack(payload)[0])


def decode_init(payload: bytes) -> tuple[int, int]:
    """Session id and type of SESSION_INIT."""
    if len(payload) != _INIT.size:
        raise UciDecodeError(f"SESSION_INIT: {len(payload)} octets where 5 are expected")
    session_id, session_type = _INIT.unpack(payload)
    return session_id, session_type


def decode_set_app_config(payload: bytes) -> tuple[int, list[tuple[int, bytes]]]:
    """Handle and parameters of SESSION_SET_APP_CONFIG."""
    if len(payload) < _HANDLE.size:
        raise UciDecodeError("SESSION_SET_APP_CONFIG: the session handle is incomplete")
    return int(_HANDLE.unpack_from(payload)[0]), decode_parameters(payload[_HANDLE.size :])


def decode_init_response(response: Response, session_id: int) -> int:
    """The session's handle: UCI 2 names one, in UCI 1 it is the session id."""
    if len(response.body) >= _HANDLE.size:
        return int(_HANDLE.unpack_from(response.body)[0])
    return session_id


def encode_config_refusal(status: int, refused: dict[int, int]) -> Response:
    """SESSION_SET_APP_CONFIG response that names parameters; accepted when there are none."""
    body = bytes((len(refused),)) + bytes(octet for pair in refused.items() for octet in pair)
    return Response(Group.SESSION_CONFIG, SessionConfigOp.SET_APP_CONFIG, status, body)


def decode_config_refusal(response: Response) -> dict[int, int]:
    """Parameter id → status octet. Defensive: some nodes answer a malformed command with something shorter."""
    pairs = response.body[1:]
    if not response.body or len(pairs) != 2 * response.body[0]:
        return {}
    return dict(zip(pairs[::2], pairs[1::2], strict=True))


def decode_state_response(response: Response) -> int | None:
    """State octet of a SESSION_GET_STATE response; None when it carries none."""
    return response.body[0] if response.status == Status.OK and response.body else None


def encode_device_info(info: DeviceInfo) -> Response:
    """CORE_GET_DEVICE_INFO response."""
    body = _INFO.pack(*info[:4], len(info.vendor)) + info.vendor
    return Response(Group.CORE, Core.GET_DEVICE_INFO, Status.OK, body)


def decode_device_info(body: bytes) -> DeviceInfo:
    """Raises ``UciDecodeError``."""
    if len(body) < _INFO.size or len(body) != _INFO.size + body[_INFO.size - 1]:
        raise UciDecodeError(f"CORE_GET_DEVICE_INFO: a response of {len(body)} octets contradicts its lengths")
    uci, mac, phy, test, _ = _INFO.unpack_from(body)
    return DeviceInfo(uci, mac, phy, test, body[_INFO.size :])


def encode_session_status(status: SessionStatus) -> bytes:
    """The SESSION_STATUS_NTF packet."""
    payload = _SESSION_STATUS.pack(*status)
    return encode_control(MessageType.NOTIFICATION, Group.SESSION_CONFIG, SessionConfigOp.STATUS, payload)


def decode_session_status(payload: bytes) -> SessionStatus:
    """Raises ``UciDecodeError``."""
    if len(payload) != _SESSION_STATUS.size:
        raise UciDecodeError(f"SESSION_STATUS_NTF: {len(payload)} octets where 6 are expected")
    return SessionStatus(*_SESSION_STATUS.unpack(payload))


def encode_device_status(state: int) -> bytes:
    """The CORE_DEVICE_STATUS_NTF packet."""
    return encode_control(MessageType.NOTIFICATION, Group.CORE, Core.DEVICE_STATUS, bytes((state,)))


def decode_device_status(payload: bytes) -> DeviceStatus:
    """Raises ``UciDecodeError``."""
    if len(payload) != 1:
        raise UciDecodeError(f"CORE_DEVICE_STATUS_NTF: {len(payload)} octets where 1 is expected")
    return DeviceStatus(payload[0])


def decode_generic_error(payload: bytes) -> GenericError:
    """Raises ``UciDecodeError``."""
    if len(payload) != 1:
        raise UciDecodeError(f"CORE_GENERIC_ERROR_NTF: {len(payload)} octets where 1 is expected")
    return GenericError(payload[0])
