"""The paper's figures again (Fu et al., figures 4 and 5, and its sequence), with what it left out: the ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.patches import Circle, Ellipse

from wonderland_research.paper_points import LONG_ANCHORS, SHORT_ANCHORS, SIGMA_M, PaperRun
from wonderland_research.reproduction.style import (
    BUFFER,
    CLAIM,
    INK,
    LINE,
    MEASURED,
    PAPER,
    QUIET,
    SERIES,
    VERIFIED,
    blank,
    subplots,
)

CHI_99: Final = math.sqrt(9.2103)
"""99 % radius of a circular normal distribution, in standard deviations."""
LANES: Final = ("Drone", "Ledger", "Pad", "Drone, by UWB")
ARROWS: Final = {
    "request": (0, 1, "claim, one-time key"),
    "poll": (2, 3, "code of the session"),
    "match": (3, 3, "codes compared"),
    "reply": (3, 2, "its own code"),
    "range": (3, 2, "rounds of ranges, claims"),
    "confirm": (3, 2, "ranges countersigned"),
    "verdict": (2, 1, "evidence, judged"),
    "permission": (1, 0, "committed event"),
}
"""From lane to lane, and what is carried."""


def positions(results: Sequence[PaperRun]) -> Any:
    """Both distances as the paper draws them, and each point closely: a figure."""
    figure = blank(height_in=6.6)
    grid = figure.add_gridspec(3, 3, width_ratios=(1, 1, 0.95), height_ratios=(1.05, 1, 1))
    short, long = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[:, 2])
    _overview(short, SHORT_ANCHORS, [run for run in results if run.point.anchors == SHORT_ANCHORS])
    _overview(long, LONG_ANCHORS, [run for run in results if run.point.anchors == LONG_ANCHORS])
    short.set_title("Short distance")
    long.set_title("Long distance")
    short.set_xlim(1.2, 5.6)
    short.set_ylim(0.2, 4.3)
    for index, run in enumerate(results):
        _closely(figure.add_subplot(grid[1 + index // 2, index % 2]), run)
    handles: list[Any] = [
        mpl.lines.Line2D([], [], ls="", marker="s", ms=5, color=INK, label="anchors"),
        mpl.lines.Line2D([], [], ls="", marker="o", ms=6, mfc="none", color=CLAIM, label="claim"),
        mpl.lines.Line2D([], [], ls="", marker="D", ms=4.5, color=MEASURED, label="estimate"),
        mpl.lines.Line2D([], [], color=MEASURED, label="1σ"),
        mpl.lines.Line2D([], [], color=MEASURED, ls=":", label="99 %"),
        mpl.lines.Line2D([], [], color=QUIET, ls="--", lw=1, label="Cramér–Rao, 1σ"),
        mpl.patches.Patch(fc=PAPER, alpha=0.35, label="the paper's circle"),
        mpl.patches.Patch(fc=BUFFER, alpha=0.15, ec=BUFFER, label="buffer 1 m"),
    ]
    words = figure.add_subplot(grid[0, 1])
    words.axis("off")
    words.legend(handles=handles, loc="center", labelspacing=0.7)
    return figure


def sequence(results: Sequence[PaperRun]) -> Any:
    """The eight steps between drone, ledger and pad, time downwards (not to scale), and how long each took."""
    figure, (lanes, bars) = subplots(2, 1, height_in=5.9, height_ratios=(3.1, 1))
    names = list(ARROWS)
    depth = {name: 1.0 + index for index, name in enumerate(names)}
    bottom = len(names) + 0.7
    for lane, title in enumerate(LANES):
        lanes.plot([lane, lane], [0.35, bottom], color=LINE, lw=1.5, zorder=0)
        lanes.text(lane, 0.1, title, ha="center", va="center", weight="bold", color=INK)
    for number, name in enumerate(names, start=1):
        start, end, carries = ARROWS[name]
        y = depth[name]
        over_uwb = {start, end} <= {2, 3}
        colour = MEASURED if over_uwb else CLAIM
        if start == end:
            lanes.plot([start], [y], marker="o", ms=6, color=colour, zorder=3)
        else:
            style = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "shrinkA": 2, "shrinkB": 2, "mutation_scale": 11}
            lanes.annotate("", (end, y), (start, y), arrowprops=style)
        middle = (start + end) / 2
        beside = {"ha": "right", "va": "center"} if start == end else {"ha": "center", "va": "bottom"}
        middle = start - 0.07 if start == end else middle
        lanes.text(middle, y if start == end else y - 0.17, carries, **beside, fontsize=8, color=colour)
        lanes.text(-0.62, y, f"{number}  {name}", ha="left", va="center", fontsize=9, color=INK)
        times = [run.steps_ms[name] for run in results if name in run.steps_ms]
        said = "–" if not times else f"{min(times):,}" if min(times) == max(times) else f"{min(times):,}–{max(times):,}"
        lanes.text(4.15, y, said, ha="right", va="center", fontsize=8.5, color=INK)
    lanes.text(4.15, 0.1, "ms since\nrequest", ha="right", va="center", fontsize=8.5, color=QUIET)
    lanes.set_xlim(-0.65, 4.2)
    lanes.set_ylim(bottom, -0.15)
    lanes.axis("off")
    _bars(bars, results, names)
    return figure


def _bars(axis: Any, results: Sequence[PaperRun], names: Sequence[str]) -> None:
    colours = dict(zip(names, (QUIET, *SERIES, VERIFIED), strict=True))
    seen: set[str] = set()
    for row, run in enumerate(results):
        before = 0
        for name in names:
            at = run.steps_ms.get(name)
            if at is None or at <= before:
                continue
            label = None if name in seen else name
            seen.add(name)
            axis.barh(row, (at - before) / 1000, left=before / 1000, height=0.55, color=colours[name], label=label)
            before = at
        axis.text(before / 1000, row, f"  {run.item.verdict.rounds} rounds", va="center", fontsize=8, color=QUIET)
    axis.set_yticks(range(len(results)), [run.point.name for run in results])
    axis.invert_yaxis()
    axis.set_xlabel("seconds since the request")
    axis.set_xlim(right=max(max(run.steps_ms.values()) for run in results) / 1000 * 1.13)
    axis.grid(axis="x")
    axis.legend(loc="upper right", ncols=2, fontsize=7.5)


def _overview(axis: Any, anchors: Sequence[tuple[float, float]], runs: Sequence[PaperRun]) -> None:
    axis.scatter(*zip(*anchors, strict=True), s=14, marker="s", color=INK, zorder=3)
    for run in runs:
        place = run.point.position
        axis.add_patch(Circle(place, 1.0, fc=BUFFER, alpha=0.15))
        axis.add_patch(Circle(place, 1.0, fill=False, ec=BUFFER, lw=1))
        axis.add_patch(Circle(place, run.point.paper_error_m, fc=PAPER, alpha=0.35))
        _measured(axis, run)
        axis.scatter(*place, s=26, facecolors="none", edgecolors=CLAIM, linewidths=1.4, zorder=4)
        axis.annotate(run.point.name, place, xytext=(9, -12), textcoords="offset points", fontsize=8.5, color=INK)
    axis.set_aspect("equal")
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.grid()
    if anchors == LONG_ANCHORS:
        axis.set_xlim(-0.6, 6.6)
        axis.set_ylim(-1.2, 15.6)


def _closely(axis: Any, run: PaperRun) -> None:
    place = run.point.position
    axis.add_patch(Circle(place, 1.0, fc=BUFFER, alpha=0.15))
    axis.add_patch(Circle(place, 1.0, fill=False, ec=BUFFER, lw=1))
    axis.add_patch(Circle(place, run.point.paper_error_m, fc=PAPER, alpha=0.35))
    _measured(axis, run)
    axis.add_patch(_bound(run))
    axis.scatter(*place, s=34, facecolors="none", edgecolors=CLAIM, linewidths=1.6, zorder=4)
    verdict = run.item.verdict
    likelihood = verdict.signed.likelihood_ppm / 1e6 if verdict.signed is not None else math.nan
    axis.set_title(f"{run.point.name}: {verdict.outcome}")
    axis.text(
        place[0], place[1] - 0.93, f"{verdict.rounds} rounds", ha="center", va="bottom", fontsize=7.5, color=QUIET
    )
    axis.text(place[0], place[1] - 0.77, _said(likelihood), ha="center", va="bottom", fontsize=7.5, color=QUIET)
    axis.set_aspect("equal")
    for which, centre in (("x", place[0]), ("y", place[1])):
        axis.set(**{f"{which}lim": (centre - 1.1, centre + 1.1), f"{which}ticks": (centre - 1, centre, centre + 1)})
        axis.set(**{f"{which}ticklabels": ("−1", "claim" if which == "x" else "0", "+1 m" if which == "x" else "+1")})
    axis.tick_params(labelsize=7.5)


def _said(likelihood: float) -> str:
    """Never rounded up to certainty."""
    return "> 0.9999" if likelihood > 0.9999 else f"{likelihood:.4f}"


def _measured(axis: Any, run: PaperRun) -> None:
    verdict = run.item.verdict
    if verdict.estimate is None or verdict.covariance is None:
        return
    here = (verdict.estimate.east_mm / 1000, verdict.estimate.north_mm / 1000)
    covariance = verdict.covariance
    matrix = np.array([[covariance.ee_mm2, covariance.en_mm2], [covariance.en_mm2, covariance.nn_mm2]]) / 1e6
    axis.add_patch(ellipse(here, matrix, 1.0, fill=True, fc=MEASURED, alpha=0.55, lw=0))
    axis.add_patch(ellipse(here, matrix, 1.0, ec=MEASURED, lw=1.6))
    axis.add_patch(ellipse(here, matrix, CHI_99, ec=MEASURED, lw=1.2, ls=":"))
    axis.scatter(*here, marker="D", s=11, color=MEASURED, zorder=5)


def _bound(run: PaperRun) -> Ellipse:
    """The Cramér–Rao bound for the rounds that were ranged, about the true place."""
    here = np.array(run.point.position)
    directions = here - np.array(run.point.anchors)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    least = np.linalg.inv(run.item.verdict.rounds / SIGMA_M**2 * directions.T @ directions)
    return ellipse(run.point.position, least, 1.0, ec=QUIET, lw=1, ls="--")


def ellipse(here: tuple[float, float], covariance: Any, scale: float, **style: Any) -> Ellipse:
    """A covariance (m²) as an outline of so many standard deviations."""
    values, vectors = np.linalg.eigh(covariance)
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    major, minor = (2 * scale * math.sqrt(max(value, 0.0)) for value in (values[1], values[0]))
    return Ellipse(here, major, minor, angle=angle, **{"fill": False, "zorder": 3, **style})
