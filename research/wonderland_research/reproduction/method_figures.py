"""Pictures of ``docs/method.md`` and its second page, computed with the verdict's own functions (``make figures``)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.patches import Circle

from wonderland.proofs import stopping
from wonderland.proofs.agreement import agreement
from wonderland.proofs.estimate import solve, without
from wonderland.proofs.honest import SHARE_PPM, looks_of, rounds_for, share_by
from wonderland.proofs.likelihood import Matrix2, inside_disc
from wonderland.proofs.prospects import Prospect, prospect
from wonderland.proofs.records.pads import Commissioning
from wonderland_research.paper_points import POINTS
from wonderland_research.reproduction.paper_figures import CHI_99, ellipse
from wonderland_research.reproduction.sampling import (
    BUFFER_MM,
    L1_ONE_ROUND_MM,
    POLICY,
    means,
    pad_at,
    place_of,
    settle,
)
from wonderland_research.reproduction.style import (
    BUFFER,
    CLAIM,
    INK,
    LINE,
    OPEN,
    PAPER,
    QUIET,
    REFUTED,
    SERIES,
    VERIFIED,
    save,
    subplots,
)

FIVE_ANCHORS: Final = ((1.8, 0.0), (0.56, 1.71), (-1.46, 1.06), (-1.46, -1.06), (0.56, -1.71))
"""Five anchors on a circle, m."""
SEED: Final = 11
SESSIONS: Final = 4000


def outcomes() -> Any:
    """Three sessions about the same claim: what makes verified, refuted and inconclusive."""
    figure, axes = subplots(1, 3, height_in=2.75, sharex=True, sharey=True)
    cases = (
        ("Verified", (0.18, 0.07), (0.27, 0.06), VERIFIED),
        ("Refuted", (1.75, -0.45), (0.20, 0.06), REFUTED),
        ("Inconclusive", (0.55, 0.30), (0.75, 0.10), OPEN),
    )
    turn = math.radians(-14)
    axis_of = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    for axis, (title, here, (s1, s2), colour) in zip(axes, cases, strict=True):
        covariance = axis_of @ np.diag([s1**2, s2**2]) @ axis_of.T
        axis.add_patch(Circle((0, 0), 1.0, fc=BUFFER, alpha=0.15))
        axis.add_patch(Circle((0, 0), 1.0, fill=False, ec=BUFFER, lw=1.2))
        axis.add_patch(ellipse(here, covariance, 1.0, fill=True, fc=colour, alpha=0.35, lw=0))
        axis.add_patch(ellipse(here, covariance, CHI_99, ec=colour, lw=1.2, ls=":"))
        axis.scatter(0, 0, s=40, facecolors="none", edgecolors=CLAIM, linewidths=1.8, zorder=4)
        axis.scatter(*here, marker="D", s=16, color=colour, zorder=5)
        matrix = Matrix2(*(float(value) * 1e6 for value in (covariance[0, 0], covariance[0, 1], covariance[1, 1])))
        likelihood = inside_disc(here[0] * 1000, here[1] * 1000, matrix, BUFFER_MM)
        axis.set_title(title)
        axis.text(
            0.02, 0.03, f"likelihood {_likelihood(likelihood)}", transform=axis.transAxes, fontsize=8, color=QUIET
        )
        axis.set_aspect("equal")
        axis.set_xlim(-1.5, 2.6)
        axis.set_ylim(-1.6, 1.5)
        axis.grid()
    axes[0].annotate("claim", (0, 0), xytext=(-6, -11), textcoords="offset points", ha="right", fontsize=8, color=CLAIM)
    axes[0].text(0.75, 0.85, "buffer 1 m", ha="left", fontsize=8, color="#8a6d10")
    axes[1].annotate("measured", (1.75, -0.45), xytext=(0, 14), textcoords="offset points", ha="center", fontsize=8)
    axes[0].set_ylabel("north of claim (m)")
    for axis in axes:
        axis.set_xlabel("east of claim (m)")
    return figure


def uncertainty() -> Any:
    """What more rounds buy: noise averages out, bias does not. At the paper's points S1 and L1."""
    figure, axes = subplots(1, 2, height_in=3.0)
    for axis, index, biases in ((axes[0], 0, (0, 20, 60, 90)), (axes[1], 2, (0, 4, 6, 20))):
        point = POINTS[index]
        truth = place_of(point)
        rounds = np.unique(np.geomspace(1, 500, 60).round())
        for colour, bias in zip((CLAIM, SERIES[2], SERIES[4], REFUTED), biases, strict=True):
            found = prospect(pad_at(point, bias_sigma_mm=bias), POLICY, *truth, 0.0)
            assert found is not None
            one, floor = found.one_round, found.floor
            axes_of = one.ellipse()
            white = max(one.along(axes_of.east, axes_of.north) - floor.along(axes_of.east, axes_of.north), 0.0)
            s1 = np.sqrt(white / rounds + floor.along(axes_of.east, axes_of.north)) / 1000
            label = f"{bias} mm: {_honest(found)}"
            axis.plot(rounds, s1, color=colour, lw=1.6, label=label)
        limit = math.sqrt(stopping.settled_variance(POLICY)) / 1000
        axis.axhline(limit, color=OPEN, lw=1, ls="--")
        axis.text(480, limit * 1.05, "exact claim", fontsize=7.5, color=QUIET, ha="right")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(f"{point.name}, {math.dist(point.position, np.mean(point.anchors, axis=0)):.1f} m away")
        axis.set_xlabel("rounds")
        axis.set_xticks([1, 10, 100, 500], ["1", "10", "100", "500"])
        axis.minorticks_off()
        axis.grid()
        axis.legend(loc="lower left", title="bias, 1σ: verified", title_fontsize=8, fontsize=7.5, alignment="left")
    ticks = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2]
    for axis in axes:
        axis.set_ylim(0.008, 2.6)
        axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes[0].set_ylabel("standard deviation (m)")
    return figure


