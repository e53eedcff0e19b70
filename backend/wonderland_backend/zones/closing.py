"""What zones mean for a pad: which ones reach it, and when they close it, as the contract wants it to be told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, radians, sin, sqrt
from typing import Any, Final

import shapely
from shapely.affinity import affine_transform

from wonderland.problems import SaidError, said
from wonderland.proofs.records.closures import MAX_CLOSURES, Closure
from wonderland.proofs.records.fields import ACTIONS
from wonderland_backend.zones.applicability import DAY_MS, Span, Validity, merged, spans
from wonderland_backend.zones.heights import Band, Reaches, reaches
from wonderland_backend.zones.zone import Zone

CLOSING: Final = frozenset({"PROHIBITED"})
"""Types that close a pad. What others demand (an authorisation, a message) the ledger's authorisations answer."""
MIN_AHEAD_MS: Final = 3_600_000
_A: Final = 6_378_137.0
_E2: Final = 0.006_694_379_990_141


class TooManyClosuresError(SaidError):
    """More spans than a record holds, within the next hour."""


@dataclass(frozen=True)
class PadPlace:
    """Where a pad is, and how far it ranges drones."""

    pad_id: str
    lat: float
    lon: float
    height_m: float
    reach_m: float

    @classmethod
    def of(cls, record: dict[str, Any]) -> PadPlace:
        """From the pad's record; its survey counts where it has one."""
        commissioning = record.get("commissioning", {})
        place = commissioning.get("frame", record)
        return cls(
            record["pad_id"],
            place["lat_e7"] / 1e7,
            place["lon_e7"] / 1e7,
            place["height_mm"] / 1000,
            commissioning.get("max_range_mm", 0) / 1000,
        )


@dataclass(frozen=True)
class Touch:
    """A zone that reaches a pad: how far its nearest part is from the pad's middle, and whether its heights do."""

    zone: Zone
    validity: Validity
    distance_m: float
    heights: Reaches

    @property
    def closes(self) -> bool:
        """Whether it forbids landing there while it holds."""
        return self.zone.type in CLOSING


def touching(pad: PadPlace, zones: Iterable[tuple[Zone, Validity]]) -> list[Touch]:
    """The zones that come within the pad's reach, sideways and in height, the nearest first.

    Where references of height leave it open, a zone counts as one that does.
    """
    band = Band(pad.height_m, pad.height_m + pad.reach_m, "WGS84", pad.height_m)
    found = []
    for zone, validity in zones:
        parts = [
            (distance, how)
            for volume in zone.volumes
            if (distance := distance_m(pad, volume.area)) <= pad.reach_m and (how := reaches(volume, band)) != "no"
        ]
        if parts:
            certain = any(how == "yes" for _, how in parts)
            found.append(Touch(zone, validity, min(each for each, _ in parts), "yes" if certain else "perhaps"))
    return sorted(found, key=lambda each: (not each.closes, each.distance_m, each.zone.zone_id))


def distance_m(pad: PadPlace, area: Any) -> float:
    """From the pad to an area, 0 inside of it; better than a metre within a few kilometres."""
    phi = radians(pad.lat)
    root = sqrt(1 - _E2 * sin(phi) ** 2)
    north = radians(_A * (1 - _E2) / root**3)
    east = radians(_A / root * cos(phi))
    lon = pad.lon
    # The same place by the numbers of an area that goes on across the 180th meridian.
    west_end, _, east_end, _ = area.bounds
    lon += 360 * ((lon < west_end - 180) - (lon > east_end + 180))
    local = affine_transform(area, [east, 0, 0, north, -lon * east, -pad.lat * north])
    return float(shapely.distance(local, shapely.Point(0, 0)))


@dataclass(frozen=True)
class Plan:
    """What is to be published for a pad."""

    closures: list[Closure]
    valid_until_ms: int


def plan(touches: Iterable[Touch], now_ms: int, days: int) -> Plan:
    """The closures of whole days (UTC) from today on; for fewer days where they would be too many for a record.

    Raises `TooManyClosuresError`.
    """
    start = now_ms - now_ms % DAY_MS
    until = start + days * DAY_MS
    found = [
        (span, touch.zone.zone_id)
        for touch in touches
        if touch.closes
        for span in spans(touch.zone, start, until, touch.validity)
    ]
    found.sort()
    if len(found) > MAX_CLOSURES:
        until = found[MAX_CLOSURES][0][0]
        found = [each for each in found[:MAX_CLOSURES] if each[0][0] < until]
    if until < now_ms + MIN_AHEAD_MS:
        raise TooManyClosuresError(said("too_many_closures", most=MAX_CLOSURES))
    return Plan(
        [
            Closure(zone_id=zone_id, actions=ACTIONS, from_ms=first, until_ms=min(last, until))
            for (first, last), zone_id in found
        ],
        until,
    )


def same(one: Iterable[Closure], other: Iterable[Closure], from_ms: int, until_ms: int) -> bool:
    """Whether both forbid the same within a span of time."""
    return _spread(one, from_ms, until_ms) == _spread(other, from_ms, until_ms)


def _spread(closures: Iterable[Closure], from_ms: int, until_ms: int) -> dict[tuple[str, str], list[Span]]:
    found: dict[tuple[str, str], list[Span]] = {}
    for each in closures:
        span = max(each.from_ms, from_ms), min(each.until_ms, until_ms)
        if span[0] < span[1]:
            for action in each.actions:
                found.setdefault((each.zone_id, action), []).append(span)
    return {key: merged(each) for key, each in found.items()}
