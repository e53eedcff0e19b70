"""Drawings of results: the paper's two figures again, with what it left out: the ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Circle, Ellipse

from simulator.verdicts import CommittedVerdict

if TYPE_CHECKING:
    from simulator.paper import PaperPoint

INK, CLAIM, BUFFER, MEASURED = "#171b1a", "#0b5c7a", "#c9a227", "#b3261e"
CHI_99 = math.sqrt(9.2103)
"""99 % radius of a circular normal distribution, in standard deviations."""


def paper_figures(results: Sequence[tuple[PaperPoint, CommittedVerdict]], path: Path) -> None:
    """Short and long distances side by side, as SVG, PDF or PNG by the file's suffix."""
    groups: dict[tuple[tuple[float, float], ...], list[tuple[PaperPoint, CommittedVerdict]]] = {}
    for point, item in results:
        groups.setdefault(point.anchors, []).append((point, item))
    figure, axes = plt.subplots(1, len(groups), figsize=(5.2 * len(groups), 6.2), constrained_layout=True)
    for axis, (anchors, group) in zip(axes if len(groups) > 1 else [axes], groups.items(), strict=True):
        _panel(axis, anchors, group)
    figure.savefig(path)
    plt.close(figure)


def _panel(
    axis: Any, anchors: Sequence[tuple[float, float]], group: Sequence[tuple[PaperPoint, CommittedVerdict]]
) -> None:
    axis.scatter(*zip(*anchors, strict=True), s=26, color=INK, label="anchors", zorder=3)
    for number, (point, item) in enumerate(group):
        verdict = item.verdict
        first = number == 0
        axis.add_patch(
            Circle(point.position, 1.0, fill=False, ls=(0, (5, 4)), color=BUFFER, label="buffer 1 m" if first else None)
        )
        axis.scatter(
            *point.position,
            s=70,
            facecolors="none",
            edgecolors=CLAIM,
            linewidths=1.8,
            label="claim" if first else None,
            zorder=4,
        )
        if verdict.estimate is not None and verdict.covariance is not None:
            here = (verdict.estimate.east_mm / 1000, verdict.estimate.north_mm / 1000)
            axis.scatter(*here, marker="D", s=26, color=MEASURED, label="measured" if first else None, zorder=5)
            for scale, style in ((1.0, "-"), (CHI_99, ":")):
                label = ("1σ" if scale == 1.0 else "99 %") if first else None
                axis.add_patch(_ellipse(here, verdict.covariance, scale, ls=style, color=MEASURED, label=label))
        axis.annotate(
            f"{point.name}: {verdict.outcome}, {verdict.rounds} rounds",
            point.position,
            xytext=(10, 12),
            textcoords="offset points",
            fontsize=9,
            color=INK,
        )
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.grid(alpha=0.25)
    axis.margins(0.2)
    axis.legend(loc="lower right", fontsize=8, frameon=False)


def _ellipse(here: tuple[float, float], covariance: Any, scale: float, **style: Any) -> Ellipse:
    ee, en, nn = (value / 1e6 for value in (covariance.ee_mm2, covariance.en_mm2, covariance.nn_mm2))
    root = math.sqrt(((ee - nn) / 2) ** 2 + en**2)
    major, minor = (ee + nn) / 2 + root, max((ee + nn) / 2 - root, 0.0)
    angle = math.degrees(math.atan2(2 * en, ee - nn) / 2)
    return Ellipse(here, 2 * scale * math.sqrt(major), 2 * scale * math.sqrt(minor), angle=angle, fill=False, **style)
