"""Bytes to messages and back, by pymavlink's parser of the common dialect (ArduPilot's is a superset of it)."""

from __future__ import annotations

from types import ModuleType
from typing import Any, Final

from wonderland_uav_agent.position.mavlink.messages import (
    REMOTE_ID,
    Acknowledged,
    ArmingAnswered,
    ArmingAsked,
    AskFor,
    Attitude,
    Command,
    ExtendedState,
    GlobalPosition,
    Heartbeat,
    LandingTarget,
    LocalPosition,
    Message,
    Outgoing,
    OutOfStep,
    Parameter,
    Peer,
    RemoteIdHeard,
    RemoteIdTold,
    Reposition,
    SayAlive,
    Sender,
    SystemTime,
)
from wonderland_uav_agent.position.mavlink.signing import Signing
from wonderland_uav_agent.position.receiver import GpsRaw
from wonderland_uav_agent.position.source import PositionError

ARM_AUTHORIZATION_REQUEST: Final = 3001
COMPONENT: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
REORDERED: Final = 16
"""Datagrams overtake each other by less than so many messages."""


def dialect() -> ModuleType:
    """The messages of pymavlink. Raises PositionError where it is not installed."""
    try:
        from pymavlink.dialects.v20 import common  # noqa: PLC0415 - an extra, and half a second on a small computer
    except ImportError:
        raise PositionError('mavlink: needs pymavlink; pip install "wonderland-uav-agent[mavlink]"') from None
    # Else damaged messages were believed wherever somebody has MAV_IGNORE_CRC in the environment.
    common.MAVLINK_IGNORE_CRC = 0
    return common  # type: ignore[no-any-return]


class Wire:
    """Of one link, or of one sender of datagrams."""

    def __init__(self, signing: Signing | None = None) -> None:
        self._dialect = dialect()
        self._signing = signing
        self._ours = self._dialect.MAVLink(None, srcSystem=1, srcComponent=COMPONENT)
        if signing is not None:
            signing.sign(self._ours)
        self.restart()
        self.bad = 0
        """How often something came that is no MAVLink, is damaged, or is not signed where it has to be."""

    def restart(self) -> None:
        """Forget the begun message of a link that was cut."""
        self._parser = self._dialect.MAVLink(None)
        self._parser.robust_parsing = True
        if self._signing is not None:
            self._signing.check(self._parser)
        self._numbers: dict[tuple[int, int], int] = {}

    def read(self, data: bytes, peer: Peer = None) -> list[tuple[Message, Sender]]:
        """The messages of interest that are complete now. Whatever comes, it raises nothing."""
        if self._signing is not None:
            self._signing.renew()
        messages: list[tuple[Message, Sender]] = []
        received = self._parser.parse_char(data)
        while received is not None:
            if received.get_type() == "BAD_DATA":
                self.bad += 1
                if self._signing is not None:
                    self._signing.refused += 1
            else:
                sender = Sender(received.get_srcSystem(), received.get_srcComponent(), peer)
                if not self._in_step(sender, received.get_seq()):
                    messages.append((OutOfStep(), sender))
                message = _message(received)
                if message is not None:
                    messages.append((message, sender))
            received = self._parser.parse_char(b"")
        # pymavlink keeps what it has read for as long as something follows it.
        del self._parser.buf[: self._parser.buf_index]
        self._parser.buf_index = 0
        return messages

    def _in_step(self, sender: Sender, number: int) -> bool:
        """Whether a sender's number follows its last one: each counts its own on each link, from 0 to 255."""
        key = (sender.system, sender.component)
        step = (number - self._numbers.get(key, number)) % 256
        self._numbers[key] = number
        return step < 128 or step >= 256 - REORDERED

    def write(self, what: Outgoing) -> bytes:
        """What to send, as bytes."""
        if self._signing is not None:
            self._signing.renew()
        self._ours.srcSystem = what.system
        data = bytes(_packet(self._dialect, what).pack(self._ours))
        self._ours.seq = (self._ours.seq + 1) % 256
        return data


def _packet(dialect: ModuleType, what: Outgoing) -> Any:
    """As a message of the dialect, to the autopilot of its own system."""
    to = (what.system, 1)
    match what:
        case SayAlive():
            kind, autopilot = dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID
            return dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, dialect.MAV_STATE_ACTIVE, 3)
        case AskFor():
            values: tuple[float, ...] = (what.message_id, what.interval_us, 0, 0, 0, 0, 0)
            return dialect.MAVLink_command_long_message(*to, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, *values)
        case Command():
            return dialect.MAVLink_command_long_message(*to, what.command, 0, *what.values)
        case Reposition():
            nan, changes_mode = float("nan"), dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
            where = (what.lat_e7, what.lon_e7, what.alt_mm / 1_000)
            head = (*to, dialect.MAV_FRAME_GLOBAL, dialect.MAV_CMD_DO_REPOSITION, 0, 0)
            return dialect.MAVLink_command_int_message(*head, -1, changes_mode, 0, nan, *where)
        case ArmingAnswered():
            answer = (dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST, what.result, what.reason, what.valid_s)
            return dialect.MAVLink_command_ack_message(*answer, *to)
        case LandingTarget():
            seen = (what.t_us, 0, what.frame, 0.0, 0.0, what.distance_m, 0.0, 0.0, *what.place_m)
            kind = dialect.LANDING_TARGET_TYPE_RADIO_BEACON
            return dialect.MAVLink_landing_target_message(*seen, (1.0, 0.0, 0.0, 0.0), kind, 1)
        case RemoteIdTold():
            return _remote_id(dialect, what)
        case _:
            name = what.name.encode("ascii")
            return dialect.MAVLink_param_set_message(*to, name, what.value, dialect.MAV_PARAM_TYPE_REAL32)


def _remote_id(dialect: ModuleType, what: RemoteIdTold) -> Any:
    """By the codec's own rounding and limits; pymavlink numbers and signs it."""
    from wonderland_remote_id.framings.mavlink import build  # noqa: PLC0415 - few drones need it

    message = dialect.MAVLink(None).decode(bytearray(build(what.message)))
    message.target_system, message.target_component = what.system, 1
    return message


def _message(received: Any) -> Message | None:
    kind = received.get_type()
    if kind == "HEARTBEAT":
        return Heartbeat(
            received.type, received.autopilot, received.base_mode, received.custom_mode, received.system_status
        )
    if kind == "SYSTEM_TIME":
        return SystemTime(received.time_unix_usec, received.time_boot_ms)
    if kind == "GPS_RAW_INT":
        return GpsRaw(received.fix_type, received.alt, received.alt_ellipsoid, received.h_acc, received.v_acc)
    if kind == "GLOBAL_POSITION_INT":
        velocity = (received.vx, received.vy, received.vz)
        return GlobalPosition(received.time_boot_ms, received.lat, received.lon, received.alt, *velocity)
    if kind == "ATTITUDE":
        return Attitude(received.roll, received.pitch, received.yaw)
    if kind == "LOCAL_POSITION_NED":
        return LocalPosition(received.x, received.y, received.z)
    if kind == "COMMAND_ACK":
        return Acknowledged(received.command, received.result)
    if kind == "EXTENDED_SYS_STATE":
        return ExtendedState(received.landed_state)
    if kind == "COMMAND_LONG" and received.command == ARM_AUTHORIZATION_REQUEST:
        return ArmingAsked(received.target_system)
    if kind == "PARAM_VALUE":
        return Parameter(received.param_id, received.param_value)
    if received.get_msgId() in REMOTE_ID:
        return RemoteIdHeard(bytes(received.get_msgbuf()))
    return None
