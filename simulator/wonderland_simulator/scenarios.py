"""The demo's places: a harbour town with its map, and the Finnish sites. The drones and what they do are the same."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from wonderland_simulator.flight import Vector
from wonderland_simulator.scenario import DRONES, PADS, DroneSpec, PadSite

DEFAULT: Final = "harbour"


@dataclass(frozen=True)
class Scenario:
    """Pads, drones, and who runs the pads. ``has_place``: whether `wonderland_simulator.place` makes a map of it."""

    pads: tuple[PadSite, ...]
    drones: tuple[DroneSpec, ...]
    pad_operator: str
    has_place: bool


_SITES: Final[dict[str, tuple[str, str, int, int, int]]] = {
    "aurajoki-2": ("hatter-quay", "Hatter Quay", 437_344_100, 74_278_400, 51_500),
    "satama-1": ("looking-glass-mole", "Looking-Glass Mole", 437_398_500, 74_315_500, 51_000),
    "kupittaa": ("cheshire-heliport", "Cheshire Heliport", 437_259_300, 74_198_500, 53_000),
}
"""Finnish pad → id, name, latitude and longitude (10⁻⁷ °), height above the ellipsoid (mm) of one in Monaco.

They stand at quays and at the heliport; names and operators are nobody's there.
"""

_ROUTES: Final[dict[str, tuple[Vector, ...]]] = {
    "OH-DRN-0233": ((-250.0, 190.0, 58.0), (-130.0, 80.0, 40.0), (-40.0, 10.0, 18.0)),
    "OH-DRN-0417": ((120.0, 290.0, 66.0), (60.0, 150.0, 42.0), (12.0, 55.0, 18.0)),
    "OH-DRN-0736": ((-90.0, -270.0, 80.0), (-10.0, -140.0, 52.0), (6.0, -52.0, 20.0)),
    "OH-DRN-0281": ((-300.0, 40.0, 55.0), (-150.0, 42.0, 38.0), (-48.0, 22.0, 18.0)),
    "OH-DRN-0377": ((-250.0, 150.0, 70.0), (-120.0, 78.0, 44.0), (-45.0, 26.0, 18.0)),
    "OH-DRN-0871": ((140.0, 270.0, 55.0), (70.0, 140.0, 38.0), (24.0, 50.0, 18.0)),
    "OH-DRN-0102": ((-60.0, -290.0, 62.0), (30.0, -150.0, 40.0), (16.0, -52.0, 18.0)),
    "OH-DRN-0559": ((-190.0, 230.0, 74.0), (-90.0, 118.0, 46.0), (-34.0, 46.0, 18.0)),
    "OH-DRN-0118": ((260.0, 190.0, 50.0), (130.0, 96.0, 36.0), (46.0, 36.0, 18.0)),
    "OH-DRN-0640": ((-210.0, 210.0, 64.0), (-110.0, 110.0, 42.0), (-42.0, 40.0, 18.0)),
    "OH-DRN-0925": ((130.0, -260.0, 58.0), (62.0, -130.0, 38.0), (22.0, -50.0, 18.0)),
}
"""Drone → its way in, metres in its pad's frame: a roof, then a corridor over quays and water down to the pad."""


def _moved(drone: DroneSpec) -> DroneSpec:
    away, *corridor = _ROUTES[drone.uav_id]
    return replace(drone, pad_id=_SITES[drone.pad_id][0], away_m=away, corridor_m=tuple(corridor))


def _at(pad: PadSite) -> PadSite:
    pad_id, name, lat_e7, lon_e7, height_mm = _SITES[pad.pad_id]
    return replace(pad, pad_id=pad_id, name=name, lat_e7=lat_e7, lon_e7=lon_e7, height_mm=height_mm)


SCENARIOS: Final[dict[str, Scenario]] = {
    "harbour": Scenario(
        tuple(_at(pad) for pad in PADS), tuple(_moved(drone) for drone in DRONES), "wonderland-skyports", has_place=True
    ),
    "turku": Scenario(PADS, DRONES, "skyport-turku", has_place=False),
}
