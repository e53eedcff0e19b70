"""From an autopilot's messages to a claim, or to the reason why there is none. Time is handed in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland.geoid import Geoid
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.boot_time import REORDERED_MS, BootTime
from wonderland_uav_agent.position.mavlink.attitude import Vector, moved, times, turn
from wonderland_uav_agent.position.mavlink.doubled import Doubled
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
from wonderland_uav_agent.position.receiver import (
    MAX_AGE_MS,
    MAX_ATTITUDE_AGE_MS,
    MAX_GPS_AGE_MS,
    GpsRaw,
    NoClaimError,
    Wire,
    claim_at,
    quality_of,
)

SILENT_MS: Final = 5_000
"""An autopilot from which no heartbeat came for so long is gone, and another may take its place."""
HEARTBEAT_MS: Final = 1_000

AUTOPILOT_COMPONENT: Final = 1
TYPE_GCS, AUTOPILOT_INVALID = 6, 8
SET_MESSAGE_INTERVAL: Final = 511

WIRE: Final = Wire(
    "h_acc and v_acc of GPS_RAW_INT: they need MAVLink 2, and a receiver that tells", "alt_ellipsoid of GPS_RAW_INT"
)


@dataclass(frozen=True, slots=True)
class _Gps:
    content: GpsRaw
    arrived_ms: int


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
        self._doubled = Doubled()
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
        if self._doubled.now(now_ms):
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
        if self._doubled.step_back(now_ms):
            self._warn(
                "two speak as the autopilot, the second perhaps by another of its links (PX4 passes on what comes "
                "in its name: MAV_n_FORWARD); there is no position while that lasts"
            )

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
        except NoClaimError as reason:
            self._claim, self._reason = None, str(reason)

    def _claim_of(self, position: GlobalPosition, now_ms: int) -> Claim:
        if self._gps is None:
            raise NoClaimError(self._rates.missing(GPS_RAW_INT))
        gps, age_ms = self._gps.content, now_ms - self._gps.arrived_ms
        if age_ms > MAX_GPS_AGE_MS:
            raise NoClaimError(f"no GPS_RAW_INT for {age_ms / 1_000:.1f} s")
        quality = quality_of(gps, position.lat_e7, position.lon_e7, self._geoid, WIRE)
        north_m, east_m, down_m = self._arm_m(now_ms)
        lat_e7, lon_e7 = moved(position.lat_e7, position.lon_e7, north_m, east_m)
        alt_mm = position.alt_mm - round(1_000 * down_m)
        return claim_at(lat_e7, lon_e7, alt_mm, self._time.utc_ms(position.boot_ms, now_ms), quality)

    def _arm_m(self, now_ms: int) -> Vector:
        """From the place that the autopilot tells to the antenna: north, east, down."""
        if not any(self._antenna_m):
            return self._antenna_m
        if self._attitude is None or now_ms - self._attitude_ms > MAX_ATTITUDE_AGE_MS:
            raise NoClaimError(f"{self._rates.missing(ATTITUDE)}: --antenna is turned by it")
        return times(turn(self._attitude), self._antenna_m)
