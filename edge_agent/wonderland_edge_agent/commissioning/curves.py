"""Bias by distance: one curve for each anchor, smooth, drawn towards what the anchors have in common.

Each curve is linear between knots. Two penalties hold it: on changes of slope (a radio's bias does not jump), and on
differences between an anchor's curve and the anchors' mean curve beyond a constant (units of one chip share its shape).
How strong both are is found by cross-validation over blocks of the run, so that no choice has to be believed.
What is fitted is the difference from the chip's published curve, and its level is drawn towards that by as much as
units are known to differ: little data leaves the curve where it was. Windows that do not fit count less (Huber's
weights), those that were obstructed hardly (``sight``): a parked car must not bend a table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wonderland_edge_agent.commissioning import prior
from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.run import Bools, Floats, Windows
from wonderland_edge_agent.commissioning.sight import all_in_sight

MAX_KNOTS: Final = 24
MAX_UNKNOWNS: Final = 240
"""Of all anchors' curves together: sixteen anchors make do with fifteen knots each."""
MIN_SPACING_M: Final = 0.5
WINDOWS_PER_KNOT: Final = 6
"""Seconds of each anchor, on average, between two knots: fewer would draw noise."""
BLOCK_S: Final = 10.0
"""Seconds that follow each other share a place; only blocks this long are held out together."""
FOLDS: Final = 5
SMOOTHNESS: Final = (1e-1, 1e0, 1e1, 1e2, 1e3, 1e4)
SHARING: Final = (1e-1, 1e0, 1e1, 1e2, 1e3)
HUBER: Final = 1.5
WORST_M: Final = 0.3
"""An error beyond this says nothing about a curve, however far beyond."""
_REWEIGHTINGS: Final = 4
_SCALE_FLOOR_M: Final = 0.005
ALIKE_S: Final = 5.0
"""Seconds so long share a place and tell the same: together they weigh as one against what was known before."""
OWN_M: Final = prior.BIAS_SIGMA_MM / 1000
COMMON_M: Final = prior.INSTALLATION_MM / 1000


@dataclass(frozen=True)
class Curves:
    """Bias (m) of a anchors at k distances (m); linear between, constant beyond."""

    knots_m: Floats
    bias_m: Floats
    """(a, k)"""
    smoothness: float
    sharing: float

    def at(self, distance_m: Floats) -> Floats:
        """Bias for distances (n, a), or for the same shape; NaN stays NaN."""
        columns = [np.interp(distance_m[:, i], self.knots_m, bias) for i, bias in enumerate(self.bias_m)]
        return np.where(np.isfinite(distance_m), np.stack(columns, axis=1), np.nan)


