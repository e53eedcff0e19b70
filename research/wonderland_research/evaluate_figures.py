"""The drawings of ``wonderland evaluate --report``."""

from __future__ import annotations

import math
import random
import statistics
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.patches import Ellipse
from matplotlib.ticker import FuncFormatter

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.reduction import bias_at
from wonderland_research.evaluate import Window, prepare
from wonderland_research.evaluate_judged import Judged
from wonderland_research.reproduction.sampling import Share
from wonderland_research.reproduction.style import BUFFER, CLAIM, INK, OPEN, QUIET, REFUTED, SERIES, VERIFIED, subplots
from wonderland_simulator.flight import Vector
from wonderland_simulator.recording import RecordedRound

OUTCOMES: Final = (("verified", VERIFIED), ("inconclusive", OPEN), ("refuted", REFUTED))
SIGMAS_95: Final = 2.448
"""Of a normal distribution in the plane, 95 % lies within so many standard deviations."""
MOST_ELLIPSES: Final = 80
LARGEST_ELLIPSE: Final = 0.35
"""Of the drawing's width; larger ones would hide the rest."""
RANDOM_CLAIMS: Final = 6
MOST_WINDOWS: Final = 400
"""Of all recordings, for the calibration."""
REACH_BUFFERS: Final = 3.6
FIFTHS: Final = 5
LARGEST_RESIDUAL_M: Final = 1.5
LEAST_OFF_M: Final = 0.02
"""Smaller errors are drawn there: a logarithm makes much of nothing."""


