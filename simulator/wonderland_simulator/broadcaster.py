"""What a drone broadcasts: a Remote ID message pack (ASTM F3411-22a) from its own idea of where it is."""

from __future__ import annotations

from dataclasses import dataclass

from wonderland_remote_id import (
    BasicId,
    HeightReference,
    HorizontalAccuracy,
    Location,
    OperationalStatus,
    OperatorId,
    Pack,
    System,
    UaType,
    VerticalAccuracy,
    encode,
)

HOUR_MS = 3_600_000
LOWEST_MM = -999_500
HIGHEST_MM = 31_767_500


@dataclass(frozen=True)
class Fix:
    """A drone's own word on where it is and how it moves."""

    lat_e7: int
    lon_e7: int
    height_mm: int
    above_takeoff_mm: int
    accuracy_mm: int
    height_accuracy_mm: int
    speed_mm_s: int
    track_cdeg: int
    vertical_mm_s: int
    airborne: bool
    t_ms: int


def _in_range(height_mm: int) -> int:
    """The nearest that a message can say."""
    return max(LOWEST_MM, min(HIGHEST_MM, height_mm))


def frame(uav_id: str, operator_id: str, operator: tuple[int, int], fix: Fix) -> bytes:
    """The bytes of one message pack; ``operator`` is the remote pilot's (lat_e7, lon_e7)."""
    location = Location(
        lat_e7=fix.lat_e7,
        lon_e7=fix.lon_e7,
        status=OperationalStatus.AIRBORNE if fix.airborne else OperationalStatus.GROUND,
        track_cdeg=fix.track_cdeg // 100 * 100 % 36_000,
        speed_mm_s=min(254_250, fix.speed_mm_s),
        vertical_mm_s=max(-62_000, min(62_000, fix.vertical_mm_s)),
        altitude_mm=_in_range(fix.height_mm),
        height_mm=_in_range(fix.above_takeoff_mm),
        height_reference=HeightReference.TAKEOFF,
        horizontal_accuracy=HorizontalAccuracy.of_mm(fix.accuracy_mm),
        vertical_accuracy=VerticalAccuracy.of_mm(fix.height_accuracy_mm),
        after_hour_ms=fix.t_ms % HOUR_MS // 100 * 100,
    )
    return encode(
        Pack(
            messages=(
                BasicId(uas_id=uav_id, ua_type=UaType.HELICOPTER_OR_MULTIROTOR),
                location,
                System(operator_lat_e7=operator[0], operator_lon_e7=operator[1], t_ms=fix.t_ms // 1000 * 1000),
                OperatorId(operator_id=operator_id),
            )
        )
    )
