"""From PX4's uORB topics (``px4_msgs``) to a claim, or to the reason why there is none. Time is handed in. Pure.

The rules are those of MAVLink's way (``receiver``), and three more, since uORB tells more: the filter says whether its
position holds and whether it rests on dead reckoning, and how good it is; the worse of filter and receiver counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from wonderland.geoid import Geoid
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position.boot_time import REORDERED_MS, BootTime
from wonderland_uav_agent.position.mavlink.attitude import Vector, moved
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
from wonderland_uav_agent.position.turning import turned

MAX_M: Final = 1e6
"""No height of a drone, and no accuracy."""
WIRE: Final = Wire(
    "eph and epv of vehicle_gps_position and vehicle_global_position",
    "altitude_ellipsoid_m of vehicle_gps_position",
)


@dataclass(frozen=True, slots=True)
class _Gps:
    content: GpsRaw
    arrived_ms: int


class Px4:
    """Follows one PX4. ``warn`` is told what its operator should know; the others are as ``Navigator`` has them."""

    def __init__(
        self, warn: Callable[[str], None], geoid: Geoid | None = None, antenna_m: Vector = (0.0, 0.0, 0.0)
    ) -> None:
        self._warn = warn
        self._geoid = geoid
        self._antenna_m = antenna_m
        self._time = BootTime(warn)
        self._forget()

    def _forget(self) -> None:
        self._gps: _Gps | None = None
        self._attitude: tuple[float, ...] = ()
        self._attitude_ms = 0
        self._last_boot_ms: int | None = None
        self._heard_ms = 0
        self._claim: Claim | None = None
        self._reason = ""

    def gps(self, message: Any, now_ms: int) -> None:
        """``SensorGps``."""
        boot_ms = message.timestamp // 1_000
        self._follow(boot_ms, now_ms)
        heights = (message.altitude_msl_m, message.altitude_ellipsoid_m)
        known = all(abs(each) <= MAX_M for each in heights)
        msl_mm, ellipsoid_mm = (round(each * 1_000) for each in heights) if known else (0, 0)
        raw = GpsRaw(message.fix_type, msl_mm, ellipsoid_mm, _sigma_mm(message.eph), _sigma_mm(message.epv))
        self._gps = _Gps(raw, now_ms)
        told_ms = (message.timestamp + message.timestamp_time_relative) // 1_000
        self._time.set(message.time_utc_usec, told_ms, now_ms)

    def attitude(self, message: Any, now_ms: int) -> None:
        """``VehicleAttitude``."""
        found = tuple(float(each) for each in message.q)
        if abs(math.hypot(*found) - 1) < 0.01:
            self._attitude, self._attitude_ms = found, now_ms

    def position(self, message: Any, now_ms: int) -> None:
        """``VehicleGlobalPosition``."""
        boot_ms = (message.timestamp_sample or message.timestamp) // 1_000
        last_ms = self._last_boot_ms
        if last_ms is not None and 0 <= last_ms - boot_ms <= REORDERED_MS:
            return  # An overtaken one, or the same again, which makes nothing fresh.
        self._follow(boot_ms, now_ms)
        self._last_boot_ms, self._heard_ms = boot_ms, now_ms
        try:
            self._claim, self._reason = self._claim_of(message, boot_ms, now_ms), ""
        except NoClaimError as reason:
            self._claim, self._reason = None, str(reason)

    def claim(self, now_ms: int) -> Claim | None:
        """The position now; None while there is none that is fresh and complete."""
        return None if self.why_not(now_ms) else self._claim

    def why_not(self, now_ms: int) -> str:
        """Why there is no claim now; empty where there is one."""
        if self._last_boot_ms is None:
            return "no vehicle_global_position has come"
        if not 0 <= now_ms - self._heard_ms <= MAX_AGE_MS:
            return f"no vehicle_global_position for {(now_ms - self._heard_ms) / 1_000:.1f} s"
        return self._reason

    def _follow(self, boot_ms: int, now_ms: int) -> None:
        if not self._time.follows(boot_ms, now_ms):
            self._warn("PX4’s time since boot jumped: it has restarted, or its messages were held up")
            self._forget()

    def _claim_of(self, message: Any, boot_ms: int, now_ms: int) -> Claim:
        if not (message.lat_lon_valid and message.alt_valid):
            raise NoClaimError("PX4’s filter says that its position does not hold (lat_lon_valid, alt_valid)")
        if message.dead_reckoning:
            raise NoClaimError("PX4’s filter reckons without its receiver (dead_reckoning)")
        if not (abs(message.lat) <= 90 and abs(message.lon) <= 180 and abs(message.alt) <= MAX_M):
            raise NoClaimError("latitude, longitude or altitude is no number, or a place nowhere")
        if self._gps is None:
            raise NoClaimError("no vehicle_gps_position has come: PX4 has no receiver, or does not publish it")
        gps, age_ms = self._gps.content, now_ms - self._gps.arrived_ms
        if age_ms > MAX_GPS_AGE_MS:
            raise NoClaimError(f"no vehicle_gps_position for {age_ms / 1_000:.1f} s")
        lat_e7, lon_e7 = round(message.lat * 1e7), round(message.lon * 1e7)
        worse = GpsRaw(
            gps.fix_type,
            gps.alt_mm,
            gps.alt_ellipsoid_mm,
            _worse_mm(gps.h_acc_mm, _sigma_mm(message.eph)),
            _worse_mm(gps.v_acc_mm, _sigma_mm(message.epv)),
        )
        quality = quality_of(worse, lat_e7, lon_e7, self._geoid, WIRE)
        north_m, east_m, down_m = self._arm_m(now_ms)
        lat_e7, lon_e7 = moved(lat_e7, lon_e7, north_m, east_m)
        alt_mm = round((message.alt - down_m) * 1_000)
        return claim_at(lat_e7, lon_e7, alt_mm, self._time.utc_ms(boot_ms, now_ms), quality)

    def _arm_m(self, now_ms: int) -> Vector:
        """From PX4's place to the antenna: north, east, down."""
        if not any(self._antenna_m):
            return self._antenna_m
        if not self._attitude or now_ms - self._attitude_ms > MAX_ATTITUDE_AGE_MS:
            raise NoClaimError("no vehicle_attitude: --antenna is turned by it")
        w, x, y, z = self._attitude
        return turned((x, y, z, w), self._antenna_m)


def _sigma_mm(sigma_m: float) -> int:
    """0 where none is stated."""
    return math.ceil(sigma_m * 1_000) if 0 < sigma_m <= MAX_M else 0


def _worse_mm(first_mm: int, second_mm: int) -> int:
    """0 where either states none."""
    return max(first_mm, second_mm) if first_mm and second_mm else 0