def path(judged: Judged) -> Any:
    """From above: path, estimates, ellipses, anchors."""
    line = np.array([window.place_m for window in judged.windows])
    if judged.study.recording.has_truth:
        line = np.array([item.truth_m for item in judged.study.recording.rounds[: _seen(judged)]])
    anchors = np.array(list(judged.study.recording.anchors.values()))
    estimated = [window for window in judged.windows if window.estimate_m is not None]
    everything = np.vstack([line[:, :2], anchors[:, :2]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.06 * float(max(high - low)) + 0.5
    wide, tall = (high - low + 2 * margin).tolist()
    figure, axis = subplots(height_in=min(max(6.4 * tall / wide, 2.2), 7.5) + 0.8)
    axis.plot(line[:, 0], line[:, 1], color=CLAIM, lw=1.0, alpha=0.8, zorder=2, label=_reference(judged))
    for window in estimated[:: -(-len(estimated) // MOST_ELLIPSES)] if estimated else []:
        _ellipse(axis, window, max(wide, tall))
    for outcome, colour in OUTCOMES:
        places = np.array([w.estimate_m for w in estimated if w.verdict.outcome == outcome])
        if len(places):
            label = f"{outcome} ({len(places)})"
            axis.scatter(places[:, 0], places[:, 1], s=14, color=colour, lw=0, zorder=4, label=label)
    axis.scatter(anchors[:, 0], anchors[:, 1], marker="^", s=36, color=INK, zorder=5, label="anchors")
    axis.set_xlim(low[0] - margin, high[0] + margin)
    axis.set_ylim(low[1] - margin, high[1] + margin)
    axis.set_aspect("equal", adjustable="box")
    axis.set_xlabel("east (m)")
    axis.set_ylabel("north (m)")
    axis.grid()
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, borderaxespad=0.2, columnspacing=1.2)
    return figure


def likelihood(judged: Judged) -> Any:
    """Likelihood by outcome, and how far the estimate is off, over time."""
    figure, (upper, lower) = subplots(2, 1, height_in=4.4, sharex=True, gridspec_kw={"height_ratios": [1.0, 1.2]})
    for outcome, colour in OUTCOMES:
        chosen = [w for w in judged.windows if w.verdict.outcome == outcome and w.verdict.signed is not None]
        if not chosen:
            continue
        times = [window.at_s for window in chosen]
        upper.scatter(times, [_stated(window) for window in chosen], s=13, color=colour, lw=0, label=outcome)
        lower.scatter(times, [max(_off(window), LEAST_OFF_M) for window in chosen], s=13, color=colour, lw=0, zorder=3)
    upper.axhline(0.99, color=VERIFIED, lw=0.7, ls="--")
    upper.axhline(0.01, color=REFUTED, lw=0.7, ls="--")
    upper.set_ylim(-0.05, 1.05)
    upper.set_ylabel("likelihood")
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
    shown = [window for window in judged.windows if window.estimate_m is not None]
    sigma = [_sigmas(window)[0] for window in shown]
    lower.plot([w.at_s for w in shown], sigma, color=CLAIM, lw=1.0, alpha=0.7, label="stated σ, long axis")
    lower.axhline(judged.study.settings.buffer_m, color=BUFFER, lw=1.0, label="buffer")
    lower.set_yscale("log")
    lower.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    lower.set_ylim(bottom=LEAST_OFF_M)
    lower.set_ylabel(f"estimate to {_reference(judged)} (m)")
    lower.set_xlabel("time (s)")
    lower.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    for axis in (upper, lower):
        axis.grid()
    return figure


def residuals(judged: Judged) -> Any:
    """Each anchor's ranges against the truth (or the claims), beyond its bias table: by distance and over time."""
    names = list(judged.study.recording.anchors)
    figure, axes = subplots(len(names), 2, height_in=0.5 + 1.05 * len(names), sharex="col", sharey=True, squeeze=False)
    known = {anchor.anchor_id: anchor for anchor in judged.study.commissioning.anchors}
    shared = judged.study.commissioning.installation_sigma_mm
    points = {name: _residuals(judged, name) for name in names}
    everything = np.abs(np.array([value for rows in points.values() for _, _, value in rows]))
    top = 100 * min(float(np.quantile(everything, 0.995)) * 1.1, LARGEST_RESIDUAL_M) if len(everything) else 30.0
    for index, name in enumerate(names):
        colour = SERIES[index % len(SERIES)]
        times, away, off = np.array(points[name]).T if points[name] else (np.zeros(0),) * 3
        grid = np.linspace(float(away.min()), float(away.max()), 60) if len(away) else np.zeros(0)
        sigma = np.array([math.hypot(bias_at(known[name], 1000 * d)[1], shared) for d in grid]) / 10
        axes[index][0].fill_between(grid, -sigma, sigma, color=colour, alpha=0.15, lw=0)
        for axis, places in zip(axes[index], (away, times), strict=True):
            axis.axhline(0.0, color=QUIET, lw=0.7)
            axis.scatter(places, 100 * off, s=7, color=colour, lw=0, alpha=0.75)
            axis.set_ylim(-max(top, 10.0), max(top, 10.0))
            axis.grid()
        median = f", median {100 * float(np.median(off)):+.0f} cm".replace("-", "−") if len(off) else ": no ranges"
        axes[index][0].set_title(f"anchor {name}{median}")
    axes[-1][0].set_xlabel("distance (m)")
    axes[-1][1].set_xlabel("time (s)")
    figure.supylabel(f"range − distance to {_reference(judged)} − bias table (cm)", fontsize=9)
    return figure


def reliability(judged: Sequence[Judged]) -> list[tuple[float, Share]]:
    """(mean likelihood stated, how often it was within the buffer) by fifths, of claims at random."""
    rng = random.Random(1)
    every = -(-sum(len(one.windows) for one in judged) // MOST_WINDOWS)
    found: list[tuple[int, float, bool]] = []
    everything = [(one, rounds) for one in judged for rounds in one.study.rounds()]
    for number, (single, rounds) in enumerate(everything[::every]):
        found += [(number, *claim) for claim in _random_claims(single, rounds, rng)]
    out = []
    for fifth in range(FIFTHS):
        chosen = [item for item in found if min(int(item[1] * FIFTHS), FIFTHS - 1) == fifth]
        if chosen:
            right = sum(inside for _, _, inside in chosen) / len(chosen)
            count = len({number for number, _, _ in chosen})  # claims on one window share its errors
            out.append((statistics.fmean(stated for _, stated, _ in chosen), Share(round(right * count), count)))
    return out


def calibration(fifths: Sequence[tuple[float, Share]]) -> Any:
    """Likelihood as stated against how often the drone was within the buffer."""
    figure, axis = subplots(height_in=3.6, width_in=4.2)
    axis.plot([0, 1], [0, 1], color=QUIET, lw=0.8, ls="--")
    for stated, share in fifths:
        low, high = share.interval
        axis.plot([stated, stated], [low, high], color=CLAIM, lw=1.4)
        axis.scatter([stated], [share.value], s=26, color=CLAIM, zorder=3)
        axis.annotate(
            str(share.tries), (stated, high), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=7.5,
            color=QUIET,
        )  # fmt: skip
    axis.set_xlim(-0.03, 1.03)
    axis.set_ylim(-0.03, 1.12)
    axis.set_xlabel("likelihood stated")
    axis.set_ylabel("share truly within the buffer")
    axis.grid()
    return figure


def _random_claims(one: Judged, rounds: Sequence[RecordedRound], rng: random.Random) -> list[tuple[float, bool]]:
    buffer_m = one.study.settings.buffer_m
    found = []
    for _ in range(RANDOM_CLAIMS):
        east, north = (rng.uniform(-REACH_BUFFERS, REACH_BUFFERS) * buffer_m for _ in range(2))

        def said(_: float, truth: Vector, east: float = east, north: float = north) -> Vector:
            return (truth[0] + east, truth[1] + north, truth[2])

        signed = prepare(rounds, one.study.commissioning, one.study.policy, said).verdict().signed
        if signed is not None:
            found.append((signed.likelihood_ppm / 1e6, math.hypot(east, north) <= buffer_m))
    return found


def _residuals(judged: Judged, name: str) -> list[tuple[float, float, float]]:
    """(time, distance, median residual) in s and m of each window in which the anchor was heard."""
    study = judged.study
    anchor = next(item for item in study.commissioning.anchors if item.anchor_id == name)
    found = []
    for rounds in study.rounds():
        values, ways = [], []
        for item in rounds:
            range_m = item.ranges_m.get(name, NO_RANGE / 1000)
            if range_m > 0.0:
                place = item.truth_m if study.recording.has_truth else study.said(item.t_s, item.truth_m)
                away = math.dist(place, study.recording.anchors[name])
                values.append(range_m - away - bias_at(anchor, 1000 * away)[0] / 1000)
                ways.append(away)
        if values:
            found.append((rounds[len(rounds) // 2].t_s, statistics.fmean(ways), statistics.median(values)))
    return found


def _ellipse(axis: Any, window: Window, width_m: float) -> None:
    long, short, turn = _sigmas(window)
    if window.estimate_m is None or 2 * SIGMAS_95 * long > LARGEST_ELLIPSE * width_m:
        return
    colour = dict(OUTCOMES)[window.verdict.outcome]
    size = (2 * SIGMAS_95 * long, 2 * SIGMAS_95 * short)
    axis.add_patch(Ellipse(window.estimate_m, *size, angle=turn, fill=False, ec=colour, lw=0.6, alpha=0.55, zorder=3))


def _sigmas(window: Window) -> tuple[float, float, float]:
    """Standard deviations along the ellipse's axes (m), and how far it is turned (degrees)."""
    covariance = window.verdict.covariance
    if covariance is None:
        return 0.0, 0.0, 0.0
    matrix = np.array([[covariance.ee_mm2, covariance.en_mm2], [covariance.en_mm2, covariance.nn_mm2]], dtype=float)
    values, vectors = np.linalg.eigh(matrix)
    short, long = np.sqrt(np.maximum(values, 0.0)) / 1000
    return float(long), float(short), math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))


def _stated(window: Window) -> float:
    return window.verdict.signed.likelihood_ppm / 1e6 if window.verdict.signed is not None else math.nan


def _off(window: Window) -> float:
    if window.truth_error_m is not None:
        return window.truth_error_m
    return window.verdict.signed.error_mm / 1000 if window.verdict.signed is not None else math.nan


def _reference(judged: Judged) -> str:
    return "truth" if judged.study.recording.has_truth else "claim"


def _seen(judged: Judged) -> int:
    """Rounds that were judged."""
    return max(len(judged.windows) * judged.study.settings.rounds, 2)
