"""Is a commissioned frame one that the globe has there? Checked with + − × ÷ √ alone, the same on every endorser.

A frame computed for another place, in other units or by a broken tool would move every verdict of its pad; anchors
in a heap or on one line measure no position. The check knows WGS-84 and nothing of the tool that made the frame.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

from wonderland.proofs.frame import FIRST, SECOND
from wonderland.proofs.records.pads import Anchor, Commissioning, Frame
from wonderland_chaincode.contract.errors import bad_input

MAX_LATITUDE_E7: Final = 890_000_000
"""Within a degree of a pole a kilometre spans too many degrees of longitude for a series of second order."""
MAX_ANCHOR_DISTANCE_MM: Final = 200_000
"""From the origin: no UWB anchor serves a pad from further away."""
MIN_SPREAD_MM: Final = 100
"""How far the anchors must lie from one horizontal line: on a line, left and right of it measure the same."""
FIRST_ORDER_PPM: Final = 10
"""Tolerated error of e1 and n1: 10 mm at 1 km."""
SECOND_ORDER_MM: Final = 5.0
"""Tolerated effect of the error of each other coefficient on a point 1 km away (and 200 m up)."""

_A_MM: Final = 6_378_137_000.0
_E2: Final = 0.0066943799901413165
"""WGS-84: semi-major axis and first eccentricity squared (f = 1/298.257223563)."""
_PI: Final = 3.141592653589793
_RADIANS_PER_UNIT: Final = _PI / 1_800_000_000.0
_NEAR_MM: Final = 1_000_000.0
_HIGH_MM: Final = 200_000.0
_TERMS: Final = 14
"""Of the Taylor series: the first one left out is below 10⁻¹⁸ up to a right angle."""


def check(commissioning: Commissioning) -> None:
    """Raises ContractError (400) where the frame or the anchors cannot be those of a pad."""
    _check_frame(commissioning.frame)
    _check_anchors(commissioning.anchors)


def sine_cosine(angle: float) -> tuple[float, float]:
    """(sin, cos) for |angle| ≤ π/2 by Taylor's series; error below 10⁻¹⁵ (tested against mpmath)."""
    square = angle * angle
    sine = cosine = 0.0
    for order in range(_TERMS, 0, -1):  # Horner's form, smallest terms first
        sine = (1.0 + sine) * (-square / ((2.0 * order) * (2.0 * order + 1.0)))
        cosine = (1.0 + cosine) * (-square / ((2.0 * order - 1.0) * (2.0 * order)))
    return angle * (1.0 + sine), 1.0 + cosine


def expected(lat_e7: int, height_mm: int) -> dict[str, float]:
    """The coefficients that WGS-84 gives at a latitude and height: derivatives of east, north, up at the origin."""
    sine, cosine = sine_cosine(lat_e7 * _RADIANS_PER_UNIT)
    squashed = 1.0 - _E2 * sine * sine
    root = sqrt(squashed)
    curvature = _A_MM * (1.0 - _E2) / (squashed * root)
    meridian = curvature + height_mm
    vertical = _A_MM / root + height_mm
    slope = 3.0 * curvature * _E2 * sine * cosine / squashed
    unit, first, second = _RADIANS_PER_UNIT, float(1 << FIRST), float(1 << SECOND)
    return {
        "e1": vertical * cosine * unit * first,
        "n1": meridian * unit * first,
        "e2": -meridian * sine * unit * unit * second,
        "e3": cosine * unit * second,
        "n2": slope / 2.0 * unit * unit * second,
        "n3": vertical * sine * cosine / 2.0 * unit * unit * second,
        "n4": unit * second,
        "u2": -meridian / 2.0 * unit * unit * second,
        "u3": -vertical * cosine * cosine / 2.0 * unit * unit * second,
    }


def _check_frame(frame: Frame) -> None:
    if not -MAX_LATITUDE_E7 <= frame.lat_e7 <= MAX_LATITUDE_E7:
        raise bad_input("FRAME_AT_POLE", "a pad's origin must be more than one degree away from a pole")
    wanted = expected(frame.lat_e7, frame.height_mm)
    d_lat = _NEAR_MM * (1 << FIRST) / wanted["n1"]
    d_lon = _NEAR_MM * (1 << FIRST) / wanted["e1"]
    second = SECOND_ORDER_MM * float(1 << SECOND)
    tolerances = {
        "e1": wanted["e1"] * FIRST_ORDER_PPM / 1e6,
        "n1": wanted["n1"] * FIRST_ORDER_PPM / 1e6,
        "e2": second / (d_lat * d_lon),
        "e3": second / (d_lon * _HIGH_MM),
        "n2": second / (d_lat * d_lat),
        "n3": second / (d_lon * d_lon),
        "n4": second / (d_lat * _HIGH_MM),
        "u2": second / (d_lat * d_lat),
        "u3": second / (d_lon * d_lon),
    }
    for name, tolerance in tolerances.items():
        value = getattr(frame, name)
        if not -tolerance <= value - wanted[name] <= tolerance:
            raise bad_input(
                "FRAME_IMPLAUSIBLE",
                f"commissioning.frame.{name}: {value}, but WGS-84 gives about {int(wanted[name])} at this latitude "
                "and height; compute the frame from the origin that the record names",
            )


def _check_anchors(anchors: tuple[Anchor, ...]) -> None:
    for index, anchor in enumerate(anchors):
        square = anchor.east_mm**2 + anchor.north_mm**2 + anchor.up_mm**2
        if square > MAX_ANCHOR_DISTANCE_MM**2:
            raise bad_input(
                "ANCHOR_TOO_FAR",
                f"commissioning.anchors[{index}]: more than {MAX_ANCHOR_DISTANCE_MM // 1000} m from the pad's origin; "
                "are its coordinates millimetres in the pad's frame?",
            )
    if not _spread(anchors):
        raise bad_input(
            "ANCHORS_ON_A_LINE",
            f"commissioning.anchors: seen from above, all lie within {MIN_SPREAD_MM} mm of one line, so that they "
            "cannot tell its two sides apart; set up at least one beside it",
        )


def _spread(anchors: tuple[Anchor, ...]) -> bool:
    """Whether an anchor lies MIN_SPREAD_MM from the line through the two that are furthest apart (integers only)."""
    points = [(anchor.east_mm, anchor.north_mm) for anchor in anchors]
    length2, (x0, y0), (x1, y1) = max(
        ((ax - bx) ** 2 + (ay - by) ** 2, (ax, ay), (bx, by)) for ax, ay in points for bx, by in points
    )
    # Distance from the line = cross product / length.
    return any(((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)) ** 2 >= MIN_SPREAD_MM**2 * length2 > 0 for x, y in points)
