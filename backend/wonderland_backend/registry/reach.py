"""How far a pad reaches: the smallest buffer in which it verifies most honest drones, by distance.

From its commissioning alone (``wonderland.proofs.honest``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import cos, pi, sin
from typing import Final

import orjson

from wonderland.proofs.errors import ProofError
from wonderland.proofs.honest import SHARE_PPM, looks_of, share_by
from wonderland.proofs.prospects import Prospect, prospect
from wonderland.proofs.records.pads import Commissioning, Pad
from wonderland.proofs.records.policies import Policy

STEPS: Final = 10
BEARINGS: Final = 4
ABOVE_MM: Final = 5_000
"""The drone's height over the origin: as it comes in to land."""
MIN_BUFFER_MM, MAX_BUFFER_MM = 100, 20_000
_SEARCHES: Final = 6


@lru_cache(maxsize=512)
def reach(pad_record: str, policy_record: str) -> list[dict[str, int]]:
    """Points (distance_mm, buffer_mm); a distance at which nothing can be verified in some direction is left out."""
    try:
        commissioning = Pad.decode(pad_record).commissioning
        policy = Policy.parse(orjson.loads(policy_record))
    except ProofError:
        return []
    if commissioning is None:
        return []
    found = []
    for step in range(1, STEPS + 1):
        distance_mm = commissioning.max_range_mm * step // STEPS
        buffer_mm = _buffer(commissioning, policy, distance_mm)
        if buffer_mm is not None:
            found.append({"distance_mm": distance_mm, "buffer_mm": buffer_mm})
    return found


def _buffer(commissioning: Commissioning, policy: Policy, distance_mm: int) -> int | None:
    """The smallest buffer that is settled within the policy's rounds in every direction, to some hundredths."""
    widest = replace(policy, buffer_mm=MAX_BUFFER_MM)
    places = []
    for bearing in range(BEARINGS):
        angle = 2.0 * pi * bearing / BEARINGS
        east, north = distance_mm * sin(angle), distance_mm * cos(angle)
        found = prospect(commissioning, widest, east, north, float(ABOVE_MM))
        if found is None or found.rounds < 0:
            return None
        places.append(found)
    if not _verifies(places, widest):
        return None
    low, high = float(MIN_BUFFER_MM), float(MAX_BUFFER_MM)
    for _ in range(_SEARCHES):
        middle = (low * high) ** 0.5
        if _verifies(places, replace(policy, buffer_mm=round(middle))):
            high = middle
        else:
            low = middle
    return round(high)


def _verifies(places: Sequence[Prospect], policy: Policy) -> bool:
    most = looks_of(policy)[-1]
    return all(share_by(found, policy, most) * 1_000_000 >= SHARE_PPM for found in places)
