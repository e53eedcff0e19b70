"""What a calibration found, drawn: each plot one SVG, made for a report that an operator and an authority read."""

from __future__ import annotations

import io
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap

from wonderland.svg import compact
from wonderland_edge_agent.commissioning.clocks import Clocks
from wonderland_edge_agent.commissioning.fit import Fit
from wonderland_edge_agent.commissioning.reach import SHARE, ReachMap
from wonderland_edge_agent.commissioning.run import Floats

INK: Final = "#171b1a"
QUIET: Final = "#5d6664"
LINE: Final = "#d5dad8"
CYCLE: Final = ("#0b5c7a", "#c2571a", "#3d7a4b", "#7a3d78", "#9a7b12", "#45519e", "#a8324a", "#4f7d84")
ROUNDS: Final = (1, 10, 20, 40, 80, 160)
GREENS: Final = ("#1f6b45", "#4c9064", "#86b386", "#c9d59d", "#efd994")
NO_GO: Final = "#d98c7a"
_STYLE: Final[Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "text.color": INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "wonderland",
}


def draw_all(fit: Fit, reach_map: ReachMap | None = None, clocks: Clocks | None = None) -> dict[str, str]:
    """SVG texts by name: bias, residuals, correlation, coverage, reach, clocks."""
    out = {
        "bias": bias_curves(fit),
        "residuals": residuals(fit),
        "correlation": correlation(fit),
        "coverage": coverage(fit),
    }
    if reach_map is not None:
        out["reach"] = go_map(fit, reach_map)
    if clocks is not None:
        out["clocks"] = clock_wander(clocks)
    return out


def bias_curves(fit: Fit) -> str:
    """Each anchor's windows, its curve and ±1σ of what remains."""
    count = len(fit.anchor_ids)
    columns = min(count, 4)
    rows = -(-count // columns)
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(
            rows, columns, figsize=(2.75 * columns + 0.6, 2.5 * rows + 0.4), sharex=True, sharey=True, squeeze=False,
            constrained_layout=True,
        )  # fmt: skip
        knots = fit.curves.knots_m
        shown = fit.windows.error_m[np.isfinite(fit.windows.error_m)] * 100
        low, high = np.quantile(shown, [0.005, 0.995])
        for index, (name, axis) in enumerate(zip(fit.anchor_ids, axes.flat, strict=False)):
            colour = CYCLE[index % len(CYCLE)]
            bias, sigma = fit.curves.bias_m[index] * 100, fit.spread.bias_sigma_m[index] * 100
            axis.scatter(
                fit.windows.distance_m[:, index], fit.windows.error_m[:, index] * 100, s=5, color=colour, alpha=0.3,
                rasterized=True,
                linewidths=0,
            )  # fmt: skip
            axis.fill_between(knots, bias - sigma, bias + sigma, color=colour, alpha=0.18, linewidth=0)
            axis.plot(knots, bias, color=colour, linewidth=1.8)
            axis.axhline(0, color=QUIET, linewidth=0.7)
            axis.set_title(f"Anchor {name}")
            axis.set_ylim(low - 4, high + 4)
            axis.grid(color=LINE, linewidth=0.5)
        for axis in list(axes.flat)[count:]:
            axis.set_visible(False)
        figure.supxlabel("true distance (m)", fontsize=9.5)
        figure.supylabel("measured − true (cm)", fontsize=9.5)
        return _svg(figure)


def residuals(fit: Fit) -> str:
    """Held-out errors of each anchor in its own standard deviations, against the normal distribution."""
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(4.6, 3.0), constrained_layout=True)
        scores = standardised(fit)
        edges = np.linspace(-4, 4, 41).tolist()
        axis.hist(np.clip(scores, -3.99, 3.99), bins=edges, density=True, color=CYCLE[0], alpha=0.55, linewidth=0)
        x = np.linspace(-4, 4, 201)
        axis.plot(x, np.exp(-x * x / 2) / np.sqrt(2 * np.pi), color=INK, linewidth=1.3, label="what is stated: N(0, σ)")
        axis.set_xlabel("held-out error of an anchor / its stated σ")
        axis.set_yticks([])
        axis.spines["left"].set_visible(False)
        outside = float(np.mean(np.abs(scores) > 2))
        axis.set_title(f"Beyond 2 σ: {outside:.1%} (a normal distribution has 4.6 %)")
        axis.legend(frameon=False, fontsize=8.5, loc="upper right")
        return _svg(figure)


def standardised(fit: Fit) -> Floats:
    """Held-out errors, without what all anchors share, over the σ that the table states there."""
    own = fit.spread.own_m
    sigma = np.stack(
        [
            np.interp(fit.windows.distance_m[:, index], fit.curves.knots_m, fit.spread.bias_sigma_m[index])
            for index in range(own.shape[1])
        ],
        axis=1,
    )
    white = fit.spread.range_sigma_m**2 * (1 + fit.spread.correlation) / (1 - fit.spread.correlation)
    total = np.sqrt(sigma**2 + white / max(fit.windows.rounds, 1.0))
    scores = own / total
    return np.asarray(scores[np.isfinite(scores)])


