"""Drawings of what real ranges showed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from wonderland_research.reproduction.hyu import BUFFER_M, DISTANCES_M, RANDOM, HyuResult, Judged
from wonderland_research.reproduction.sampling import Share
from wonderland_research.reproduction.style import CLAIM, INK, OPEN, PAPER, QUIET, REFUTED, SERIES, VERIFIED, subplots

KNOWN: Final = {
    "none": "not calibrated",
    "part": "calibrated, held-out part",
    "other": "calibration of the other mounting",
}
SHORT: Final = {"none": "Not calibrated", "part": "Held-out part", "other": "Other mounting"}
DECILES: Final = 5
"""Fifths: the recordings are too short for tenths."""
_LABELS: Final = [f"{near:.0f}–{far:.0f} m" for near, far in DISTANCES_M]


def bias(result: HyuResult) -> Any:
    """How bias grows with distance: standing series, and the tables fitted on one part with what the other showed."""
    figure, (left, right) = subplots(1, 2, height_in=3.1)
    for condition, colour in (("LOS", CLAIM), ("NLOS", PAPER)):
        series = np.array([row[1:] for row in result.static if row[0] == condition])
        if not series.size:
            continue
        left.scatter(series[:, 0], series[:, 1], s=5, color=colour, alpha=0.3, linewidths=0)
        edges = np.arange(0.0, 64.0, 4.0)
        bins = np.digitize(series[:, 0], edges)
        middles = [(edges[b - 1] + 2, float(np.median(series[bins == b, 1]))) for b in np.unique(bins)]
        left.plot(*zip(*middles, strict=True), color=colour, lw=1.8, label=f"{condition}, median of 4 m")
    left.set_title("Standing series")
    left.set_xlabel("true distance (m)")
    left.set_ylabel("mean error of the range (m)")
    left.set_ylim(-0.2, 1.0)
    left.grid()
    left.legend(loc="upper left")

    fit = result.fits["los"]
    for index, name in enumerate(fit.anchor_ids):
        table = fit.table(index)
        distance = np.array([point.range_mm for point in table]) / 1000
        mean = np.array([point.bias_mm for point in table]) / 1000
        sigma = np.array([point.sigma_mm for point in table]) / 1000
        colour = SERIES[index % len(SERIES)]
        right.plot(distance, mean, color=colour, lw=1.6, label=f"anchor {name}")
        right.fill_between(distance, mean - sigma, mean + sigma, color=colour, alpha=0.13, lw=0)
        column = fit.anchor_ids.index(name)
        far, error = result.held.distance_m[:, column], result.held.error_m[:, column]
        good = np.isfinite(error) & (np.abs(error) < 0.6)
        edges = np.arange(0.0, 56.0, 4.0)
        bins = np.digitize(far[good], edges)
        points = [
            (float(far[good][bins == b].mean()), float(np.median(error[good][bins == b])))
            for b in np.unique(bins)
            if (bins == b).sum() >= 15
        ]
        right.scatter(*zip(*points, strict=True), s=16, color=colour, edgecolors="white", linewidths=0.5, zorder=3)
    right.set_title("Lines: fitted; dots: held out")
    right.set_xlabel("distance (m)")
    right.set_ylim(-0.25, 0.5)
    right.grid()
    right.legend(loc="upper left", ncols=2)
    return figure


def by_distance(result: HyuResult) -> Any:
    """What happened to honest claims and to lies of two buffers, by distance, for both recordings."""
    figure, axes = subplots(2, 2, height_in=5.2, sharex=True, sharey=True)
    for row, recording in enumerate(result.singles):
        single = result.singles[recording]
        for column, (title, claims) in enumerate((("honest claims", ("truth",)), ("2 m lies across", ("across 2",)))):
            axis = axes[row][column]
            lie = 0.0 if claims == ("truth",) else 2.0
            outcome, word = ("verified", "verified") if not lie else ("refuted", "refuted")
            groups = [
                (f"{word}, not calibrated", OPEN, _shares(result, recording, "none", claims, outcome)),
                (
                    f"{word}, calibrated",
                    VERIFIED if not lie else REFUTED,
                    _shares(result, recording, "part", claims, outcome),
                ),
                (
                    "paper's rule accepts, one round",
                    PAPER,
                    [_single(single, near, far, lie) for near, far in DISTANCES_M],
                ),
            ]
            for offset, (label, colour, shares) in enumerate(groups):
                _points(axis, offset, label, colour, shares)
            axis.set_title(f"{recording.upper()}: {title}")
            axis.set_xticks(range(len(DISTANCES_M)), _LABELS)
            axis.set_ylim(-0.04, 1.04)
            axis.grid(axis="y")
            if column == 0:
                axis.set_ylabel("share of windows")
    for column in (0, 1):
        handles, labels = axes[0][column].get_legend_handles_labels()
        axes[1][column].legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=1)
    return figure


def calibration(result: HyuResult) -> Any:
    """Likelihood as stated against how often the drone was within the buffer, with intervals."""
    known = [name for name in KNOWN if result.select(known=name)]
    figure, axes = subplots(1, len(known), height_in=2.9, sharey=True, squeeze=False)
    for axis, name in zip(axes[0], known, strict=True):
        axis.plot([0, 1], [0, 1], color=QUIET, lw=0.8, ls="--")
        for stated, share in reliability(result.select(known=name, claim=RANDOM)):
            low, high = share.interval
            axis.plot([stated, stated], [low, high], color=CLAIM, lw=1.2)
            axis.scatter([stated], [share.value], s=20, color=CLAIM, zorder=3)
            axis.annotate(
                str(share.tries),
                (stated, high),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                fontsize=7,
                color=QUIET,
            )
        axis.set_title(SHORT[name])
        axis.set_xlabel("likelihood stated")
        axis.set_xlim(-0.03, 1.03)
        axis.set_ylim(-0.03, 1.12)
        axis.grid()
    axes[0][0].set_ylabel("share truly within 1 m")
    return figure


def reliability(windows: Sequence[Judged]) -> list[tuple[float, Share]]:
    """(mean stated, share truly within the buffer) for each fifth of likelihoods that has windows.

    Claims on one window share its errors. So the share counts windows, not claims, and its interval is that of as many.
    """
    rows = []
    judged = [one for one in windows if one.likelihood >= 0.0]  # no estimate, no likelihood
    for fifth in range(DECILES):
        chosen = [one for one in judged if min(int(one.likelihood * DECILES), DECILES - 1) == fifth]
        if chosen:
            stated = sum(one.likelihood for one in chosen) / len(chosen)
            right = sum(one.lie_m <= BUFFER_M for one in chosen) / len(chosen)
            count = len({one.window for one in chosen})
            rows.append((stated, Share(round(right * count), count)))
    return rows


def _shares(result: HyuResult, recording: str, known: str, claims: Sequence[str], outcome: str) -> list[Share]:
    windows = [one for one in result.select(recording=recording, known=known) if one.claim in claims]
    return [
        result.share(outcome, [one for one in windows if near <= one.distance_m < far]) for near, far in DISTANCES_M
    ]


def _single(single: Any, near: float, far: float, lie_m: float) -> Share:
    """Lies to either side, taken together."""
    left, right = single.accepted(near, far, lie_m), single.accepted(near, far, -lie_m)
    return Share(left.count + right.count, left.tries + right.tries) if lie_m else left


def _points(axis: Any, offset: int, label: str, colour: str, shares: Sequence[Share]) -> None:
    for index, share in enumerate(shares):
        if not share.tries:
            continue
        x = index + (offset - 1) * 0.2
        low, high = share.interval
        axis.plot([x, x], [low, high], color=colour, lw=1.2)
        axis.scatter(
            [x], [share.value], s=24, color=colour, zorder=3, label=label if index == 0 else None, ec=INK, lw=0.3
        )
