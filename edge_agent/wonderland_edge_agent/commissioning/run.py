"""A calibration run as arrays: rounds, true positions, ranges, and the windows of a second that the fit rests on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wonderland_edge_agent.commissioning.errors import CalibrationError, TruthError
from wonderland_edge_agent.commissioning.recording import Point, Recording

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LONGEST_RANGE_M: Final = 1_000.0
MOST_IMPLAUSIBLE: Final = 0.05
"""Where more of the ranges than this are zero, negative or huge, the recording is of something else."""
BURST_M: Final = 0.15
BURST_SIGMAS: Final = 6.0
"""A range this far from its window's median is a burst, not noise: as the verdict has it (``proofs.reduction``)."""
WINDOW_S: Final = 1.0
"""What stays the same for a second (multipath, antenna, temperature) a hovering drone keeps for a whole session: it is
bias. What changes within it averages out."""
MIN_IN_WINDOW: Final = 4
USUAL_IN_WINDOW: Final = 6.0
"""A window of slow ranges is longer than a second, so that it has as many."""
LONGEST_WINDOW_S: Final = 15.0
"""Less than 0.4 ranges a second of each anchor teach nothing within any run's length."""
TRUTH_GAP_S: Final = 1.0
"""Between two samples of the truth further apart than this nobody knows where the drone was."""
MIN_MOVEMENT_M: Final = 1.0


@dataclass(frozen=True)
class Run:
    """One calibration run of n rounds and a anchors, in metres and seconds. ``range_m`` is NaN where there is none."""

    name: str
    anchor_ids: tuple[str, ...]
    anchors_m: Floats
    """(a, 3)"""
    t_s: Floats
    """(n,)"""
    truth_m: Floats
    """(n, 3)"""
    range_m: Floats
    """(n, a)"""
    implausible: int = 0
    """Ranges left out: zero, negative, or beyond a kilometre."""
    truthless: int = 0
    """Rounds left out: the truth has a gap there."""
    first_path_db: Floats | None = None
    """(n, a) by how much the first path is weaker than everything received; None where the radio does not tell."""

    @property
    def distance_m(self) -> Floats:
        """True distances (n, a)."""
        return distances(self.truth_m, self.anchors_m)

    @property
    def error_m(self) -> Floats:
        """Measured minus true (n, a); NaN where there is no range."""
        return self.range_m - self.distance_m

    @property
    def interval_s(self) -> float:
        """Median time between rounds."""
        return float(np.median(np.diff(self.t_s))) if len(self.t_s) > 1 else 0.0

    @classmethod
    def of(cls, recording: Recording, name: str = "run") -> Run:
        """A recording as arrays. Raises CalibrationError and TruthError for what cannot be calibrated with."""
        names = tuple(recording.anchors)
        ranges = np.array([[item.ranges_m.get(n, np.nan) for n in names] for item in recording.rounds], dtype=float)
        weaker = None
        if any(item.first_path_db for item in recording.rounds):
            weaker = np.array([[item.first_path_db.get(n, np.nan) for n in names] for item in recording.rounds])
        return make_run(
            name,
            names,
            np.array([recording.anchors[n] for n in names], dtype=float),
            np.array([item.t_s for item in recording.rounds]),
            np.array([item.truth_m for item in recording.rounds], dtype=float),
            ranges,
            np.array(recording.track.t_s) - recording.truth_shift_s if recording.track.t_s else None,
            weaker,
        )

    def only(self, rows: Bools) -> Run:
        """Some of its rounds."""
        weaker = None if self.first_path_db is None else self.first_path_db[rows]
        return replace(
            self,
            t_s=self.t_s[rows],
            truth_m=self.truth_m[rows],
            range_m=self.range_m[rows],
            first_path_db=weaker,
        )


