"""A drone's claims from ``nav_msgs/Odometry``: metres in a frame of which it is said where on Earth it lies. Pure.

What the frame's place leaves open goes into the claim: its own accuracy, and that of its direction, times the way from
its origin. Whether the frame still lies where it is said to, no message tells: a leap, or another publisher, ends it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

from msgspec import Meta

from wonderland.proofs.records.sessions import Claim
from wonderland.toml_settings import Table
from wonderland_uav_agent.position.fixes import FixError, accuracies_m, claim_at, time_of
from wonderland_uav_agent.position.mavlink.attitude import ECCENTRICITY_2, EQUATOR_M, Vector
from wonderland_uav_agent.position.turning import turned

MAX_WAY_M: Final = 10_000.0
"""Further from its origin nothing is local."""
MAX_SPEED_M_S: Final = 50.0
LEAP_M: Final = 2.0
"""So far an estimate may be corrected at once, besides what the drone can fly meanwhile."""
_STATED: Final = 2
_POSITION: Final = (0, 1, 2, 6, 7, 8, 12, 13, 14)
"""Of a covariance of six: x, y, z."""
_ROUNDS: Final = 5


class OdometrySettings(Table, frozen=True, kw_only=True):
    """The ``[odometry]`` table of ``uav.toml``."""

    frame: Annotated[str, Meta(min_length=1, max_length=60, pattern=r"\A[A-Za-z_][A-Za-z0-9_/]*\Z")]
    """The frame in which the poses stand (``header.frame_id``); those in another are left out."""
    lat: Annotated[float, Meta(ge=-89.9, le=89.9)]
    """Latitude of the frame’s origin, in degrees (WGS-84)."""
    lon: Annotated[float, Meta(ge=-180, le=180)]
    """Longitude of the frame’s origin, in degrees."""
    height_m: Annotated[float, Meta(ge=-500, le=9_000)]
    """Height of the frame’s origin above the ellipsoid."""
    yaw_deg: Annotated[float, Meta(ge=-360, le=360)]
    """Direction of the frame’s x axis: from east, counter-clockwise; 0 where axes are east, north, up (REP-103)."""
    accuracy_m: Annotated[float, Meta(gt=0, le=100)]
    """How well the origin’s place is known (95 %), in the plane and in height."""
    yaw_accuracy_deg: Annotated[float, Meta(gt=0, le=45)]
    """How well the direction is known (95 %)."""


class Odometry:
    """Follows one odometry. ``antenna_m``: of the UWB node, from what the poses are of: forward, right, down."""

    def __init__(self, settings: OdometrySettings, antenna_m: Vector = (0.0, 0.0, 0.0)) -> None:
        forward, right, down = antenna_m
        self._settings = settings
        self._arm_m = (forward, -right, -down)  # REP-103: forward, left, up
        self._gid = b""
        self._last: tuple[int, Vector] | None = None
        self._moved = ""

    def claim_of(self, message: Any, gid: bytes, now_ms: int, after_ms: int) -> Claim:
        """A message of a publisher as a claim. Raises FixError."""
        frame = message.header.frame_id.lstrip("/")
        if frame != self._settings.frame.lstrip("/"):
            raise FixError(f"its frame is {frame[:60]!r}, and [odometry] says where {self._settings.frame!r} lies")
        t_ms = time_of(message.header, now_ms, after_ms)
        at, turn = message.pose.pose.position, message.pose.pose.orientation
        place = (at.x, at.y, at.z)
        if not all(abs(each) <= MAX_WAY_M for each in place):
            raise FixError(f"its position is no number, or more than {MAX_WAY_M:g} m from the frame's origin")
        covariance = [float(message.pose.covariance[index]) for index in _POSITION]
        if not any(covariance):
            raise FixError("it states no covariance (all are 0), and so no accuracy")
        horizontal_m, vertical_m = accuracies_m(_STATED, covariance)
        self._follow(t_ms, place, gid)
        if any(self._arm_m):
            by = (turn.x, turn.y, turn.z, turn.w)
            if not abs(math.hypot(*by) - 1) < 0.01:
                raise FixError("its orientation is none: --antenna is turned by it")
            place = tuple(a + b for a, b in zip(place, turned(by, self._arm_m), strict=True))
        return self._claim(place, horizontal_m, vertical_m, t_ms)

    def _follow(self, t_ms: int, place: Vector, gid: bytes) -> None:
        """Raises FixError, from then on always, where the frame may lie elsewhere now."""
        if self._last is not None and not self._moved:
            last_ms, last = self._last
            leap_m = math.dist(last, place) - MAX_SPEED_M_S * (t_ms - last_ms) / 1_000
            if gid != self._gid:
                self._moved = "another publishes it now"
            elif leap_m > LEAP_M:
                self._moved = f"it leapt by {math.dist(last, place):.1f} m"
        if self._moved:
            raise FixError(
                f"{self._moved}: the frame's origin may be another; see that [odometry] says where it is now, and "
                "start the agent again"
            )
        self._gid, self._last = gid, (t_ms, place)

    def _claim(self, place: Vector, horizontal_m: float, vertical_m: float, t_ms: int) -> Claim:
        said = self._settings
        x, y, up = place
        yaw = math.radians(said.yaw_deg)
        east, north = x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)
        turned_m = math.hypot(x, y) * math.radians(said.yaw_accuracy_deg)
        accuracies = math.hypot(horizontal_m, said.accuracy_m, turned_m), math.hypot(vertical_m, said.accuracy_m)
        return claim_at(geodetic((said.lat, said.lon, said.height_m), (east, north, up)), accuracies, t_ms)


def geodetic(origin: Vector, local_m: Vector) -> Vector:
    """Degrees and metres above the ellipsoid of a point, east, north and up from an origin in the same."""
    lat, lon = math.radians(origin[0]), math.radians(origin[1])
    east, north, up = local_m
    normal_m = EQUATOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(lat) ** 2)
    outward_m = (normal_m + origin[2]) * math.cos(lat) - north * math.sin(lat) + up * math.cos(lat)
    z = (normal_m * (1 - ECCENTRICITY_2) + origin[2]) * math.sin(lat) + north * math.cos(lat) + up * math.sin(lat)
    from_axis_m = math.hypot(outward_m, east)
    found, height_m = lat, origin[2]
    for _ in range(_ROUNDS):  # each takes away more than two digits
        normal_m = EQUATOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(found) ** 2)
        height_m = from_axis_m * math.cos(found) + z * math.sin(found) - EQUATOR_M**2 / normal_m
        found = math.atan2(z, from_axis_m * (1 - ECCENTRICITY_2 * normal_m / (normal_m + height_m)))
    longitude = math.degrees(lon + math.atan2(east, outward_m))
    return math.degrees(found), (longitude + 180) % 360 - 180, height_m
