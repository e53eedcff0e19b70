"""Whether a zone's vertical limits reach a band of heights, as far as different references let one say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from wonderland_backend.zones.zone import Limit, Volume

Reaches = Literal["yes", "no", "perhaps"]
GEOID_M: Final = (-107.0, 86.0)
"""Mean sea level above the WGS-84 ellipsoid, anywhere on Earth (EGM2008)."""
GROUND_M: Final = (-550.0, 9_000.0)
"""The ground above the ellipsoid, where it is not known."""


@dataclass(frozen=True)
class Band:
    """Heights from `lower_m` to `upper_m` over a reference; the ground's height above the ellipsoid where known."""

    lower_m: float
    upper_m: float
    reference: str
    ground_m: float | None = None


def reaches(volume: Volume, band: Band) -> Reaches:
    """Whether the volume and the band have a height in common; `perhaps` where the references leave it open."""
    gaps = []
    if volume.lower is not None:
        gaps.append(_difference(volume.lower, Limit(band.upper_m, band.reference), band.ground_m))
    if volume.upper is not None:
        gaps.append(_difference(Limit(band.lower_m, band.reference), volume.upper, band.ground_m))
    if any(least > 0 for least, _ in gaps):
        return "no"
    return "yes" if all(most <= 0 for _, most in gaps) else "perhaps"


def _difference(this: Limit, other: Limit, ground_m: float | None) -> tuple[float, float]:
    """Least and most by which one limit may be above another."""
    if this.reference == other.reference:
        return this.metres - other.metres, this.metres - other.metres
    (least, most), (other_least, other_most) = _ellipsoidal(this, ground_m), _ellipsoidal(other, ground_m)
    return least - other_most, most - other_least


def _ellipsoidal(limit: Limit, ground_m: float | None) -> tuple[float, float]:
    if limit.reference == "WGS84":
        return limit.metres, limit.metres
    least, most = GEOID_M if limit.reference == "AMSL" else GROUND_M if ground_m is None else (ground_m, ground_m)
    return limit.metres + least, limit.metres + most
