"""How well anchors watch each other: moves noticed by the self-survey, and by a pad that was commissioned.

    python -m pytest tests/bench/test_commissioning.py -m bench -s -p no:xdist

Four anchors of a pad (3.2 m square, one raised), nodes with σ = 25 mm that report whole centimetres; each row 200 moves
in random directions. Beside the rates stands what no method can do better than: the move over the deviation of ranges.
"""

from __future__ import annotations

import math
import random

import pytest

from wonderland_edge_agent.drift import Baseline, DriftWatch
from wonderland_edge_agent.drift.baseline import summary
from wonderland_edge_agent.self_survey import self_survey

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1_800)]
PLACES = {"A1": (1.6, 1.6, 1.6), "A2": (-1.6, 1.6, 0.25), "A3": (-1.6, -1.6, 0.25), "A4": (1.6, -1.6, 0.25)}
MOVES = 200
LOOK_S = 600
MOST_LOOKS = 30


def ranges(places, rng, rounds, units):
    return {
        (a, b): [
            round((math.dist(places[a], places[b]) + 0.05 + units[a] + units[b] + rng.gauss(0, 0.025)) * 100) * 10
            for _ in range(rounds)
        ]
        for a in places
        for b in places
        if a != b
    }


def moved(by_m, rng):
    name = rng.choice(list(PLACES))
    angle = rng.random() * 2 * math.pi
    x, y, z = PLACES[name]
    return name, {**PLACES, name: (x + by_m * math.cos(angle), y + by_m * math.sin(angle), z)}


def test_moves_that_are_noticed():
    print(f"\n{MOVES} moves each; units differ by 20 mm\n")
    print("  move   self-survey: noticed  named   after commissioning: noticed  named  looks mean  most")
    for by_m in (0.0, 0.03, 0.05, 0.1, 0.2, 0.4):
        noticed = named = watched = right = 0
        looks: list[int] = []
        for number in range(MOVES):
            rng = random.Random(f"{by_m}/{number}")
            units = {name: rng.gauss(0, 0.02) for name in PLACES}
            name, places = moved(by_m, rng)
            measured = {p: v.range_mm / 1000 for p, v in summary(ranges(places, rng, 30, units)).items()}
            found = self_survey(PLACES, measured)
            noticed += not found.agrees
            named += found.suspect is not None and found.suspect.anchor_id == name
            watch = DriftWatch(Baseline.of(ranges(PLACES, rng, 30, units), t_ms=0, source=""), PLACES, LOOK_S)
            for look in range(1, MOST_LOOKS + 1):
                state = watch.judge_pairs(look, summary(ranges(places, rng, 20, units)))
                if state.state != "ok":
                    looks.append(look)
                    watched += 1
                    right += state.anchor_id == name
                    break
        mean = sum(looks) / len(looks) if looks else math.nan
        print(
            f"  {by_m * 100:3.0f} cm {noticed / MOVES:17.0%} {named / MOVES:9.0%} {watched / MOVES:22.0%} "
            f"{right / MOVES:9.0%} {mean:9.1f} {max(looks, default=0):7d}"
        )
