"""The eight steps of a proof as data and as a figure: steps.json and steps.svg, for the paper's sequence figure.

They are written to the directory that WONDERLAND_BENCH_OUT names, else beside the test's other files.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from bench.bench_tools import quantile

from wonderland.proofs.records.sessions import STEP_NAMES
from wonderland.svg import compact

WORDS = {
    "request": "1 Request committed",
    "poll": "2 Pad polls",
    "match": "3 Drone matches the code",
    "reply": "4 Reply received",
    "range": "5 Rounds ranged",
    "confirm": "6 Ranges confirmed",
    "verdict": "7 Verdict committed",
    "permission": "8 Drone has permission",
}
INK, MUTED, BAR, SPAN = "#1f2933", "#7b8794", "#2f6f9f", "#c9d6df"


def write_steps(directory, ledger, sessions):
    """`sessions`: of each session, step → ms since the request was sent. Returns the two paths."""
    out = Path(os.environ.get("WONDERLAND_BENCH_OUT") or directory)
    out.mkdir(parents=True, exist_ok=True)
    steps = []
    before = 0
    for name in STEP_NAMES:
        times = [session[name] for session in sessions if name in session]
        middle = quantile(times, 0.5)
        steps.append(
            {
                "step": name,
                "since_request_ms": {"p5": quantile(times, 0.05), "p50": middle, "p95": quantile(times, 0.95)},
                "since_last_step_p50_ms": middle - before,
                "n": len(times),
            }
        )
        before = middle
    document = {"ledger": ledger, "sessions": len(sessions), "steps": steps, "raw_ms": sessions}
    data, figure = out / f"steps-{ledger}.json", out / f"steps-{ledger}.svg"
    data.write_text(json.dumps(document, indent=1) + "\n")
    _draw(document, figure)
    return data, figure


def _draw(document, path):
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(
        {"font.family": "DejaVu Sans", "font.size": 9, "svg.fonttype": "none", "svg.hashsalt": "steps"}
    ):
        figure = Figure(figsize=(7.2, 3.3), layout="constrained")
        axes = figure.subplots()
        before = 0.0
        for row, step in enumerate(document["steps"]):
            at = step["since_request_ms"]
            axes.plot([at["p5"], at["p95"]], [row, row], color=SPAN, linewidth=9, solid_capstyle="butt", zorder=1)
            axes.barh(row, at["p50"] - before, left=before, height=0.34, color=BAR, zorder=2)
            axes.text(
                max(at["p95"], at["p50"]) + document["steps"][-1]["since_request_ms"]["p95"] * 0.012,
                row,
                f"+{step['since_last_step_p50_ms']:.0f} ms",
                va="center",
                color=INK,
            )
            before = at["p50"]
        axes.set_yticks(range(len(document["steps"])), [WORDS[step["step"]] for step in document["steps"]], color=INK)
        axes.invert_yaxis()
        axes.set_xlim(0, document["steps"][-1]["since_request_ms"]["p95"] * 1.14)
        axes.set_xlabel(
            "ms since the request was sent (bar: median, from the step before; pale: 5 % to 95 %)", color=INK
        )
        axes.tick_params(length=0, colors=MUTED)
        for label in axes.get_yticklabels():
            label.set_color(INK)
        axes.grid(axis="x", color="#e4e7eb", linewidth=0.8, zorder=0)
        axes.set_axisbelow(True)
        for side in ("top", "right", "left", "bottom"):
            axes.spines[side].set_visible(False)
        figure.savefig(path, metadata={"Date": None})
    path.write_text(compact(path.read_text()) + "\n")
