"""Drawings of what was simulated: who is verified and who refuted, how soon, and how true the likelihood is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wonderland_research.reproduction.goals import Simulated
from wonderland_research.reproduction.sampling import BUFFER_MM, L1_ONE_ROUND_MM
from wonderland_research.reproduction.style import BUFFER, CLAIM, OPEN, PAPER, QUIET, REFUTED, VERIFIED, subplots


def operating(result: Simulated) -> Any:
    """Left: how sessions at L1 end, by how far the drone is from its claim. Right: rounds until they do."""
    figure, (left, right) = subplots(1, 2, height_in=3.0, width_ratios=(1.35, 1))
    offsets = np.array([offset for offset, _ in result.curve]) / 1000
    verified = np.array([one.verified.value for _, one in result.curve])
    refuted = np.array([one.refuted.value for _, one in result.curve])
    left.axvspan(0, BUFFER_MM / 1000, color=BUFFER, alpha=0.12, lw=0)
    left.fill_between(offsets, verified, color=VERIFIED, alpha=0.12, lw=0)
    left.fill_between(offsets, 1 - refuted, 1, color=REFUTED, alpha=0.1, lw=0)
    left.plot(offsets, verified, color=VERIFIED, lw=1.8, label="verified")
    left.plot(offsets, 1 - refuted, color=REFUTED, lw=1.8, label="1 − refuted")
    paper = [_paper_rule(offset * 1000) for offset in offsets]
    left.plot(offsets, paper, color=PAPER, lw=1.3, ls="--", label="paper's rule accepts, one round")
    left.text(1.1, 0.62, "inconclusive", color=QUIET, fontsize=8, ha="center", va="center", rotation=90)
    left.set_xlabel("drone's distance from its claim (m)")
    left.set_ylabel("share of sessions")
    left.set_title("How sessions end at 13 m")
    left.set_xlim(0, offsets[-1])
    left.set_ylim(0, 1.01)
    left.grid()
    left.legend(loc="center right", bbox_to_anchor=(1.0, 0.62))

    right.axvspan(0, BUFFER_MM / 1000, color=BUFFER, alpha=0.12, lw=0)
    right.plot(offsets, [one.mean_rounds for _, one in result.curve], color=CLAIM, lw=1.8)
    right.set_xlabel("drone's distance from its claim (m)")
    right.set_title("Rounds, mean")
    right.set_xlim(0, offsets[-1])
    right.set_ylim(0, 165)
    right.grid()
    return figure


def calibration(result: Simulated) -> Any:
    """Likelihood stated against observed, and the difference in points."""
    figure, (left, right) = subplots(1, 2, height_in=2.8)
    stated = [one.stated for one in result.deciles]
    seen = [one.observed.value for one in result.deciles]
    left.plot([0, 1], [0, 1], color=QUIET, lw=0.8, ls="--")
    left.scatter(stated, seen, s=22, color=CLAIM, zorder=3, label="estimates drawn")
    told = [one for one in result.decided.deciles if one.observed.tries]
    left.scatter(
        [one.stated for one in told], [one.observed.value for one in told],
        s=22, marker="s", fc="none", ec=REFUTED, zorder=4, label="the contract's decision",
    )  # fmt: skip
    for one in told:
        left.plot([one.stated] * 2, one.observed.interval, color=REFUTED, lw=0.9)
    left.legend(loc="upper left", fontsize=7.5)
    left.set_xlabel("likelihood stated")
    left.set_ylabel("share truly within 1 m")
    left.set_title("Likelihood")
    left.grid()
    right.axhspan(-2, 2, color=BUFFER, alpha=0.12, lw=0)
    right.axhline(0, color=QUIET, lw=0.8)
    for one in result.deciles:
        low, high = one.observed.interval
        right.plot([one.stated] * 2, [(low - one.stated) * 100, (high - one.stated) * 100], color=CLAIM, lw=1.4)
        right.scatter([one.stated], [(one.observed.value - one.stated) * 100], s=20, color=CLAIM, zorder=3)
    right.set_xlabel("likelihood stated")
    right.set_ylabel("observed − stated (points)")
    right.set_title("Difference; goal: within 2 points")
    right.grid()
    return figure


def edges(result: Simulated) -> Any:
    """Error rates of drones exactly on the buffer's edge, by ellipse, floor and looks."""
    figure, axes = subplots(1, 2, height_in=2.9, sharey=True)
    labels = []
    for axis, looks, title in zip(axes, ("every", "pad"), ("Looks after every round", "The pad's looks"), strict=True):
        chosen = [edge for edge in result.edges if edge.looks == looks]
        labels = [
            f"{edge.one_round_mm / 1000:.1f} m" + (f", floor {edge.floor_mm / 1000:.1f} m" if edge.floor_mm else "")
            for edge in chosen
        ]
        for row, edge in enumerate(chosen):
            for share, colour, shift, name in (
                (edge.settled.verified, VERIFIED, -0.13, "wrongly verified"),
                (edge.settled.refuted, REFUTED, 0.13, "refuted"),
            ):
                low, high = share.interval
                axis.plot([low * 100, high * 100], [row + shift] * 2, color=colour, lw=1.3)
                label = name if row == 0 else None
                axis.scatter([share.value * 100], [row + shift], s=16, color=colour, zorder=3, label=label)
        axis.axvline(1.0, color=OPEN, lw=1, ls="--")
        axis.set_title(title)
        axis.set_xlabel("% of drones on the edge")
        axis.set_xlim(left=0)
        axis.grid(axis="x")
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].invert_yaxis()
    axes[0].set_ylabel("one round's ellipse")
    axes[1].legend(loc="upper right")
    return figure


def _paper_rule(offset_mm: float) -> float:
    """How often one round at L1 falls within the buffer of the claim: its long axis alone counts there."""
    scale = L1_ONE_ROUND_MM * math.sqrt(2)
    return 0.5 * (math.erf((BUFFER_MM - offset_mm) / scale) + math.erf((BUFFER_MM + offset_mm) / scale))