def make_run(
    name: str,
    anchor_ids: tuple[str, ...],
    anchors_m: Floats,
    t_s: Floats,
    truth_m: Floats,
    range_m: Floats,
    truth_t_s: Floats | None = None,
    first_path_db: Floats | None = None,
) -> Run:
    """Check and clean. ``truth_t_s``: when the truth was sampled, on the ranges' clock; None: at every round.

    Raises CalibrationError (ranges, movement) and TruthError (no truth at the time of the ranges).
    """
    there = np.isfinite(range_m)
    wrong = there & ((range_m <= 0.0) | (range_m > LONGEST_RANGE_M))
    total, implausible = int(there.sum()), int(wrong.sum())
    if total == 0:
        raise CalibrationError(f"{name}: no range in it")
    if implausible > MOST_IMPLAUSIBLE * total:
        raise CalibrationError(
            f"{name}: {implausible} of {total} ranges are zero, negative or beyond {LONGEST_RANGE_M:.0f} m; "
            "are they metres?"
        )
    range_m = np.where(wrong, np.nan, range_m)
    known = truth_known(t_s, truth_t_s)
    truthless = int((~known).sum())
    if truthless > 0.5 * len(t_s):
        raise TruthError(
            f"{name}: no truth for {truthless} of {len(t_s)} rounds; the reference must cover the time of the ranges "
            "(is it on another clock? --truth-shift moves it)"
        )
    t_s, truth_m, range_m = t_s[known], truth_m[known], range_m[known]
    extent = np.ptp(truth_m, axis=0)
    if float(np.max(extent)) < MIN_MOVEMENT_M:
        raise CalibrationError(
            f"{name}: the drone hardly moved ({np.max(extent):.2f} m); a bias table needs distances: "
            "carry it from the pad outwards as far as it shall be verified, and around it"
        )
    weaker = None if first_path_db is None else first_path_db[known]
    return Run(name, anchor_ids, anchors_m, t_s, truth_m, range_m, implausible, truthless, weaker)


def distances(points_m: Floats, anchors_m: Floats) -> Floats:
    """(n, a) distances between n points and a anchors."""
    return np.asarray(np.linalg.norm(points_m[:, None, :] - anchors_m[None, :, :], axis=2))


@dataclass(frozen=True)
class Windows:
    """Means over windows of a second (longer where ranges are slow): w windows, a anchors. NaN: too few ranges."""

    t_s: Floats
    """Middle of the window, on its run's clock (w,)."""
    run: NDArray[np.int_]
    """Which run (w,)."""
    distance_m: Floats
    """Mean true distance (w, a)."""
    error_m: Floats
    """Mean of measured minus true, without bursts (w, a)."""
    count: NDArray[np.int_]
    """Ranges in it (w, a)."""
    truth_m: Floats
    """Mean true position (w, 3)."""
    values: tuple[Floats, ...]
    """Each window's rounds (r, a), measured minus true; bursts are NaN."""
    rounds: float
    """Median number of ranges that an anchor has in a window."""
    bursts: NDArray[np.int_]
    """Ranges called bursts, by anchor (a,)."""
    ranges: NDArray[np.int_]
    """All ranges, by anchor (a,)."""
    length_s: float = WINDOW_S
    first_path_db: Floats | None = None
    """Mean over the window (w, a)."""


