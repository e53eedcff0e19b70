"""The delay of a calibration run's truth: clocks that are apart, filters and networks that take their time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from wonderland_edge_agent.commissioning.run import Run, distances

MAX_SHIFT_S: Final = 10.0
"""Clocks that are further apart have to be brought together first."""
NEAR_SHIFT_S: Final = 0.5
"""What filters and networks delay a truth by; more is another clock."""
MIN_SHIFT_S: Final = 0.02
SHIFT_GAIN: Final = 0.10
"""A delay of the truth that makes the errors' spread this much smaller is worth telling."""
CLOCK_GAIN: Final = 0.5
"""A delay beyond ``NEAR_SHIFT_S`` has to explain this much of the spread: some paths nearly repeat themselves."""


def find_shift(runs: Sequence[Run]) -> tuple[float, float]:
    """(best shift of the truth in s, by what share it shrinks the spread), from the run with most movement."""
    run = max(runs, key=lambda item: float(np.ptp(item.truth_m, axis=0).max()))
    now = _roughness(run, 0.0)
    if now <= 0:
        return 0.0, 0.0
    near = _best_shift(run, 0.0)
    coarse = np.arange(-MAX_SHIFT_S, MAX_SHIFT_S + 0.1, 0.2)
    far = float(min(coarse, key=lambda shift: _roughness(run, float(shift))))
    if abs(far) > NEAR_SHIFT_S:
        shift, roughness = _best_shift(run, far)
        if roughness < (1.0 - CLOCK_GAIN) * near[1]:
            near = (shift, roughness)
    return near[0], 1.0 - near[1] / now


def _best_shift(run: Run, about_s: float) -> tuple[float, float]:
    """(shift in s near another, spread with it); no shift where the best is at the edge of what was tried."""
    shifts = about_s + np.linspace(-NEAR_SHIFT_S, NEAR_SHIFT_S, 41)
    scores = [_roughness(run, float(shift)) for shift in shifts]
    best = int(np.argmin(scores))
    if not 0 < best < len(shifts) - 1:
        return 0.0, _roughness(run, 0.0)
    before, here, after = scores[best - 1 : best + 2]
    bend = before - 2 * here + after
    peak = shifts[best] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * (shifts[1] - shifts[0])
    return float(peak), here


def _roughness(run: Run, shift_s: float) -> float:
    """Spread of the errors about their median by distance, were the truth taken ``shift_s`` later."""
    moved = np.stack([np.interp(run.t_s + shift_s, run.t_s, run.truth_m[:, axis]) for axis in range(3)], axis=1)
    distance = distances(moved, run.anchors_m)
    error = run.range_m - distance
    spreads = []
    for column in range(error.shape[1]):
        good = np.isfinite(error[:, column])
        bins = np.floor(distance[good, column] / 2.0).astype(int)
        values = error[good, column]
        centres = {number: float(np.median(values[bins == number])) for number in np.unique(bins)}
        spreads.append(float(np.median(np.abs(values - np.array([centres[number] for number in bins])))))
    return float(np.mean(spreads))
