"""Whether what a run shows can be the bias of UWB radios at all; if not, what it looks like and what to check.

A table can be fitted to anything: to a stuck radio, to feet, to two anchors that were exchanged. It would look like
knowledge, and a verdict would rest on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.run import Bools, Floats, Run, Windows, distances

LARGEST_BIAS_M: Final = 1.0
"""DW1000 and DW3000 are off by up to 0.3 m, and by 0.5 m with the antenna delay as delivered."""
LARGEST_SLOPE: Final = 0.1
"""Metres of bias for each metre of distance; radios show 0.02 at most."""
STUCK_SLOPE: Final = -0.5
"""Errors that fall so fast with distance are of ranges that do not follow it: -1 is a range that never changes."""
LARGEST_SCATTER_M: Final = 0.5
"""Of means over a second about a line by distance. Obstructed drones show 0.1 m."""
SLOPE_SPAN_M: Final = 2.0
"""Distances within less than this tell no slope."""
STANDS_OUT_M: Final = 0.3
"""An anchor this much further off than the others has something of its own."""
EXCHANGED_M: Final = 0.2
"""Two anchors nearer to each other than this, seen from the drone, are not told apart."""
METRES_PER_UNIT: Final = {"feet": 0.3048, "centimetres": 0.01, "millimetres": 0.001, "yards": 0.9144}
MOST_RAISED_M: Final = 5.0
RAISED_STEP_M: Final = 0.1
RAISED_SHARE: Final = 0.4
"""Raised, the truth has to leave less than this share of the misfit."""
_REWEIGHTINGS: Final = 8


@dataclass(frozen=True)
class Line:
    """An anchor's errors by distance, as a line."""

    anchor_id: str
    near_m: float
    """Bias at the nearest distances of the run."""
    far_m: float
    slope: float
    scatter_m: float

    @property
    def stuck(self) -> bool:
        """Whether its ranges do not follow the distance."""
        return self.slope < STUCK_SLOPE

    @property
    def worst_m(self) -> float:
        """The larger of both ends."""
        return max(self.near_m, self.far_m, key=abs)

    @property
    def absurd(self) -> bool:
        """Whether no radio has such a bias."""
        return (
            abs(self.worst_m) > LARGEST_BIAS_M or abs(self.slope) > LARGEST_SLOPE or self.scatter_m > LARGEST_SCATTER_M
        )

    def text(self) -> str:
        """One line for the operator."""
        if self.stuck:
            return f"anchor {self.anchor_id}: its ranges do not follow the distance"
        if self.scatter_m > LARGEST_SCATTER_M:
            return f"anchor {self.anchor_id}: errors scatter by {self.scatter_m:.1f} m"
        return f"anchor {self.anchor_id}: {self.near_m:+.1f} m near, {self.far_m:+.1f} m far"


def check_plausible(runs: Sequence[Run], data: Windows) -> None:
    """Refuse what no radio shows. Raises CalibrationError, which names the anchors and what to check."""
    for index, run in enumerate(runs):
        rows = data.run == index
        if not rows.any():
            continue
        exchanged = _exchanged(run, data, rows)
        if exchanged:
            raise CalibrationError(
                f"{run.name}: the ranges of anchors {said(exchanged)} fit each other's places: exchanged in "
                "the survey, or their nodes (addresses) on the pad; or are the reference's axes exchanged or mirrored?"
            )
        lines = _lines(run, data, rows)
        absurd = [line for line in lines if line.absurd]
        if absurd:
            raised_m = _raised(run, data, rows)
            raise CalibrationError(
                f"{run.name}: {'; '.join(line.text() for line in absurd)}. {_advice(lines, absurd, raised_m)}"
            )


def said(names: Sequence[str]) -> str:
    """Names for people: a, b and c."""
    return " and ".join([*([", ".join(names[:-1])] if len(names) > 1 else []), names[-1]])


def standing_out(runs: Sequence[Run], data: Windows) -> list[tuple[str, float]]:
    """(anchor, m) of anchors whose bias is plausible, but far from the others'."""
    level = np.array([float(np.nanmedian(data.error_m[:, index])) for index in range(data.error_m.shape[1])])
    away = level - np.median(level)
    return [
        (name, float(value)) for name, value in zip(runs[0].anchor_ids, away, strict=True) if abs(value) > STANDS_OUT_M
    ]


def _lines(run: Run, data: Windows, rows: Bools) -> list[Line]:
    out = []
    for index, name in enumerate(run.anchor_ids):
        distance, error = data.distance_m[rows, index], data.error_m[rows, index]
        good = np.isfinite(error)
        if good.any():
            out.append(_line(name, distance[good], error[good]))
    return out


