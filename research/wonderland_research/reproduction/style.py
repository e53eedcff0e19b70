"""How drawings look: one set of colours and lines for the report, the documentation and the paper's figures."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from wonderland.svg import compact

INK: Final = "#171b1a"
QUIET: Final = "#5d6664"
LINE: Final = "#d5dad8"
CLAIM: Final = "#0b5c7a"
MEASURED: Final = "#b3261e"
BUFFER: Final = "#c9a227"
VERIFIED: Final = "#1f6b45"
REFUTED: Final = "#b3261e"
OPEN: Final = "#8b9491"
PAPER: Final = "#c2571a"
SERIES: Final = ("#0b5c7a", "#c2571a", "#3d7a4b", "#7a3d78", "#9a7b12", "#45519e")
WIDTH_IN: Final = 7.2
"""Of a figure that fills the text."""
CONTEXT: Final[Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "wonderland",
    "figure.constrained_layout.use": True,
}


def subplots(
    rows: int = 1, columns: int = 1, *, height_in: float = 3.0, width_in: float = WIDTH_IN, **more: Any
) -> Any:
    """``plt.subplots`` in this style, which holds from then on: titles and legends take it when they are made."""
    mpl.rcParams.update(CONTEXT)
    return plt.subplots(rows, columns, figsize=(width_in, height_in), **more)


def blank(*, height_in: float = 3.0, width_in: float = WIDTH_IN) -> Any:
    """A figure without axes, in this style."""
    mpl.rcParams.update(CONTEXT)
    return plt.figure(figsize=(width_in, height_in))


def svg(figure: Any) -> str:
    """A figure as an SVG element without prologue or date, for a page; the figure is closed."""
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)
    return compact(out.getvalue())


def save(figure: Any, path: Path) -> None:
    """A figure as a file, by its suffix: .svg, .pdf or .png."""
    if path.suffix == ".svg":
        path.write_text(svg(figure) + "\n", encoding="utf-8")
        return
    figure.savefig(path, dpi=200)
    plt.close(figure)
