"""Over which way an anchor's bias changes, and how much of it never does: what a moving drone may average out.

The errors of windows that were held out of the fit, of all pairs of windows of a run, by how far apart the drone was:
their correlation falls with that distance d as c + (1 − c)·exp(−d/L) (``proofs.travel`` has what follows from it).
One run cannot show c: what is the same all over went into its curves. So c comes from what differs between runs, and
from experience where there is one run. Both are stated cautiously: c larger and L longer let drones average out less.

Experience: the HYU recordings, 1,850 to 2,640 rounds each, judged with curves of another recording. c was 0.01 in
the same mounting, 0.40 to 0.45 mounted anew (of the variance about the stated bias); L 1.5 to 3 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from wonderland_edge_agent.commissioning.run import WINDOW_S, Floats, Windows
from wonderland_edge_agent.commissioning.spread import Spread

PRIOR_FIXED: Final = 0.25
REMOUNTED_FIXED: Final = 0.5
"""For anchors that are mounted anew between commissioning and use."""
LEAST_FIXED: Final = 0.1
"""Nobody has shown that less stays, and the record holds no less."""
PRIOR_WEIGHT: Final = 4.0
"""Of the prior for c, in means of one anchor over one run."""
PRIOR_LENGTH_M: Final = 3.0
LEAST_LENGTH_M: Final = 2.0
MOST_LENGTH_M: Final = 10.0
CAUTION: Final = 1.0
"""Standard errors by which the correlations are taken for larger than they were seen."""
MIN_WAY_M: Final = 60.0
"""Runs that went less far say nothing about places."""
_EDGES_M: Final = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 14.0)
_TOGETHER_S: Final = 60.0
"""Pairs further apart in time are another matter: temperature, people."""
_CLIP: Final = 4.0
_MOST_WINDOWS: Final = 1_500


@dataclass(frozen=True)
class Places:
    """How biases change over place. ``way_m``: how far the drone was flown or carried for it."""

    length_m: float
    fixed: float
    way_m: float


def find_places(data: Windows, spread: Spread, *, reference_sigma_m: float, remounted: bool) -> Places | None:
    """From held-out errors without what all anchors share; None where the drone went too short a way.

    What the reference itself may be wrong by is part of the stated biases, and counts as the same all over.
    ``remounted``: the anchors are mounted anew between these runs and their use.
    """
    own_m = spread.own_m
    way = _way(data)
    if way < MIN_WAY_M:
        return None
    scale = float(np.nanquantile(np.abs(own_m), 0.9545)) / 2.0
    if not scale > 0.0:
        return None
    z = np.clip(own_m / scale, -_CLIP, _CLIP)
    fixed = max(_fixed(data, z), REMOUNTED_FIXED if remounted else LEAST_FIXED)
    length = _length(data, z, way)
    fixed += (1.0 - fixed) * min(reference_sigma_m**2 / float(np.median(spread.bias_sigma_m**2)), 1.0)
    return Places(length, min(fixed, 1.0), way)


def _way(data: Windows) -> float:
    """Metres, in steps of a second."""
    steps = np.linalg.norm(np.diff(data.truth_m[:, :2], axis=0), axis=1)
    together = (np.diff(data.run) == 0) & (np.diff(data.t_s) < 2.5 * WINDOW_S)
    return float(steps[together].sum())


def _fixed(data: Windows, z: Floats) -> float:
    """c: the variance of each anchor's mean over a run, of the whole; with the prior, and never less than was seen."""
    runs = int(data.run.max()) + 1
    if runs < 2:
        return PRIOR_FIXED
    means = np.array([np.nanmean(z[data.run == run], axis=0) for run in range(runs)])
    seen = float(np.nanmean(means**2)) * runs / (runs - 1) / float(np.nanmean(z**2))
    count = float(z.shape[1] * (runs - 1))
    return max(seen, (PRIOR_WEIGHT * PRIOR_FIXED + count * seen) / (PRIOR_WEIGHT + count))


def _length(data: Windows, z: Floats, way: float) -> float:
    """L of the exp(−d/L) that fits the correlations about each run's means, each taken for larger by its error."""
    z = z.copy()
    for index in range(int(data.run.max()) + 1):
        z[data.run == index] -= np.nanmean(z[data.run == index], axis=0)
    rows = np.arange(0, len(z), -(-len(z) // _MOST_WINDOWS))
    z, place, t_s, run = z[rows], data.truth_m[rows], data.t_s[rows], data.run[rows]
    first, second = np.triu_indices(len(z), 1)
    apart_s = t_s[second] - t_s[first]
    chosen = (run[first] == run[second]) & (apart_s > 1.5 * WINDOW_S) & (apart_s < _TOGETHER_S)
    first, second = first[chosen], second[chosen]
    away = np.linalg.norm(place[first] - place[second], axis=1)
    products = z[first] * z[second]
    there = np.isfinite(products)
    product = np.where(there, products, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1) / np.nanmean(z**2)
    product[~there.any(axis=1)] = np.nan
    middles: list[float] = []
    seen: list[float] = []
    for near, far in pairwise(_EDGES_M):
        inside = (away >= near) & (away < far) & np.isfinite(product)
        if inside.sum() >= 30:
            middle = 0.5 * (near + far)
            error = np.sqrt(2.0 * middle / (way * z.shape[1]))
            middles.append(middle)
            seen.append(float(product[inside].mean()) + CAUTION * error)
    if len(middles) < 4:
        return PRIOR_LENGTH_M
    apart, correlation = np.array(middles), np.array(seen)
    lengths: list[float] = np.arange(LEAST_LENGTH_M, MOST_LENGTH_M + 0.05, 0.1).tolist()
    return min(lengths, key=lambda length: float(np.sum((np.exp(-apart / length) - correlation) ** 2)))
