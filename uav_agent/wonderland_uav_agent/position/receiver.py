"""An autopilot's position, by what its receiver says of itself, as a claim: the same rules for every wire. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from wonderland.geoid import Geoid
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records.sessions import Claim

MAX_AGE_MS: Final = 1_000
"""An older position is none of a flying drone."""
MAX_GPS_AGE_MS: Final = 2_000
MAX_ATTITUDE_AGE_MS: Final = 500
FIX_3D, FIX_RTK_FIXED = 3, 6
MAX_UNDULATION_MM: Final = 120_000
"""No geoid is further from the ellipsoid."""
GRID_95_MM: Final = 1_000
"""How well the grid of a geoid, and the one that the autopilot means by mean sea level, are the same."""
MAX_SIGMA_MM: Final = 4_000_000
"""Larger ones (UINT32_MAX among them) say that nothing is known."""


class NoClaimError(Exception):
    """Why a position is no claim."""


@dataclass(frozen=True, slots=True)
class GpsRaw:
    """What a receiver says, as GPS_RAW_INT (24) has it: heights in mm; accuracies in mm at 1 σ, 0: not stated."""

    fix_type: int
    alt_mm: int
    alt_ellipsoid_mm: int
    h_acc_mm: int
    v_acc_mm: int


@dataclass(frozen=True, slots=True)
class Wire:
    """What to tell whoever looks for what is missing."""

    accuracy: str
    height: str


@dataclass(frozen=True, slots=True)
class Quality:
    """What a claim says besides its place: how far mean sea level is above the ellipsoid, and accuracies at 95 %."""

    undulation_mm: int
    accuracy_mm: int
    height_accuracy_mm: int


def quality_of(gps: GpsRaw, lat_e7: int, lon_e7: int, geoid: Geoid | None, wire: Wire) -> Quality:
    """By the receiver; ``geoid`` is for one that knows none. Raises NoClaimError."""
    if not FIX_3D <= gps.fix_type <= FIX_RTK_FIXED:
        raise NoClaimError(f"no 3-D fix (fix type {gps.fix_type})")
    if (lat_e7, lon_e7) == (0, 0):
        raise NoClaimError("the autopilot does not know yet where it is (latitude and longitude 0)")
    if not (0 < gps.h_acc_mm <= MAX_SIGMA_MM and 0 < gps.v_acc_mm <= MAX_SIGMA_MM):
        raise NoClaimError(f"no accuracy stated ({wire.accuracy})")
    undulation_mm, height_95_mm = _undulation_mm(gps), vertical_95_mm(gps.v_acc_mm)
    if undulation_mm is None and geoid is not None:
        undulation_mm = geoid.undulation_mm(lat_e7, lon_e7)
        height_95_mm += GRID_95_MM
    if undulation_mm is None:
        raise NoClaimError(
            f"no height above the ellipsoid ({wire.height}, from a receiver that knows a geoid; "
            "where it knows none, name the grid of one: --geoid)"
        )
    return Quality(undulation_mm, horizontal_95_mm(gps.h_acc_mm), height_95_mm)


def claim_at(lat_e7: int, lon_e7: int, alt_mm: int, t_ms: int | None, quality: Quality) -> Claim:
    """A place, its height above mean sea level; `t_ms` None: nobody knows yet. Raises NoClaimError."""
    if t_ms is None:
        raise NoClaimError("the autopilot has not said its time yet")
    values = {
        "lat_e7": lat_e7,
        "lon_e7": lon_e7,
        "height_mm": alt_mm + quality.undulation_mm,
        "accuracy_mm": quality.accuracy_mm,
        "height_accuracy_mm": quality.height_accuracy_mm,
        "t_ms": t_ms,
    }
    try:
        return Claim.parse(values)
    except ProofError as error:
        raise NoClaimError(f"no position: {error}") from None


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
