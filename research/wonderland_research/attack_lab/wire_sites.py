"""Where the lab flies on the wire: the demo's three pads, and a site of its own on which two pads watch each other.

At the site a pad demands assurance 4 of who docks, with the second pad, 12 m away, as its witness. A third one stands
there whose anchors somebody turned about its middle after the survey, all together: nothing that it can measure by
itself shows that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland_research.attack_lab.attacks import ATTACKS
from wonderland_simulator.scenario import PADS, AnchorSite, AttackSpec, Behaviour, DroneSpec, PadSite, square

LEVEL: Final = 2
"""What landing demands here."""
TIMED_LEVEL: Final = 3
"""What docking demands at the pad whose nodes share a clock."""
WITNESSED_LEVEL: Final = 4
"""What docking demands where a second pad watches."""
TIMED: Final = (
    "honest",
    "gnss-offset",
    "gnss-drag",
    "delay-line",
    "uniform-stamp-lie",
    "per-anchor-stamp-lie",
    "compromised-anchor",
    "borrowed-identity",
)
"""Flown a second time at level 3."""
WITNESSED: Final = (
    "honest",
    "gnss-offset",
    "delay-line",
    "uniform-stamp-lie",
    "per-anchor-stamp-lie",
    "anchors-turned",
    "borrowed-identity",
)
"""Flown at level 4."""
TURNED_RAD: Final = math.radians(30.0)
_APART_MM: Final = 12_000
_CLOCK_MM: Final = 4
_HOVERS: Final = ((5.5, -6.5, 6.0), (-7.0, 4.0, 5.0), (6.0, 6.0, 6.0), (-6.5, -5.0, 5.5), (4.0, 8.0, 6.0))
_TIMED_HOVERS: Final = ((5.5, -6.5, 6.0), (-7.0, 4.0, 5.0), (6.0, -4.0, 5.0), (-5.0, 4.0, 5.0), (-4.0, 6.5, 5.0))
"""Beside the raised corner: there time differences alone prove a place."""
_BETWEEN: Final = ((6.0, -3.0, 5.0), (6.0, -4.0, 5.0), (5.5, -2.5, 4.5), (6.5, -3.5, 5.5), (6.0, -2.5, 6.0))
"""Where both pads of the site reach: halfway, beside the raised corner of each."""
_TURNED_HOVER: Final = (-6.0, -4.5, 5.0)
"""On the witness's side of the turned pad."""
_FAR: Final = 12.0


def _site(pad_id: str, name: str, east_mm: int, first_mac: int, clocks: tuple[float, ...], raised: int = 0) -> PadSite:
    lat_e7, lon_e7, height_mm = to_wgs84(PADS[1].frame, 400_000 + east_mm, 300_000, 0)
    return PadSite(
        pad_id,
        name,
        lat_e7,
        lon_e7,
        height_mm,
        square(first_mac, 4.0, (0.01, -0.02, 0.0, 0.015), clocks, raised),
        clock_sigma_mm=_CLOCK_MM,
    )


_WITNESS: Final = _site("lab-witness", "Lab, witness", _APART_MM, 0xA040, (0.002, 0.003, -0.004, -0.001), raised=1)
_WATCHED: Final = replace(
    _site("lab-watched", "Lab, watched", 0, 0xA030, (0.003, -0.004, 0.001, 0.0)),
    dock_assurance=WITNESSED_LEVEL,
    witness_pad_id=_WITNESS.pad_id,
)
_SURVEYED: Final = replace(
    _site("lab-turned", "Lab, turned", 2 * _APART_MM, 0xA050, (0.0, 0.003, -0.003, 0.001)),
    dock_assurance=WITNESSED_LEVEL,
    witness_pad_id=_WITNESS.pad_id,
)
"""The turned pad as its survey has it."""


def _turned(site: AnchorSite) -> AnchorSite:
    east, north = turn((site.east_m, site.north_m), TURNED_RAD)
    return replace(site, east_m=east, north_m=north)


