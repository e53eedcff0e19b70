"""Where a calibration run was, and what its operator should know about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from wonderland_edge_agent.commissioning.plausibility import standing_out
from wonderland_edge_agent.commissioning.run import Floats, Run, Windows
from wonderland_edge_agent.commissioning.shift import MIN_SHIFT_S, SHIFT_GAIN

GAP_M: Final = 2.0
"""A stretch of distances without data that is longer than this is told, and widened in the table."""
SECTORS: Final = 12
OFTEN_OBSTRUCTED: Final = 0.1


@dataclass(frozen=True)
class Note:
    """Something that the operator should know: ``code`` for machines, ``text`` for people."""

    code: str
    text: str


@dataclass(frozen=True)
class Coverage:
    """Where the run was."""

    nearest_m: float
    furthest_m: float
    gaps_m: tuple[tuple[float, float], ...]
    """Distances without data, inside."""
    sectors: tuple[int, ...]
    """Seconds in each sector about the anchors' middle, from east counter-clockwise."""
    seconds: int


def coverage_of(data: Windows, anchors_m: Floats) -> Coverage:
    """Distances and directions of the windows."""
    present = np.sort(data.distance_m[np.isfinite(data.distance_m)])
    jumps = np.flatnonzero(np.diff(present) > GAP_M)
    middle = anchors_m.mean(axis=0)
    offset = data.truth_m - middle
    angles = np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi)
    sectors = np.bincount((angles / (2 * np.pi) * SECTORS).astype(int) % SECTORS, minlength=SECTORS)
    return Coverage(
        float(present[0]),
        float(present[-1]),
        tuple((float(present[i]), float(present[i + 1])) for i in jumps[:6]),
        tuple(int(value) for value in sectors),
        round(len(data.t_s) * data.length_s),
    )


def notes_of(runs: tuple[Run, ...], data: Windows, coverage: Coverage, outliers: Mapping[str, float]) -> list[Note]:
    """What is worth knowing, and refused by nobody."""
    notes: list[Note] = []

    def note(code: str, text: str) -> None:
        notes.append(Note(code, text))

    for low, high in coverage.gaps_m:
        note("gap", f"No data between {low:.1f} and {high:.1f} m; there the table is interpolated and vaguer.")
    if coverage.furthest_m - coverage.nearest_m < 3.0:
        note(
            "short_span",
            f"Distances of {coverage.nearest_m:.1f} to {coverage.furthest_m:.1f} m only; elsewhere the pad verifies "
            "little.",
        )
    seen = sum(seconds > 0 for seconds in coverage.sectors)
    if seen < SECTORS / 2:
        note(
            "bearings",
            f"The run saw {seen} of {SECTORS} directions; how an antenna's bias changes with the rest is not known.",
        )
    for name, away in standing_out(runs, data):
        note(
            "stands_out",
            f"Anchor {name} is off by {away:+.2f} m against the others; is its survey exact, its antenna delay set?",
        )
    for name, share in outliers.items():
        if share > 0.05:
            note("outliers", f"Anchor {name}: {share:.0%} of its ranges are bursts; what obstructs or disturbs it?")
    implausible, truthless = sum(run.implausible for run in runs), sum(run.truthless for run in runs)
    if implausible:
        note("implausible", f"{implausible} ranges were zero, negative or beyond a kilometre and were left out.")
    if truthless:
        note("truth_gaps", f"{truthless} rounds were left out: the truth has gaps there.")
    if data.run.max() == 0:
        note("one_run", "One run cannot show what another day changes; 15 mm are allowed for it. Add a second run.")
    return notes


def notes_of_shift(shift: float, gain: float) -> list[Note]:
    """Of a truth that is late or early by less than is refused."""
    if abs(shift) < MIN_SHIFT_S or gain <= SHIFT_GAIN:
        return []
    older, way = ("late", "higher") if shift > 0 else ("early", "lower")
    text = (
        f"The truth seems {abs(shift):.2f} s {older}: errors would spread {gain:.0%} less with a --truth-shift {way} "
        "by that (auto finds it)."
    )
    return [Note("truth_delayed", text)]
