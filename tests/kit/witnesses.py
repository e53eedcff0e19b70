"""Two pads with clocks: their anchors, and what each stamps of a drone's frames."""

from __future__ import annotations

import math
import random

from kit.contract import HERE
from wonderland.proofs.differences import MM_PER_TICK

PAD_ANCHORS = {"A0": (1500, 1500, 1200), "A1": (-1500, 1500, 200), "A2": (-1500, -1500, 200), "A3": (1500, -1500, 200)}
WITNESS_ANCHORS = {
    "W0": (7500, 1500, 1200),
    "W1": (4500, 1500, 200),
    "W2": (4500, -1500, 200),
    "W3": (7500, -1500, 200),
}


def anchors(places):
    return [
        {
            "anchor_id": name,
            "mac": 0xA100 + index,
            "east_mm": place[0],
            "north_mm": place[1],
            "up_mm": place[2],
            "survey_sigma_mm": 3,
            "bias": [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 5}],
            "clock_sigma_mm": 5,
        }
        for index, (name, place) in enumerate(places.items())
    ]


def stamps(scene, places, truth=HERE, frames=40, bound_by="challenge"):
    noise = random.Random(frames)
    columns = {name: [] for name in places}
    for _ in range(frames):
        heard = {name: (math.dist(truth, at) + noise.gauss(0, 30)) / MM_PER_TICK for name, at in places.items()}
        for name, ticks in heard.items():
            columns[name].append(round(ticks - min(heard.values())))
    return {
        "start_ms": scene.now_ms + 100,
        "gap_ms": [0] + [50] * (frames - 1),
        "anchors": [{"anchor_id": name, "ticks": ticks} for name, ticks in columns.items()],
        "bound_by": bound_by,
    }