def turn(place: tuple[float, float], angle_rad: float) -> tuple[float, float]:
    """A place (east, north) turned about the middle, counter-clockwise."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return (place[0] * cos - place[1] * sin, place[0] * sin + place[1] * cos)


_TURNED: Final = replace(_SURVEYED, anchors=tuple(_turned(site) for site in _SURVEYED.anchors))
SITES: Final = (*PADS, _WATCHED, _WITNESS, _TURNED)


def commissioning(pad: PadSite, now_ms: int) -> Commissioning:
    """What the ledger has of a pad: of the turned one, its survey from before."""
    return (_SURVEYED if pad is _TURNED else pad).commissioning(now_ms)


def policy(pad: PadSite) -> Policy:
    """One metre at every pad, so that each lie is of several buffers."""
    del pad
    return Policy(min_assurance=LEVEL)


def key_of(name: str, level: int) -> str:
    """What a flight is called: the attack, and the level where that is not the plain one."""
    return name if level == LEVEL else f"{name}@{level}"


def parsed(key: str) -> tuple[str, int]:
    """Attack and level of a flight's name."""
    name, _, level = key.partition("@")
    return name, int(level) if level else LEVEL


def sites_for(names: Sequence[str], levels: Sequence[int]) -> tuple[PadSite, ...]:
    """The pads that these flights need: without level 4 and turned anchors the demo's are enough."""
    witnessed = WITNESSED_LEVEL in levels and any(name in WITNESSED for name in names)
    return SITES if witnessed or "anchors-turned" in names else PADS


HONEST: Final = frozenset({"honest", "impostor"})
"""Whose drone is honest: not to get its permission would be the attacker's success."""
_IMPOSTOR_M: Final = (-30.0, 20.0)
"""From where somebody broadcasts the drone's serial number, seen from its hover."""


def drones(
    names: Sequence[str], known: dict[str, tuple[Behaviour, AttackSpec | None]], levels: Sequence[int]
) -> dict[str, DroneSpec]:
    """A drone for each attack and level that is wanted, spread over the pads, each with a place of its own to hover.

    Landing goes to the pads without a common clock, docking at level 3 and 4 to those that have one.
    """
    plain = [pad.pad_id for pad in PADS if pad.clock_sigma_mm is None]
    timed = next(pad.pad_id for pad in PADS if pad.clock_sigma_mm is not None)
    flights: list[tuple[str, int, str, str]] = []
    for number, name in enumerate(names):
        if LEVEL in levels:
            place = _TURNED.pad_id if name == "anchors-turned" else plain[number % len(plain)]
            flights.append((name, LEVEL, place, "land"))
    if TIMED_LEVEL in levels:
        flights += [(name, TIMED_LEVEL, timed, "dock") for name in names if name in TIMED]
    if WITNESSED_LEVEL in levels:
        flights += [
            (name, WITNESSED_LEVEL, (_TURNED if name == "anchors-turned" else _WATCHED).pad_id, "dock")
            for name in names
            if name in WITNESSED
        ]
    result = {}
    for number, (name, level, pad_id, action) in enumerate(flights):
        behaviour, attack = known[name]
        places = {TIMED_LEVEL: _TIMED_HOVERS, WITNESSED_LEVEL: _BETWEEN}.get(level, _HOVERS)
        hover = places[number % len(places)]
        if name == "anchors-turned" and attack is not None:
            # What the pad measures about its survey's frame is turned the other way: the drone claims just that.
            hover = _TURNED_HOVER
            seen = turn(hover[:2], -TURNED_RAD)
            attack = replace(attack, lie_m=(seen[0] - hover[0], seen[1] - hover[1], 0.0))
        away = (hover[0] * _FAR, hover[1] * _FAR, hover[2] + 20.0)
        key = key_of(name, level)
        result[key] = DroneSpec(
            f"LAB-{number:04d}",
            key,
            pad_id,
            action,
            behaviour,
            hover,
            away,
            0.3 * number,
            attack=attack,
            impostor_m=_IMPOSTOR_M if name == "impostor" else None,
        )
    return result


def may_be_granted(name: str, level: int) -> bool:
    """Whether a permission for it is no surprise: it is honest, or its class says that this level does not stop it."""
    return name in HONEST or not ATTACKS[name].stopped_at(level)


def documented(name: str, level: int, *, granted: bool) -> bool:
    """Whether a flight ended as the attack's class says."""
    return granted if name in HONEST else may_be_granted(name, level) or not granted