def proof() -> Any:
    """Evidence as rounds come in, of ten drones each: what proves within the buffer, and what proves outside."""
    figure, axes = subplots(1, 2, height_in=3.0, sharey=True)
    rng = np.random.default_rng(SEED)
    cases = ((0.0, VERIFIED, "honest"), (BUFFER_MM, OPEN, "on the edge"), (2 * BUFFER_MM, PAPER, "2 m lie"))
    for offset, colour, name in cases:
        for number in range(10):
            total = np.cumsum(rng.normal(offset, L1_ONE_ROUND_MM, 160))
            for axis, alternatives, side in ((axes[0], stopping.INSIDE, 1.0), (axes[1], stopping.OUTSIDE, -1.0)):
                values = [_evidence(alternatives, total[n - 1] / n, n, side) for n in range(3, 161)]
                label = name if number == 0 else None
                axis.plot(range(3, 161), values, color=colour, lw=0.9, alpha=0.75, label=label)
    for axis, title in zip(axes, ("Evidence for “within”", "Evidence for “outside”"), strict=True):
        axis.axhline(2.0, color=INK, lw=1)
        axis.set_title(title)
        axis.set_xlabel("rounds")
        axis.set_ylim(-4.3, 4.3)
        axis.set_xlim(0, 160)
        axis.grid()
    axes[0].set_yticks([-4, -2, 0, 2, 4], ["1 : 10,000", "1 : 100", "1 : 1", "100 : 1", "10,000 : 1"])
    axes[0].text(158, 2.12, "proved", ha="right", fontsize=8, color=INK)
    axes[1].legend(loc="lower right", fontsize=8)
    return figure


