"""Drawings of the lab's results: permissions won by attack and level, and how soon the others were found."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from wonderland.svg import compact
from wonderland_research.attack_lab.model import AttackResult, LabResult, LevelResult, percent
from wonderland_research.attack_lab.report import FAMILIES, grouped, span

INK, MUTED, PAPER = "#171b1a", "#6b7271", "#ffffff"
STOPPED, WON, DOCUMENTED = "#0b5c7a", "#b3261e", "#c9a227"
LEAST: Final = 1e-5
"""Left edge of the logarithmic axis: below this a share is drawn on it."""
_STYLE: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "svg.fonttype": "none",
    "svg.hashsalt": "wonderland",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": INK,
}
Row = tuple[AttackResult, tuple[int, ...], LevelResult]


def draw_permissions(result: LabResult, path: Path) -> None:
    """Share of tries with a permission that should not be, with its 95 % interval; a row for each attack and level."""
    rows = _rows(result)
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(8.4, 0.9 + 0.24 * (len(rows) + len(_headings(rows)))))
        places, labels, heads = _layout(rows)
        for place, (attack, levels, one) in zip(places, rows, strict=True):
            colour = _colour(attack, levels, one)
            low, high = max(one.won_low, LEAST), max(one.won_high, LEAST)
            axis.plot([low if one.won else LEAST, high], [place, place], color=colour, lw=2.2, solid_capstyle="butt")
            if one.won:
                axis.plot([max(one.won / one.tries, LEAST)], [place], "o", ms=5, color=colour)
            else:
                axis.plot([high], [place], "|", ms=8, mew=1.6, color=colour)
        _frame(axis, places, labels, heads)
        axis.set_xscale("log")
        axis.set_xlim(LEAST, 1.6)
        axis.set_xticks([1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0], ["0.001 %", "0.01 %", "0.1 %", "1 %", "10 %", "100 %"])
        axis.set_xlabel("permissions won (dot), 95 % interval (line); none won: upper bound")
        for colour, text, at in ((STOPPED, "stopped", 0.0), (DOCUMENTED, "not stoppable at this level", 0.14)):
            axis.annotate(
                text, (at, 1.0), xycoords="axes fraction", xytext=(0, 8), textcoords="offset points", color=colour
            )
        _save(figure, path)


def draw_detection(result: LabResult, path: Path) -> None:
    """Ranging time until refuted: median (dot) and 95 % (line), where most tries were."""
    rows = [row for row in _rows(result) if row[2].detected_s_median is not None and row[2].refuted * 20 > row[2].tries]
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(8.4, 0.9 + 0.24 * max(1, len(rows) + len(_headings(rows)))))
        places, labels, heads = _layout(rows)
        for place, (_, _, one) in zip(places, rows, strict=True):
            assert one.detected_s_median is not None
            assert one.detected_s_95 is not None
            axis.plot([one.detected_s_median, one.detected_s_95], [place, place], color=STOPPED, lw=2.2)
            axis.plot([one.detected_s_median], [place], "o", ms=5, color=STOPPED)
            share = one.refuted / one.tries
            axis.annotate(
                "all" if one.refuted == one.tries else percent(share),
                (one.detected_s_95, place),
                xytext=(7, 0),
                textcoords="offset points",
                va="center",
                color=MUTED,
                fontsize=8,
            )
        _frame(axis, places, labels, heads)
        axis.set_xlim(0, 9)
        axis.set_xlabel("seconds of ranging until refuted: median (dot), 95 % (line); share of tries that are")
        _save(figure, path)


def _rows(result: LabResult) -> list[Row]:
    order = list(FAMILIES)
    attacks = sorted(result.attacks, key=lambda attack: order.index(attack.family))
    return [(attack, levels, one) for attack in attacks for levels, one in grouped(attack.levels)]


def _headings(rows: list[Row]) -> list[str]:
    return list(dict.fromkeys(attack.family for attack, _, _ in rows))


def _layout(rows: list[Row]) -> tuple[list[float], list[str], list[tuple[float, str]]]:
    """Heights of the rows, their labels, and headings with theirs."""
    places: list[float] = []
    labels: list[str] = []
    heads: list[tuple[float, str]] = []
    height, family = 0.0, ""
    for attack, levels, _ in rows:
        if attack.family != family:
            family = attack.family
            heads.append((height, FAMILIES[family]))
            height += 1.0
        places.append(height)
        labels.append(f"{attack.name}  {span(levels)}")
        height += 1.0
    return places, labels, heads


def _frame(axis: Any, places: list[float], labels: list[str], heads: list[tuple[float, str]]) -> None:
    axis.set_yticks(places, labels)
    axis.tick_params(axis="y", length=0)
    bottom = max(places, default=0.0) + 0.8
    axis.set_ylim(bottom, -0.7)
    for height, text in heads:
        axis.annotate(
            text,
            (0.0, height),
            xycoords=("axes fraction", "data"),
            xytext=(-8, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            weight="bold",
            annotation_clip=False,
        )
    axis.grid(axis="x", alpha=0.25)
    axis.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axis.spines[side].set_visible(False)


def _colour(attack: AttackResult, levels: tuple[int, ...], one: LevelResult) -> str:
    if not one.as_documented:
        return WON
    stopped = attack.stopped_from is not None and min(levels) >= attack.stopped_from
    return STOPPED if stopped else DOCUMENTED


def _save(figure: Any, path: Path) -> None:
    figure.savefig(path, facecolor=PAPER, bbox_inches="tight", metadata={"Date": None} if path.suffix == ".svg" else {})
    plt.close(figure)
    if path.suffix == ".svg":
        path.write_text(compact(path.read_text(encoding="utf-8")) + "\n", encoding="utf-8")
