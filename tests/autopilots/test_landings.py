"""A real ArduPilot lands again and again in wind, by the ranges and by its own position, its receiver an ordinary one.

Two of each here; `make landings` flies fifty of each (`WONDERLAND_LANDINGS=FILE`, `WONDERLAND_LANDINGS_COUNT`).
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest
from kit.above_a_pad import above_a_pad
from kit.landings import PARAMETERS, Series

COUNT = int(os.environ.get("WONDERLAND_LANDINGS_COUNT", "2"))
FLIGHT_S = 90

pytestmark = pytest.mark.timeout(240 + 2 * COUNT * FLIGHT_S)


async def test_by_the_ranges_it_lands_in_the_middle_in_any_wind(tmp_path, geoid):
    path = Path(os.environ.get("WONDERLAND_LANDINGS", tmp_path / "landings.jsonl"))
    pad = above_a_pad(tmp_path, geoid, parameters=PARAMETERS, height_m=0, attempts=3)
    async with pad as scene, Series(scene, path) as series:
        flown = await series.fly(COUNT)
    by_ranges, by_itself = ([each for each in flown if each.way == way] for way in ("ranges", "own"))
    assert len(by_ranges) == len(by_itself) >= COUNT
    for landing in by_ranges:
        assert landing.aside_m < 1.0, landing
    wrong = sorted(map(from_its_own, by_itself), reverse=True)
    assert wrong[len(wrong) // 10] < 1.0, "where its receiver has it, but for gusts that are more than it holds"


def from_its_own(landing):
    """How far from where its receiver has the pad's middle (m)."""
    return math.hypot(landing.north_m + landing.receiver_north_m, landing.east_m + landing.receiver_east_m)