def _line(name: str, distance_m: Floats, error_m: Floats) -> Line:
    """A robust line (Huber's weights), without slope where the distances are all alike."""
    low, high = (float(np.quantile(distance_m, share)) for share in (0.05, 0.95))
    middle = float(np.median(distance_m))
    columns = [np.ones_like(distance_m)]
    if high - low >= SLOPE_SPAN_M:
        columns.append(distance_m - middle)
    design = np.stack(columns, axis=1)
    weights = np.ones_like(error_m)
    found: Floats = np.zeros(len(columns))
    scatter = 0.0
    for _ in range(_REWEIGHTINGS):
        root = np.sqrt(weights)
        found = np.asarray(np.linalg.lstsq(design * root[:, None], error_m * root, rcond=None)[0], dtype=np.float64)
        rest = np.abs(error_m - design @ found)
        scatter = 1.4826 * float(np.median(rest))
        weights = np.minimum(1.0, 1.5 * max(scatter, 0.005) / np.maximum(rest, 1e-9))
    slope = float(found[1]) if len(found) > 1 else 0.0
    level = float(found[0])
    return Line(name, level + slope * (low - middle), level + slope * (high - middle), slope, scatter)


def _raised(run: Run, data: Windows, rows: Bools) -> float:
    """Metres by which the truth has to be raised for the ranges to fit; 0 where no height does, or another unit."""
    truth = data.truth_m[rows]
    ranges = data.distance_m[rows] + data.error_m[rows]

    def misfit(up_m: float, scale: float) -> float:
        away = distances(truth + np.array((0.0, 0.0, up_m)), run.anchors_m) * scale
        error = ranges - away
        return float(np.nanmedian(np.abs(error - np.nanmedian(error, axis=0))))

    tried = np.arange(-MOST_RAISED_M, MOST_RAISED_M + RAISED_STEP_M / 2, RAISED_STEP_M)
    costs = [misfit(float(up_m), 1.0) for up_m in tried]
    best = int(np.argmin(costs))
    units = min(misfit(0.0, 1.0 / metres) for metres in METRES_PER_UNIT.values())
    as_it_is = misfit(0.0, 1.0)
    raised_m = float(tried[best])
    clear = costs[best] < RAISED_SHARE * as_it_is and costs[best] < units and 0 < best < len(tried) - 1
    return raised_m if clear else 0.0


def _advice(lines: Sequence[Line], absurd: Sequence[Line], raised_m: float) -> str:
    limit = f"Radios are off by {LARGEST_BIAS_M:g} m at most."
    if len(absurd) == 1 and len(lines) > 1:
        if absurd[0].stuck:
            return f"{limit} The others follow: is its node stuck, or does it range something else?"
        return f"{limit} The others agree: was it surveyed at another place, or does its node range badly?"
    if any(line.stuck for line in absurd):
        return (
            "Are the nodes stuck, are these ranges of another tag, or is the reference of another run? Look at the "
            "ranges in the recording"
        )
    if raised_m != 0.0:
        side = "low" if raised_m > 0.0 else "high"
        return f"The truth seems {abs(raised_m):.1f} m too {side}: try --truth-raise {raised_m:.1f}"
    factor = 1.0 + float(np.median([line.slope for line in lines]))
    unit = next((name for name, metres in METRES_PER_UNIT.items() if abs(factor * metres - 1.0) < 0.05), None)
    if unit is not None:
        return f"Ranges grow {factor:.2f} m for each metre: they are {unit}; a recording has metres"
    if any(line.scatter_m > LARGEST_SCATTER_M for line in absurd):
        return (
            "Is the reference on the clock of the ranges (--truth-shift auto finds up to 10 s), and in the survey's "
            "frame (origin, axes)?"
        )
    if abs(factor - 1.0) > LARGEST_SLOPE:
        return f"Ranges grow {factor:.2f} m for each metre: are ranges, reference and survey all in metres?"
    return (
        f"{limit} Is the antenna delay of the nodes set, are the addresses those of the survey, and is the reference "
        "in the survey's frame (origin, axes, --truth-raise)?"
    )


def _exchanged(run: Run, data: Windows, rows: Bools) -> list[str]:
    """Anchors whose ranges fit each other's places and not their own: two, or more in a ring. One alone has moved."""
    ranges = data.distance_m[rows] + data.error_m[rows]
    away = distances(data.truth_m[rows], run.anchors_m)
    count = len(run.anchor_ids)
    cost = np.zeros((count, count))
    for index in range(count):
        good = np.isfinite(ranges[:, index])
        if not good.any():
            return []
        cost[index] = np.median(np.abs(ranges[good, index, None] - away[good]), axis=0)
    _, place = linear_sum_assignment(cost)
    for ring in _rings(place.tolist()):
        own, best = cost[ring, ring], cost[ring, place[ring]]
        if len(ring) > 1 and bool(np.all((own > EXCHANGED_M) & (best < 0.5 * own))):
            return [run.anchor_ids[index] for index in sorted(ring)]
    return []


def _rings(place: Sequence[int]) -> list[list[int]]:
    """A permutation's cycles."""
    rings: list[list[int]] = []
    seen: set[int] = set()
    for first in range(len(place)):
        ring: list[int] = []
        index = first
        while index not in seen:
            seen.add(index)
            ring.append(index)
            index = place[index]
        if ring:
            rings.append(ring)
    return rings