def windows(runs: tuple[Run, ...]) -> Windows:
    """Cut runs into windows. Raises CalibrationError where an anchor has hardly any range."""
    length_s = window_length_s(runs)
    times, owners, dists, errors, counts, truths, values = [], [], [], [], [], [], []
    weaker: list[Floats] = []
    nothing = np.full(len(runs[0].anchor_ids), np.nan)
    bursts = np.zeros(len(runs[0].anchor_ids), dtype=int)
    ranges = np.zeros_like(bursts)
    for index, run in enumerate(runs):
        error, distance = run.error_m, run.distance_m
        bins = np.floor((run.t_s - run.t_s[0]) / length_s).astype(int)
        edges = np.flatnonzero(np.diff(bins)) + 1
        for rows in np.split(np.arange(len(run.t_s)), edges):
            inside, outside = without_bursts(error[rows])
            bursts += outside
            ranges += np.isfinite(error[rows]).sum(axis=0)
            present = np.isfinite(inside)
            count = present.sum(axis=0)
            enough = count >= MIN_IN_WINDOW
            if not enough.any():
                continue
            share = np.maximum(count, 1)
            times.append(float(np.mean(run.t_s[rows])))
            owners.append(index)
            errors.append(np.where(enough, np.where(present, inside, 0.0).sum(axis=0) / share, np.nan))
            dists.append(np.where(present, distance[rows], 0.0).sum(axis=0) / share)
            counts.append(count)
            truths.append(run.truth_m[rows].mean(axis=0))
            values.append(inside)
            weaker.append(nothing if run.first_path_db is None else _means(run.first_path_db[rows], present))
    if not times:
        raise CalibrationError(
            f"no {length_s:.0f} s of the run have {MIN_IN_WINDOW} ranges of an anchor; range at 0.4 Hz or faster "
            "(20 Hz is usual)"
        )
    distance_m, error_m, count = np.array(dists), np.array(errors), np.array(counts)
    distance_m = np.where(np.isfinite(error_m), distance_m, np.nan)
    return Windows(
        np.array(times),
        np.array(owners),
        distance_m,
        error_m,
        count,
        np.array(truths),
        tuple(values),
        float(np.median(count[np.isfinite(error_m)])),
        bursts,
        ranges,
        length_s,
        np.array(weaker) if np.isfinite(weaker).any() else None,
    )


def window_length_s(runs: tuple[Run, ...]) -> float:
    """A second, or as long as the slowest anchor takes for ``USUAL_IN_WINDOW`` ranges."""
    slowest = WINDOW_S / USUAL_IN_WINDOW
    for run in runs:
        for column in run.range_m.T:
            times = run.t_s[np.isfinite(column)]
            if len(times) > MIN_IN_WINDOW:
                slowest = max(slowest, float(np.median(np.diff(times))))
    return float(min(USUAL_IN_WINDOW * slowest, LONGEST_WINDOW_S))


def _means(values: Floats, chosen: Bools) -> Floats:
    """By column, of the values that are chosen and there; NaN where there is none."""
    good = chosen & np.isfinite(values)
    count = good.sum(axis=0)
    total = np.where(good, values, 0.0).sum(axis=0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def without_bursts(values: Floats) -> tuple[Floats, NDArray[np.int_]]:
    """Values with bursts as NaN, and how many those were, by column."""
    out = values.copy()
    found = np.zeros(values.shape[1], dtype=int)
    for column in range(values.shape[1]):
        present = values[np.isfinite(values[:, column]), column]
        if len(present) < 3:
            continue
        median = np.median(present)
        limit = max(BURST_SIGMAS * 1.4826 * float(np.median(np.abs(present - median))), BURST_M)
        bad = np.abs(values[:, column] - median) > limit  # NaN compares false
        out[bad, column] = np.nan
        found[column] = int(bad.sum())
    return out, found


def truth_known(t_s: Floats, truth_t_s: Floats | None) -> Bools:
    """At which times the truth was sampled closely enough; None: at every one."""
    if truth_t_s is None:
        return np.ones(len(t_s), dtype=bool)
    after = np.searchsorted(truth_t_s, t_s, side="left")
    before = np.clip(after - 1, 0, len(truth_t_s) - 1)
    after = np.clip(after, 0, len(truth_t_s) - 1)
    nearest = np.minimum(np.abs(truth_t_s[before] - t_s), np.abs(truth_t_s[after] - t_s))
    return np.asarray(nearest <= TRUTH_GAP_S / 2)


def point(row: Floats) -> Point:
    """A row of an array as a tuple."""
    return (float(row[0]), float(row[1]), float(row[2]))