def correlation(fit: Fit) -> str:
    """Autocorrelation of the noise within a second, and the effective one that the verdict reckons with."""
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(4.6, 3.0), constrained_layout=True)
        lags = fit.spread.lags
        axis.axhline(0, color=QUIET, linewidth=0.7)
        axis.bar(np.arange(len(lags)), lags, width=0.55, color=CYCLE[0], alpha=0.55, label="within a second")
        steps = np.arange(len(lags))
        axis.plot(
            steps,
            fit.spread.correlation**steps,
            "o--",
            color=CYCLE[1],
            markersize=4,
            linewidth=1.2,
            label="reckoned with",
        )
        worth = (1 - fit.spread.correlation) / (1 + fit.spread.correlation)
        axis.set_title(f"A round is worth {worth:.2f} independent ones")
        axis.set_xlabel(f"lag (rounds of {fit.interval_s * 1000:.0f} ms)")
        axis.set_ylabel("autocorrelation")
        axis.set_ylim(min(-0.3, float(np.min(lags)) - 0.1), 1.08)
        axis.legend(frameon=False, fontsize=8.5)
        return _svg(figure)


def coverage(fit: Fit) -> str:
    """Where the run was, seen from above, coloured by how far off the calibrated ranges were."""
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(4.6, 4.2), constrained_layout=True)
        rest = np.nanmean(np.abs(np.where(np.isfinite(fit.held_m), fit.held_m, np.nan)), axis=1) * 100
        truth = fit.windows.truth_m
        top = float(np.quantile(rest[np.isfinite(rest)], 0.95))
        drawn = axis.scatter(
            truth[:, 0], truth[:, 1], c=rest, s=11, cmap="viridis_r", vmin=0, vmax=top, lw=0, rasterized=True
        )
        axis.scatter(fit.anchors_m[:, 0], fit.anchors_m[:, 1], marker="^", s=38, color=INK, zorder=3, label="anchors")
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_xlabel("east (m)")
        axis.set_ylabel("north (m)")
        axis.grid(color=LINE, linewidth=0.5)
        axis.legend(frameon=False, fontsize=8.5, loc="best")
        bar = figure.colorbar(drawn, ax=axis, shrink=0.7, pad=0.02)
        bar.set_label("held-out error (cm)")
        bar.outline.set_visible(False)
        return _svg(figure)


def go_map(fit: Fit, found: ReachMap) -> str:
    """Rounds by which most honest drones are verified, by place."""
    with plt.rc_context(_STYLE):
        figure, axis = plt.subplots(figsize=(4.9, 4.2), constrained_layout=True)
        colours = ListedColormap(GREENS).with_extremes(under=NO_GO)
        drawn = axis.pcolormesh(
            found.east_m, found.north_m, found.rounds, cmap=colours, norm=BoundaryNorm(ROUNDS, len(GREENS)),
            shading="nearest", rasterized=True,
        )  # fmt: skip
        axis.scatter(fit.anchors_m[:, 0], fit.anchors_m[:, 1], marker="^", s=30, color=INK, zorder=3)
        axis.set_aspect("equal")
        axis.set_xlabel("east (m)")
        axis.set_ylabel("north (m)")
        axis.set_title(f"Rounds to verify ±{found.buffer_m:g} m at {found.height_m:g} m height\n({SHARE})")
        bar = figure.colorbar(drawn, ax=axis, shrink=0.7, pad=0.02, extend="min", ticks=ROUNDS)
        bar.set_label("rounds (red: no-go)")
        bar.outline.set_visible(False)
        return _svg(figure)


def clock_wander(clocks: Clocks) -> str:
    """Each clock's seconds about its own offset, with ±1σ of what a verdict reckons with."""
    count = len(clocks.anchor_ids)
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(
            count,
            1,
            figsize=(7.4, 1.15 * count + 0.6),
            sharex=True,
            sharey=True,
            squeeze=False,
            constrained_layout=True,
        )
        seconds = _in_a_row(clocks)
        top = max(float(np.quantile(np.abs(clocks.wander_m), 0.995)), float(np.max(clocks.sigma_m)) * 1.2) * 1000
        for index, (name, axis) in enumerate(zip(clocks.anchor_ids, axes[:, 0], strict=True)):
            colour = CYCLE[index % len(CYCLE)]
            sigma, offset = float(clocks.sigma_m[index]) * 1000, float(clocks.offset_m[index]) * 1000
            axis.axhspan(-sigma, sigma, color=colour, alpha=0.15, linewidth=0)
            axis.axhline(0, color=QUIET, linewidth=0.7)
            axis.scatter(seconds, clocks.wander_m[:, index] * 1000, s=7, color=colour, alpha=0.6, linewidths=0)
            axis.set_ylim(-1.15 * top, 1.15 * top)
            axis.set_title(f"{name}: late by {offset:+.0f} mm, ±{sigma:.0f} mm", fontsize=9.5)
            axis.grid(color=LINE, linewidth=0.5)
        figure.supxlabel("time in the runs (s)", fontsize=9.5)
        figure.supylabel("late against its own mean (mm)", fontsize=9.5)
        return _svg(figure)


def _in_a_row(clocks: Clocks) -> Floats:
    """Times of all runs, one after the other."""
    out = np.empty(len(clocks.t_s))
    start = 0.0
    for number in np.unique(clocks.run):
        rows = clocks.run == number
        out[rows] = clocks.t_s[rows] - clocks.t_s[rows][0] + start
        start = float(out[rows][-1]) + 5.0
    return out


def _svg(figure: Any) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=160, metadata={"Date": None, "Creator": "Wonderland"})
    plt.close(figure)
    return compact(text.getvalue())
