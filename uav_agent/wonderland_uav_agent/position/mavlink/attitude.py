"""What is fixed to the vehicle, turned by its attitude. Pure."""

from __future__ import annotations

import math
from typing import Final

from wonderland_uav_agent.position.mavlink.messages import Attitude

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

EQUATOR_M: Final = 6_378_137.0
ECCENTRICITY_2: Final = 6.694_379_990_14e-3
"""WGS-84."""


def turn(attitude: Attitude) -> Matrix:
    """From forward, right, down to north, east, down (Tait–Bryan: yaw, pitch, roll)."""
    cr, sr = math.cos(attitude.roll), math.sin(attitude.roll)
    cp, sp = math.cos(attitude.pitch), math.sin(attitude.pitch)
    cy, sy = math.cos(attitude.yaw), math.sin(attitude.yaw)
    return (
        (cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy),
        (cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy),
        (-sp, sr * cp, cr * cp),
    )


def times(matrix: Matrix, vector: Vector) -> Vector:
    """The vector, turned."""
    first, second, third = (sum(row[k] * vector[k] for k in range(3)) for row in matrix)
    return first, second, third


def transposed(matrix: Matrix) -> Matrix:
    """The turn back."""
    first, second, third = ((matrix[0][k], matrix[1][k], matrix[2][k]) for k in range(3))
    return first, second, third


def moved(lat_e7: int, lon_e7: int, north_m: float, east_m: float) -> tuple[int, int]:
    """A place some metres from another, along the ellipsoid; not at the poles."""
    latitude = math.radians(lat_e7 / 1e7)
    bent = 1 - ECCENTRICITY_2 * math.sin(latitude) ** 2
    meridian_m = EQUATOR_M * (1 - ECCENTRICITY_2) / bent**1.5
    parallel_m = EQUATOR_M / math.sqrt(bent) * max(math.cos(latitude), 1e-6)
    north_e7, east_e7 = (round(math.degrees(way) * 1e7) for way in (north_m / meridian_m, east_m / parallel_m))
    return lat_e7 + north_e7, lon_e7 + east_e7