def choose_knots(distance_m: Floats) -> Floats:
    """Distances between which each anchor has seconds enough. Raises CalibrationError for a run of one distance."""
    present = np.sort(distance_m[np.isfinite(distance_m)])
    if len(present) < 4 * WINDOWS_PER_KNOT:
        raise CalibrationError(
            f"{len(present)} seconds of ranges, all anchors together; {4 * WINDOWS_PER_KNOT} are the least "
            "(some minutes are usual)"
        )
    low, high = (float(np.quantile(present, share)) for share in (0.002, 0.998))
    most = min(MAX_KNOTS, MAX_UNKNOWNS // distance_m.shape[1])
    spacing = max(MIN_SPACING_M, (high - low) / (most - 1))
    per_knot = WINDOWS_PER_KNOT * distance_m.shape[1]
    knots = [low]
    while True:
        after = present[np.searchsorted(present, knots[-1], side="right") :]
        if len(after) <= per_knot:
            break
        following = max(float(after[per_knot]), knots[-1] + spacing)
        if following > high - spacing / 2:
            break
        knots.append(following)
    if high - knots[-1] > 1e-3:
        knots.append(high)
    return np.array(knots)


def folds(data: Windows) -> NDArray[np.int_]:
    """Which fold each window is held out in: whole runs where there are several, else blocks of time."""
    if data.run.max() > 0:
        return data.run
    span = float(data.t_s[-1] - data.t_s[0])
    block = max(min(BLOCK_S, max(span / (2 * FOLDS), 1.0)), data.length_s)
    return np.asarray(np.floor((data.t_s - data.t_s[0]) / block).astype(int) % FOLDS)


def fit_curves(data: Windows, like: Curves | None = None) -> tuple[Curves, Floats]:
    """The curves, and every window's error with curves that never saw it (w, a): what a later session will see.

    ``like``: curves of much the same data, whose penalties are taken over instead of being found again.
    """
    knots = choose_knots(data.distance_m)
    fold = folds(data)
    if len(np.unique(fold)) < 2:
        raise CalibrationError("the run is too short to hold a part of it out; record for at least a minute")
    tried: dict[tuple[float, float], tuple[float, Floats]] = {}

    def score(smoothness: float, sharing: float) -> float:
        if (smoothness, sharing) not in tried:
            held = _held_out(data, fold, knots, smoothness, sharing)
            tried[smoothness, sharing] = (float(np.nanmean(np.minimum(np.abs(held), WORST_M))), held)
        return tried[smoothness, sharing][0]

    if like is not None:
        bias = _solve(data, np.ones(len(fold), dtype=bool), knots, like.smoothness, like.sharing)
        held = _held_out(data, fold, knots, like.smoothness, like.sharing)
        return Curves(knots, bias, like.smoothness, like.sharing), held

    # One penalty after the other, and the first once more: the two hardly depend on each other.
    sharing = SHARING[len(SHARING) // 2]
    smoothness = min(SMOOTHNESS, key=lambda value: score(value, sharing))
    sharing = min(SHARING, key=lambda value: score(smoothness, value))
    smoothness = min(SMOOTHNESS, key=lambda value: score(value, sharing))
    bias = _solve(data, np.ones(len(fold), dtype=bool), knots, smoothness, sharing)
    return Curves(knots, bias, smoothness, sharing), tried[smoothness, sharing][1]


def chip_bias_m(distance_m: Floats) -> Floats:
    """The chip's published bias; NaN stays NaN."""
    places, bias = np.array(prior.BIAS_M).T
    return np.asarray(np.interp(distance_m, places, bias))


def _held_out(data: Windows, fold: NDArray[np.int_], knots_m: Floats, smoothness: float, sharing: float) -> Floats:
    """Every window's error with curves that never saw its fold (w, a)."""
    held = np.full_like(data.error_m, np.nan)
    for index in np.unique(fold):
        out = fold == index
        bias = _solve(data, ~out, knots_m, smoothness, sharing)
        held[out] = data.error_m[out] - Curves(knots_m, bias, smoothness, sharing).at(data.distance_m[out])
    return held


def _solve(data: Windows, chosen: Bools, knots_m: Floats, smoothness: float, sharing: float) -> Floats:
    """Robust penalised least squares of the windows that are chosen; bias (a, k)."""
    distance_m = data.distance_m[chosen]
    error_m = data.error_m[chosen] - chip_bias_m(distance_m)
    first_path_db = None if data.first_path_db is None else data.first_path_db[chosen]
    anchors, knots = error_m.shape[1], len(knots_m)
    size = anchors * knots
    shape = _penalty(knots_m, anchors, smoothness, sharing)
    known = _known(anchors, knots)
    used = [np.flatnonzero(np.isfinite(error_m[:, i])) for i in range(anchors)]
    shares = [hats(distance_m[rows, i], knots_m) for i, rows in enumerate(used)]
    weights = [np.ones(len(rows)) for rows in used]
    bias: Floats = np.zeros((anchors, knots))
    scale = OWN_M
    for _ in range(_REWEIGHTINGS):
        normal = shape + known * scale**2 * ALIKE_S / data.length_s
        right = np.zeros(size)
        for i, rows in enumerate(used):
            part = slice(i * knots, (i + 1) * knots)
            weighted = shares[i] * weights[i][:, None]
            normal[part, part] += weighted.T @ shares[i]
            right[part] = weighted.T @ error_m[rows, i]
        bias = np.asarray(np.linalg.solve(normal, right).reshape(anchors, knots), dtype=np.float64)
        rests = [error_m[rows, i] - shares[i] @ bias[i] for i, rows in enumerate(used)]
        scale = max(1.4826 * float(np.median(np.abs(np.concatenate(rests)))), _SCALE_FLOOR_M)
        rest = np.full_like(error_m, np.nan)
        for i, rows in enumerate(used):
            rest[rows, i] = rests[i]
        clear = all_in_sight(rest, first_path_db)
        weights = [
            clear[rows, i] * np.minimum(1.0, HUBER * scale / np.maximum(np.abs(rests[i]), 1e-9))
            for i, rows in enumerate(used)
        ]
    return bias + chip_bias_m(knots_m)


def _known(anchors: int, knots: int) -> Floats:
    """What was known before: how much the levels of anchors' curves differ from the chip's, together and each."""
    common = np.full((anchors, anchors), 1.0 / anchors)
    own = np.eye(anchors) - common
    between = own / OWN_M**2 + common / (COMMON_M**2 + OWN_M**2 / anchors) / anchors
    return np.asarray(np.kron(between, np.eye(knots) / knots))


def hats(distance_m: Floats, knots_m: Floats) -> Floats:
    """Linear interpolation as a matrix (n, k)."""
    if len(knots_m) == 1:
        return np.ones((len(distance_m), 1))
    inside = np.clip(distance_m, knots_m[0], knots_m[-1])
    left = np.clip(np.searchsorted(knots_m, inside, side="right") - 1, 0, len(knots_m) - 2)
    share = (inside - knots_m[left]) / (knots_m[left + 1] - knots_m[left])
    out = np.zeros((len(distance_m), len(knots_m)))
    rows = np.arange(len(distance_m))
    out[rows, left] = 1.0 - share
    out[rows, left + 1] += share
    return out


def _penalty(knots_m: Floats, anchors: int, smoothness: float, sharing: float) -> Floats:
    knots = len(knots_m)
    single = np.zeros((knots, knots))
    for middle in range(1, knots - 1):
        before, after = knots_m[middle] - knots_m[middle - 1], knots_m[middle + 1] - knots_m[middle]
        row = np.zeros(knots)
        row[middle - 1], row[middle], row[middle + 1] = 1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after
        row *= (before + after) / 2
        single += smoothness * np.outer(row, row)
    steps = np.diff(np.eye(knots), axis=0)
    shape = sharing * steps.T @ steps if knots > 1 else np.zeros((1, 1))
    apart = np.eye(anchors) - 1.0 / anchors
    return np.kron(np.eye(anchors), single) + np.kron(apart, shape)
