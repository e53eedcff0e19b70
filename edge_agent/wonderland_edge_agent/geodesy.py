"""The local frame of a pad, computed once by its commissioning and then only multiplied and added by the contract.

East, north and up of a point near the origin are its Taylor series in latitude, longitude and height to the second
order; the radii of curvature come from pyproj's WGS-84. This module is for commissioning: a running pad never needs
it, and pyproj is loaded only when it is called.
"""

from __future__ import annotations

import math
from typing import Final

from wonderland.proofs.errors import RecordError
from wonderland.proofs.frame import FIRST, SECOND
from wonderland.proofs.records.pads import Frame

_RADIANS_PER_UNIT: Final = math.pi / 180 * 1e-7
MAX_LATITUDE_E7: Final = 890_000_000
"""Closer to a pole, a kilometre spans so many degrees of longitude that the series no longer holds."""


class GeodesyError(Exception):
    """An origin for which no local frame can be given."""


def frame_at(lat_e7: int, lon_e7: int, height_mm: int) -> Frame:
    """The frame of a pad whose origin is at this WGS-84 position (degrees × 10⁷, mm above the ellipsoid).

    Good to 5 mm within 1 km of the origin and 200 m of its height. Raises GeodesyError within a degree of a pole
    and for positions that no pad can have.
    """
    from pyproj import Geod  # noqa: PLC0415 - 20 MB that a running pad must not carry

    if abs(lat_e7) > MAX_LATITUDE_E7:
        raise GeodesyError(f"lat_e7 {lat_e7}: a pad needs an origin more than one degree away from a pole")
    geod = Geod(ellps="WGS84")
    phi = lat_e7 * _RADIANS_PER_UNIT
    sine, cosine = math.sin(phi), math.cos(phi)
    squashed = 1.0 - geod.es * sine * sine
    # Radii of curvature (mm) at the origin's height: of the meridian, and of the prime vertical.
    meridian = geod.a * 1e3 * (1.0 - geod.es) / squashed**1.5
    vertical = geod.a * 1e3 / math.sqrt(squashed) + height_mm
    meridian_slope = 3.0 * meridian * geod.es * sine * cosine / squashed
    meridian += height_mm
    unit = _RADIANS_PER_UNIT
    first, second = 2.0**FIRST, 2.0**SECOND
    try:
        return Frame.parse(
            {
                "lat_e7": lat_e7,
                "lon_e7": lon_e7,
                "height_mm": height_mm,
                "e1": round(vertical * cosine * unit * first),
                "e2": round(-meridian * sine * unit * unit * second),
                "e3": round(cosine * unit * second),
                "n1": round(meridian * unit * first),
                "n2": round(meridian_slope / 2 * unit * unit * second),
                "n3": round(vertical * sine * cosine / 2 * unit * unit * second),
                "n4": round(unit * second),
                "u2": round(-meridian / 2 * unit * unit * second),
                "u3": round(-vertical * cosine * cosine / 2 * unit * unit * second),
            }
        )
    except RecordError as error:
        raise GeodesyError(f"no pad can stand there: {error}") from error