def bad_anchor() -> Any:
    """Five anchors, one of which measures half a metre too much: all fits without one, and what they say."""
    figure, axes = subplots(1, 2, height_in=3.1, width_ratios=(1, 1.15))
    ring, closely = axes
    truth, claim = (2600.0, 3900.0), (2600.0, 3900.0)
    commissioning = _ring()
    errors = np.random.default_rng(SEED).normal(0, 8, 5)
    errors[1] += 500.0
    item = means(commissioning, truth, claim, errors.tolist(), 40)
    whole = solve(item)
    assert whole is not None
    agreed = agreement(item, whole)
    for index, anchor in enumerate(item.anchors):
        bad = index == 1
        ring.add_patch(
            Circle((anchor.east / 1000, anchor.north / 1000), anchor.range_mm / 1000, fill=False,
                   ec=REFUTED if bad else LINE, lw=1.6 if bad else 1.0, ls="--" if bad else "-")
        )  # fmt: skip
        ring.scatter(anchor.east / 1000, anchor.north / 1000, s=24, marker="s", color=REFUTED if bad else INK, zorder=3)
        ring.annotate(
            f"A{index}",
            (anchor.east / 1000, anchor.north / 1000),
            xytext=(5, -11),
            textcoords="offset points",
            fontsize=8,
        )
    ring.scatter(truth[0] / 1000, truth[1] / 1000, s=45, facecolors="none", edgecolors=CLAIM, linewidths=1.8, zorder=4)
    ring.set_aspect("equal")
    ring.set_xlim(-3.2, 4.6)
    ring.set_ylim(-2.6, 5.2)
    ring.set_title("Ranges; A1 is 0.5 m too long")
    ring.set_xlabel("x (m)")
    ring.set_ylabel("y (m)")
    closely.add_patch(Circle((0, 0), 1.0, fc=BUFFER, alpha=0.15))
    closely.add_patch(Circle((0, 0), 1.0, fill=False, ec=BUFFER, lw=1.2))
    closely.scatter(0, 0, s=45, facecolors="none", edgecolors=CLAIM, linewidths=1.8, zorder=4)
    entries = [("all five", whole, OPEN)]
    for index in range(5):
        fitted = solve(without(item, index))
        assert fitted is not None
        entries.append((f"without A{index}", fitted, VERIFIED if index in agreed.suspects else OPEN))
    for row, (name, offset, colour) in enumerate(entries):
        covariance = np.array(
            [[offset.covariance.ee, offset.covariance.en], [offset.covariance.en, offset.covariance.nn]]
        )
        here = (offset.east / 1000, offset.north / 1000)
        closely.add_patch(ellipse(here, covariance / 1e6, CHI_99, ec=colour, lw=1.2))
        closely.scatter(*here, marker="D", s=13, color=colour, zorder=5)
        closely.text(
            1.28, 0.95 - 0.26 * row, f"{name}: χ² {offset.chi2:,.1f}", fontsize=8.5,
            color=QUIET if colour == OPEN else INK, weight="bold" if colour == VERIFIED else "normal",
        )  # fmt: skip
    closely.set_aspect("equal")
    closely.set_xlim(-1.15, 2.9)
    closely.set_ylim(-1.3, 1.3)
    closely.set_title("Fits without one anchor each")
    closely.set_xlabel("east of claim (m)")
    return figure


def differences() -> Any:
    """A drone that falsifies its time stamps: two-way ranges fit its claim, time differences do not."""
    figure, axes = subplots(1, 2, height_in=3.7, sharey=True)
    anchors = np.array([(1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5)])
    truth = np.array([1.2, 7.0])
    lies = (("A false time for each anchor", np.array([4.4, 7.2])), ("One false time for all", truth * 1.45))
    for axis, (title, claim) in zip(axes, lies, strict=True):
        axis.scatter(*anchors.T, s=18, marker="s", color=INK, zorder=3)
        axis.add_patch(Circle(tuple(claim), 1.0, fc=BUFFER, alpha=0.15))
        axis.add_patch(Circle(tuple(claim), 1.0, fill=False, ec=BUFFER, lw=1.2))
        ranged = _two_way(anchors, claim, 0.025, 40, 0.008)
        timed = _one_way(anchors, truth, 0.025, 60, 0.005)
        axis.add_patch(ellipse(tuple(claim), ranged, CHI_99, ec=PAPER, lw=1.4))
        axis.add_patch(ellipse(tuple(truth), timed, CHI_99, ec=CLAIM, lw=1.4))
        axis.scatter(*claim, s=40, facecolors="none", edgecolors=CLAIM, linewidths=1.8, zorder=4)
        axis.scatter(*truth, s=46, marker="*", color=INK, zorder=5)
        axis.set_title(title)
        axis.set_aspect("equal")
        axis.set_xlim(-5.4, 8.4)
        axis.set_ylim(-2.4, 11.8)
        axis.set_xlabel("x (m)")
        axis.grid()
    axes[0].set_ylabel("y (m)")
    for text, x, y, colour in (
        ("truth", 0.75, 5.6, INK),
        ("claim", 5.75, 7.2, CLAIM),
        ("two-way ranges:\nhere", 5.2, 4.2, PAPER),
        ("time differences:\nhere", -1.6, 8.7, CLAIM),
    ):
        axes[0].text(x, y, text, ha="center", va="center", fontsize=8, color=colour)
    for end, start in (((4.4, 7.05), (5.1, 4.8)), ((1.15, 7.7), (-0.3, 8.5))):
        axes[0].annotate("", end, start, arrowprops={"arrowstyle": "-", "color": QUIET, "lw": 0.7})
    return figure


