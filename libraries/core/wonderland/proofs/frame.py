"""WGS-84 to a pad's own east, north, up: multiplications and additions of integers, the same on every endorser.

The coefficients stand in the pad's commissioned ``Frame`` (its docstring has the formula); they come from a geodesy
library off the ledger (the agent's ``geodesy``). Within 1 km of the origin and 200 m of its height the second order is
good to 5 mm (``tests/proofs/test_frame.py`` measures it against pyproj at several latitudes).
"""

from __future__ import annotations

from typing import Final

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.records.pads import Frame

FIRST: Final = 32
SECOND: Final = 52
_HALF_FIRST: Final = 1 << (FIRST - 1)
_HALF_SECOND: Final = 1 << (SECOND - 1)
MAX_DIFFERENCE_E7: Final = 2_000_000
"""0.2 degrees, 22 km at the equator: beyond this nothing is local and a claim counts as 'elsewhere'."""
MAX_HEIGHT_MM: Final = 20_000_000
_ROUNDS: Final = 4
_TURN_E7: Final = 3_600_000_000


def to_local(frame: Frame, lat_e7: int, lon_e7: int, height_mm: int) -> tuple[int, int, int]:
    """(east, north, up) in millimetres from the pad's origin.

    Raises GeometryError where the position is more than 0.2 degrees or 20 km of height away.
    """
    d_lat = lat_e7 - frame.lat_e7
    d_lon = lon_e7 - frame.lon_e7
    if d_lon > _TURN_E7 // 2:  # the pad and the drone on two sides of the date line
        d_lon -= _TURN_E7
    elif d_lon < -_TURN_E7 // 2:
        d_lon += _TURN_E7
    d_up = height_mm - frame.height_mm
    if not (
        -MAX_DIFFERENCE_E7 <= d_lat <= MAX_DIFFERENCE_E7
        and -MAX_DIFFERENCE_E7 <= d_lon <= MAX_DIFFERENCE_E7
        and -MAX_HEIGHT_MM <= d_up <= MAX_HEIGHT_MM
    ):
        raise GeometryError("the position is too far from the pad for its local frame")
    return _apply(frame, d_lat, d_lon, d_up)


def to_wgs84(frame: Frame, east_mm: int, north_mm: int, up_mm: int) -> tuple[int, int, int]:
    """(lat_e7, lon_e7, height_mm) of a point in the pad's frame, to the last unit; the inverse of ``to_local``.

    Raises GeometryError beyond the frame's reach.
    """
    limit = MAX_HEIGHT_MM
    if abs(east_mm) > limit or abs(north_mm) > limit or abs(up_mm) > limit:
        raise GeometryError("the point is too far from the pad for its local frame")
    if frame.e1 == 0 or frame.n1 == 0:
        raise GeometryError("the pad's frame has no scale")
    d_lat = d_lon = d_up = 0
    for _ in range(_ROUNDS):  # each round takes away the error of the second order once more
        east, north, up = _apply(frame, d_lat, d_lon, d_up)
        if (east, north, up) == (east_mm, north_mm, up_mm):
            break
        d_lon += _divide((east_mm - east) << FIRST, frame.e1)
        d_lat += _divide((north_mm - north) << FIRST, frame.n1)
        d_up += up_mm - up
    lat_e7 = frame.lat_e7 + d_lat
    lon_e7 = frame.lon_e7 + d_lon
    if lon_e7 > _TURN_E7 // 2:
        lon_e7 -= _TURN_E7
    elif lon_e7 < -_TURN_E7 // 2:
        lon_e7 += _TURN_E7
    return lat_e7, lon_e7, frame.height_mm + d_up


def _apply(frame: Frame, d_lat: int, d_lon: int, d_up: int) -> tuple[int, int, int]:
    """Each term over 2^FIRST or 2^SECOND, rounded half up."""
    second_east = frame.e2 * d_lat * d_lon + frame.e3 * d_lon * d_up
    second_north = frame.n2 * d_lat * d_lat + frame.n3 * d_lon * d_lon + frame.n4 * d_lat * d_up
    second_up = frame.u2 * d_lat * d_lat + frame.u3 * d_lon * d_lon
    east = (frame.e1 * d_lon + _HALF_FIRST >> FIRST) + (second_east + _HALF_SECOND >> SECOND)
    north = (frame.n1 * d_lat + _HALF_FIRST >> FIRST) + (second_north + _HALF_SECOND >> SECOND)
    return east, north, d_up + (second_up + _HALF_SECOND >> SECOND)


def _divide(numerator: int, denominator: int) -> int:
    """Rounded quotient (half away from zero is not needed: half up is the same on every machine)."""
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    return (2 * numerator + denominator) // (2 * denominator)
