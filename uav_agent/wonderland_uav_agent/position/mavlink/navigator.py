"""From an autopilot's messages to a claim, or to the reason why there is none. Time is handed in."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland.geoid import Geoid
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.mavlink.attitude import Vector, moved, times, turn
from wonderland_uav_agent.position.mavlink.boot_time import REORDERED_MS, BootTime
from wonderland_uav_agent.position.mavlink.messages import (
    ATTITUDE,
    EXTENDED_SYS_STATE,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    LOCAL_POSITION_NED,
    SYSTEM_TIME,
    Acknowledged,
    Attitude,
    ExtendedState,
    GlobalPosition,
    GpsRaw,
    Heartbeat,
    LocalPosition,
    Message,
    Outgoing,
    OutOfStep,
    SayAlive,
    Sender,
    SystemTime,
)
from wonderland_uav_agent.position.mavlink.rates import Rates

MAX_AGE_MS: Final = 1_000
MAX_GPS_AGE_MS: Final = 2_000
MAX_ATTITUDE_AGE_MS: Final = 500
SILENT_MS: Final = 5_000
"""An autopilot from which no heartbeat came for so long is gone, and another may take its place."""
HEARTBEAT_MS: Final = 1_000
DOUBLED, DOUBLED_MS = 3, 5_000
"""So many steps back within this time are no restart and no burst of losses: two speak in one name."""

AUTOPILOT_COMPONENT: Final = 1
TYPE_GCS, AUTOPILOT_INVALID = 6, 8
FIX_3D, FIX_RTK_FIXED = 3, 6
SET_MESSAGE_INTERVAL: Final = 511

MAX_UNDULATION_MM: Final = 120_000
"""No geoid is further from the ellipsoid."""
GRID_95_MM: Final = 1_000
"""How well the grid of a geoid, and the one that the autopilot means by mean sea level, are the same."""
MAX_SIGMA_MM: Final = 4_000_000
"""Larger ones (UINT32_MAX among them) say that nothing is known."""


@dataclass(frozen=True, slots=True)
class _Gps:
    content: GpsRaw
    arrived_ms: int


class _NoClaimError(Exception):
    """Why a position is no claim."""


class Navigator:
    """Follows the first autopilot that it hears. ``warn`` is told what its operator should know, once each.

    ``geoid`` is for receivers that know none. ``antenna_m``: of the UWB node, from the place that the autopilot tells,
    forward, right, down; claims are of the antenna.
    """

    def __init__(
        self, warn: Callable[[str], None], geoid: Geoid | None = None, antenna_m: Vector = (0.0, 0.0, 0.0)
    ) -> None:
        self._antenna_m = antenna_m
        self._warn = warn
        self.flown = False
        """Whether somebody here flies it; to be set before it is heard."""
        self._geoid = geoid
        self._sender: Sender | None = None
        self._alive_ms = 0
        self._say_at_ms = 0
        self._stranger_seen = False
        self._forget(None, 0)
        self.strangers = 0
        """Messages of others than the autopilot that is followed."""

    def _forget(self, sender: Sender | None, now_ms: int) -> None:
        self._sender = sender
        self._time = BootTime(self._warn)
        self._rates = Rates(sender.system if sender else 0, now_ms, flown=self.flown, turned=any(self._antenna_m))
        self._steps_back: deque[int] = deque(maxlen=DOUBLED)
        self._forget_position()

    def _forget_position(self) -> None:
        self._gps: _Gps | None = None
        self._attitude: Attitude | None = None
        self._attitude_ms = 0
        self._position: GlobalPosition | None = None
        self._heard_ms = 0
        self._claim: Claim | None = None
        self._reason = ""

    @property
    def sender(self) -> Sender | None:
        """The autopilot that is followed."""
        return self._sender

    @property
    def skew_ms(self) -> int | None:
        """How far the autopilot's UTC is ahead of this computer's clock; None while it has told none."""
        return self._time.skew_ms

    @property
    def refused(self) -> int:
        """How often the autopilot refused to send a message."""
        return self._rates.refused

    def take(self, message: Message, sender: Sender, now_ms: int) -> None:
        """A message that arrived now."""
        if sender != self._sender and not self._found(message, sender, now_ms):
            return
        if isinstance(message, Heartbeat):
            self._alive_ms = now_ms
        elif isinstance(message, OutOfStep):
            self._take_step_back(now_ms)
        elif isinstance(message, Acknowledged):
            if message.command == SET_MESSAGE_INTERVAL:
                self._rates.answered(message.result)
        elif isinstance(message, GpsRaw):
            self._rates.seen(GPS_RAW_INT, now_ms)
            self._gps = _Gps(message, now_ms)
        elif isinstance(message, SystemTime):
            self._rates.seen(SYSTEM_TIME, now_ms)
            self._follow(message.boot_ms, now_ms)
            self._time.set(message.unix_us, message.boot_ms, now_ms)
        elif isinstance(message, GlobalPosition):
            self._take_position(message, now_ms)
        elif isinstance(message, ExtendedState):
            self._rates.seen(EXTENDED_SYS_STATE, now_ms)
        elif isinstance(message, Attitude):
            self._rates.seen(ATTITUDE, now_ms)
            if all(map(math.isfinite, (message.roll, message.pitch, message.yaw))):
                self._attitude, self._attitude_ms = message, now_ms
        elif isinstance(message, LocalPosition):
            self._rates.seen(LOCAL_POSITION_NED, now_ms)

    def claim(self, now_ms: int) -> Claim | None:
        """The position now; None while there is none that is fresh and complete."""
        return None if self.why_not(now_ms) else self._claim

    def why_not(self, now_ms: int) -> str:
        """Why there is no claim now; empty where there is one."""
        if self._sender is None:
            return "no heartbeat of an autopilot"
        if self._doubled(now_ms):
            return "two speak as the autopilot: their messages' numbers do not follow each other"
        if self._position is None:
            return self._rates.missing(GLOBAL_POSITION_INT)
        if not 0 <= now_ms - self._heard_ms <= MAX_AGE_MS:
            return f"no GLOBAL_POSITION_INT for {(now_ms - self._heard_ms) / 1_000:.1f} s"
        return self._reason

    def outgoing(self, now_ms: int) -> list[Outgoing]:
        """What to send to the autopilot now; to be called several times a second."""
        if self._sender is None:
            return []
        out: list[Outgoing] = []
        if now_ms >= self._say_at_ms or self._say_at_ms > now_ms + HEARTBEAT_MS:
            self._say_at_ms = now_ms + HEARTBEAT_MS
            out.append(SayAlive(self._sender.system))
        return [*out, *self._rates.due(now_ms)]

    def _found(self, message: Message, sender: Sender, now_ms: int) -> bool:
        """Whether to follow this sender from now on. One that is alive is never left for another."""
        followed = self._sender
        if followed is not None and now_ms - self._alive_ms <= SILENT_MS:
            if (sender.system, sender.peer) != (followed.system, followed.peer):
                self._count_stranger(message, sender)
            return False
        is_autopilot = (
            isinstance(message, Heartbeat)
            and sender.component == AUTOPILOT_COMPONENT
            and message.vehicle_type != TYPE_GCS
            and message.autopilot != AUTOPILOT_INVALID
        )
        if not is_autopilot:
            return False
        if followed is not None:
            self._warn(f"the autopilot (system {followed.system}) is silent; now following system {sender.system}")
        self._forget(sender, now_ms)
        self._say_at_ms = now_ms
        return True

    def _count_stranger(self, message: Message, sender: Sender) -> None:
        self.strangers += 1
        if isinstance(message, Heartbeat) and message.vehicle_type != TYPE_GCS and not self._stranger_seen:
            self._stranger_seen = True
            where = "" if sender.peer is None else f" at {sender.peer}"
            self._warn(
                f"another system ({sender.system}{where}) speaks on the autopilot’s link; what it says is left out"
            )

    def _take_step_back(self, now_ms: int) -> None:
        was_doubled = self._doubled(now_ms)
        self._steps_back.append(now_ms)
        if self._doubled(now_ms) and not was_doubled:
            self._warn(
                "two speak as the autopilot, the second perhaps by another of its links (PX4 passes on what comes "
                "in its name: MAV_n_FORWARD); there is no position while that lasts"
            )

    def _doubled(self, now_ms: int) -> bool:
        return len(self._steps_back) == DOUBLED and now_ms - self._steps_back[0] <= DOUBLED_MS

    def _follow(self, boot_ms: int, now_ms: int) -> None:
        if not self._time.follows(boot_ms, now_ms):
            self._warn("the autopilot’s time since boot jumped: it has restarted, or its messages were held up")
            self._forget_position()

    def _take_position(self, message: GlobalPosition, now_ms: int) -> None:
        self._rates.seen(GLOBAL_POSITION_INT, now_ms)
        last = self._position
        if last is not None and 0 <= last.boot_ms - message.boot_ms <= REORDERED_MS:
            return  # An overtaken one, or the same again, which makes nothing fresh.
        self._follow(message.boot_ms, now_ms)
        self._position, self._heard_ms = message, now_ms
        try:
            self._claim, self._reason = self._claim_of(message, now_ms), ""
        except _NoClaimError as reason:
            self._claim, self._reason = None, str(reason)

    def _claim_of(self, position: GlobalPosition, now_ms: int) -> Claim:
        if self._gps is None:
            raise _NoClaimError(self._rates.missing(GPS_RAW_INT))
        gps, age_ms = self._gps.content, now_ms - self._gps.arrived_ms
        if age_ms > MAX_GPS_AGE_MS:
            raise _NoClaimError(f"no GPS_RAW_INT for {age_ms / 1_000:.1f} s")
        if not FIX_3D <= gps.fix_type <= FIX_RTK_FIXED:
            raise _NoClaimError(f"no 3-D fix (fix type {gps.fix_type})")
        if (position.lat_e7, position.lon_e7) == (0, 0):
            raise _NoClaimError("the autopilot does not know yet where it is (latitude and longitude 0)")
        if not (0 < gps.h_acc_mm <= MAX_SIGMA_MM and 0 < gps.v_acc_mm <= MAX_SIGMA_MM):
            raise _NoClaimError(
                "no accuracy stated (h_acc and v_acc of GPS_RAW_INT: they need MAVLink 2, and a receiver that tells)"
            )
        undulation_mm, height_95_mm = _undulation_mm(gps), vertical_95_mm(gps.v_acc_mm)
        if undulation_mm is None and self._geoid is not None:
            undulation_mm = self._geoid.undulation_mm(position.lat_e7, position.lon_e7)
            height_95_mm += GRID_95_MM
        if undulation_mm is None:
            raise _NoClaimError(
                "no height above the ellipsoid (alt_ellipsoid of GPS_RAW_INT, from a receiver that knows a geoid; "
                "where it knows none, name the grid of one: --geoid)"
            )
        north_m, east_m, down_m = self._arm_m(now_ms)
        lat_e7, lon_e7 = moved(position.lat_e7, position.lon_e7, north_m, east_m)
        values = {
            "lat_e7": lat_e7,
            "lon_e7": lon_e7,
            "height_mm": position.alt_mm + undulation_mm - round(1_000 * down_m),
            "accuracy_mm": horizontal_95_mm(gps.h_acc_mm),
            "height_accuracy_mm": height_95_mm,
            "t_ms": self._time.utc_ms(position.boot_ms, now_ms),
        }
        try:
            return Claim.parse(values)
        except ProofError as error:
            raise _NoClaimError(f"no position: {error}") from None

    def _arm_m(self, now_ms: int) -> Vector:
        """From the place that the autopilot tells to the antenna: north, east, down."""
        if not any(self._antenna_m):
            return self._antenna_m
        if self._attitude is None or now_ms - self._attitude_ms > MAX_ATTITUDE_AGE_MS:
            raise _NoClaimError(f"{self._rates.missing(ATTITUDE)}: --antenna is turned by it")
        return times(turn(self._attitude), self._antenna_m)


def _undulation_mm(gps: GpsRaw) -> int | None:
    """How far mean sea level is above the ellipsoid, by the receiver's own geoid; None where it knows none."""
    undulation_mm = gps.alt_ellipsoid_mm - gps.alt_mm
    # Equal to the millimetre: a receiver or simulator without a geoid, which fills in one height twice.
    states_none = gps.alt_ellipsoid_mm == 0 or undulation_mm == 0 or abs(undulation_mm) > MAX_UNDULATION_MM
    return None if states_none else undulation_mm


def horizontal_95_mm(sigma_mm: int) -> int:
    """Radius that holds 95 % where ``sigma_mm`` is the deviation along each of two axes: √(−2 ln 0.05) = 2.448.

    Receivers do not agree on what their one figure is. Where it is the radius that holds 68 %, 1.62 would do; the
    larger factor claims too little rather than too much.
    """
    return -(-sigma_mm * 245 // 100)


def vertical_95_mm(sigma_mm: int) -> int:
    """Interval that holds 95 %, for a normal deviation on one axis: 1.96."""
    return -(-sigma_mm * 196 // 100)
