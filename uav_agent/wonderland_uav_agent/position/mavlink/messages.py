"""What is read of an autopilot and asked of it, in the units of MAVLink; nothing of a library or of a socket."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from wonderland_remote_id.messages import BasicId, OperatorId, SelfId, System
from wonderland_uav_agent.position.receiver import GpsRaw

SYSTEM_TIME: Final = 2
GPS_RAW_INT: Final = 24
ATTITUDE: Final = 30
LOCAL_POSITION_NED: Final = 32
GLOBAL_POSITION_INT: Final = 33
EXTENDED_SYS_STATE: Final = 245

NAMES: Final = {
    SYSTEM_TIME: "SYSTEM_TIME",
    GPS_RAW_INT: "GPS_RAW_INT",
    ATTITUDE: "ATTITUDE",
    LOCAL_POSITION_NED: "LOCAL_POSITION_NED",
    GLOBAL_POSITION_INT: "GLOBAL_POSITION_INT",
    EXTENDED_SYS_STATE: "EXTENDED_SYS_STATE",
}


REMOTE_ID: Final = frozenset({*range(12900, 12906), 12915})
"""OPEN_DRONE_ID_BASIC_ID to _OPERATOR_ID, and _MESSAGE_PACK."""

Peer = tuple[Any, ...] | None
"""A socket's address; None on links that have one end alone."""


@dataclass(frozen=True, slots=True)
class Sender:
    """Whose message it is; ``peer`` is the address that it came from, where a link has several (UDP)."""

    system: int
    component: int
    peer: Peer = None


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """HEARTBEAT (0)."""

    vehicle_type: int
    autopilot: int
    base_mode: int = 0
    custom_mode: int = 0
    system_status: int = 0


@dataclass(frozen=True, slots=True)
class SystemTime:
    """SYSTEM_TIME (2)."""

    unix_us: int
    boot_ms: int


@dataclass(frozen=True, slots=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT (33): what the autopilot's filter makes of all its sensors; height above mean sea level."""

    boot_ms: int
    lat_e7: int
    lon_e7: int
    alt_mm: int
    vx_cm_s: int = 0
    vy_cm_s: int = 0
    vz_cm_s: int = 0
    """North, east, down."""


@dataclass(frozen=True, slots=True)
class ExtendedState:
    """EXTENDED_SYS_STATE (245): MAV_LANDED_STATE."""

    landed_state: int


@dataclass(frozen=True, slots=True)
class Attitude:
    """ATTITUDE (30): radians, from north-east-down to forward-right-down."""

    roll: float
    pitch: float
    yaw: float


@dataclass(frozen=True, slots=True)
class LocalPosition:
    """LOCAL_POSITION_NED (32): metres from where the autopilot's filter has its origin."""

    north_m: float
    east_m: float
    down_m: float


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """COMMAND_ACK (77)."""

    command: int
    result: int


@dataclass(frozen=True, slots=True)
class ArmingAsked:
    """COMMAND_LONG with MAV_CMD_ARM_AUTHORIZATION_REQUEST (3001): whether it may be armed."""

    system: int


@dataclass(frozen=True, slots=True)
class Parameter:
    """PARAM_VALUE (22)."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class RemoteIdHeard:
    """OPEN_DRONE_ID_* (12900 to 12905, 12915): the packet as it came."""

    packet: bytes


@dataclass(frozen=True, slots=True)
class OutOfStep:
    """No message: a sender's numbers went back, as those of two do who use one name."""


Message = (
    Heartbeat
    | SystemTime
    | GpsRaw
    | GlobalPosition
    | ExtendedState
    | Attitude
    | LocalPosition
    | Acknowledged
    | ArmingAsked
    | Parameter
    | RemoteIdHeard
    | OutOfStep
)


@dataclass(frozen=True, slots=True)
class SayAlive:
    """To send: a heartbeat of ours, as a computer on board of ``system``."""

    system: int


@dataclass(frozen=True, slots=True)
class AskFor:
    """To send: SET_MESSAGE_INTERVAL (511) for a message, to the autopilot of ``system``."""

    system: int
    message_id: int
    interval_us: int


@dataclass(frozen=True, slots=True)
class Command:
    """To send: COMMAND_LONG (76)."""

    system: int
    command: int
    values: tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Reposition:
    """To send: DO_REPOSITION (192) in COMMAND_INT: go there, whatever the flight mode; height above mean sea level."""

    system: int
    lat_e7: int
    lon_e7: int
    alt_mm: int


@dataclass(frozen=True, slots=True)
class ArmingAnswered:
    """To send: COMMAND_ACK of 3001; ``valid_s``: how long it may be armed."""

    system: int
    result: int
    reason: int
    valid_s: int


@dataclass(frozen=True, slots=True)
class SetParameter:
    """To send: PARAM_SET (23), a real number."""

    system: int
    name: str
    value: float


@dataclass(frozen=True, slots=True)
class LandingTarget:
    """To send: LANDING_TARGET (149); ``place_m`` in ``frame`` (MAV_FRAME), ``distance_m`` from the vehicle."""

    system: int
    t_us: int
    frame: int
    place_m: tuple[float, float, float]
    distance_m: float


@dataclass(frozen=True, slots=True)
class RemoteIdTold:
    """To send: OPEN_DRONE_ID_*, what a ground station tells an autopilot otherwise."""

    system: int
    message: BasicId | OperatorId | SelfId | System


Outgoing = SayAlive | AskFor | Command | Reposition | ArmingAnswered | SetParameter | LandingTarget | RemoteIdTold