def sessions() -> Any:
    """How sessions end, by how far the drone is from its claim, near and far."""
    figure, axes = subplots(1, 2, height_in=2.9, sharey=True)
    offsets = np.arange(0.0, 4001.0, 125.0)
    for axis, (one_round, title) in zip(axes, ((300.0, "3 m away"), (L1_ONE_ROUND_MM, "13 m away")), strict=True):
        ended = [settle(float(offset), stopping.LOOKS, SESSIONS, one_round_mm=one_round) for offset in offsets]
        verified = np.array([one.verified.value for one in ended])
        refuted = np.array([one.refuted.value for one in ended])
        x = offsets / 1000
        axis.stackplot(
            x, verified, 1 - verified - refuted, refuted, colors=(VERIFIED, LINE, REFUTED), alpha=0.8,
            labels=("verified", "inconclusive", "refuted"), lw=0,
        )  # fmt: skip
        axis.axvline(1.0, color=BUFFER, lw=1.4)
        axis.set_title(title)
        axis.set_xlabel("drone's distance from its claim (m)")
        axis.set_xlim(0, 4)
        axis.set_ylim(0, 1)
    axes[0].set_ylabel("share of sessions")
    axes[0].text(1.06, 0.04, "buffer", fontsize=8, color=INK)
    axes[1].legend(loc="center right", labelcolor="white", handlelength=1.0)
    for text, colour in zip(axes[1].get_legend().get_texts(), ("white", INK, "white"), strict=True):
        text.set_color(colour)
    return figure


PICTURES: Final[dict[str, Callable[[], Any]]] = {
    "outcomes": outcomes,
    "uncertainty": uncertainty,
    "proof": proof,
    "sessions": sessions,
    "bad-anchor": bad_anchor,
    "differences": differences,
}


def draw_all(directory: Path) -> list[Path]:
    """Each picture as ``method-NAME.svg``; returns the files."""
    written = []
    for name, draw in PICTURES.items():
        path = directory / f"method-{name}.svg"
        save(draw(), path)
        written.append(path)
    return written


def _honest(found: Prospect) -> str:
    """Which share of honest drones is verified, and by how many rounds."""
    rounds = rounds_for(found, POLICY)
    if rounds > 0:
        return f"{SHARE_PPM // 10_000} % in {rounds}"
    most = looks_of(POLICY)[-1]
    share = share_by(found, POLICY, most) if found.rounds > 0 else 0.0
    return "never" if share < 0.005 else f"{100 * share:.0f} % in {most}"


def _likelihood(value: float) -> str:
    return "> 0.9999" if value > 0.9999 else "< 0.0001" if value < 0.0001 else f"{value:.4f}"


def _evidence(alternatives: stopping.Alternatives, estimate: float, rounds: int, side: float) -> float:
    """log10 of the mixture of likelihood ratios that ``stopping.proved`` compares with 1/α, before its correction."""
    s1 = L1_ONE_ROUND_MM / math.sqrt(rounds)
    away = side * (BUFFER_MM - abs(estimate)) / s1
    total = 0.0
    for distance, weight in alternatives:
        eta = distance * BUFFER_MM / s1
        total += weight * math.exp(max(min(eta * away - 0.5 * eta * eta, 700.0), -700.0))
    return math.log10(max(total, 1e-300))


def _ring() -> Commissioning:
    """A pad of five anchors on a circle."""
    return pad_at(replace(POINTS[0], anchors=FIVE_ANCHORS), bias_sigma_mm=8)


def _two_way(anchors: Any, place: Any, sigma: float, rounds: int, bias: float) -> Any:
    directions = (place - anchors) / np.linalg.norm(place - anchors, axis=1, keepdims=True)
    return np.linalg.inv(directions.T @ directions / (sigma**2 / rounds + bias**2))


def _one_way(anchors: Any, place: Any, sigma: float, frames: int, clock: float) -> Any:
    """Covariance from time stamps whose moment of sending nobody knows: directions less their mean."""
    directions = (place - anchors) / np.linalg.norm(place - anchors, axis=1, keepdims=True)
    directions -= directions.mean(axis=0)
    return np.linalg.inv(directions.T @ directions / (sigma**2 / frames + clock**2))
