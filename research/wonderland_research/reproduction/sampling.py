"""Monte-Carlo over the decision's own functions: drones at a place, errors drawn, the contract's thresholds applied.

Where whole decisions would take hours, ``settle`` draws the estimate along the ellipse's long axis (the covariance that
``prospects`` states) and applies the decision's own thresholds; ``tests/bench/test_verdict_statistics.py`` holds it
against fits of ranges. Lengths in millimetres.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from wonderland.proofs import stopping
from wonderland.proofs.agreement import REFUTING_ANCHORS, agreement
from wonderland.proofs.estimate import solve
from wonderland.proofs.judgement import compare
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.reduction import HEIGHT_SIGMA_FLOOR_MM, AnchorMean, Reduced
from wonderland_edge_agent.geodesy import frame_at
from wonderland_research.paper_points import PaperPoint

ALPHA: Final = 0.01
POLICY: Final = Policy()
BUFFER_MM: Final = float(POLICY.buffer_mm)
L1_ONE_ROUND_MM: Final = 1800.0
"""Long axis of one round's ellipse at the paper's point L1."""
EVERY_ROUND: Final = tuple(range(3, 501))
FRAME: Final = frame_at(604_518_000, 222_666_000, 30_000)
_HALVINGS: Final = 40
_FAR_SIGMAS: Final = 50.0


CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class Share:
    """A count of tries, with its 95 % interval (Clopper and Pearson)."""

    count: int
    tries: int

    @property
    def value(self) -> float:
        """The share itself; NaN of no tries."""
        return self.count / self.tries if self.tries else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 %: from the least to the greatest share that explains the count."""
        return self._interval(CONFIDENCE)

    def explains(self, stated: float, looks: int = 1) -> bool:
        """Whether the count may come from a share of ``stated``; 95 % for all of so many ``looks`` together."""
        low, high = self._interval(1.0 - (1.0 - CONFIDENCE) / looks)
        return low <= stated <= high

    def _interval(self, confidence: float) -> tuple[float, float]:
        if not self.tries:
            return 0.0, 1.0
        found: Any = stats.binomtest(self.count, self.tries).proportion_ci(confidence, method="exact")
        return float(found.low), float(found.high)

    def percent(self, decimals: int = 2) -> str:
        """``0.94 % (0.88–1.00)``; of nothing seen ``0 (≤ 0.018 %)``, of all ``100 % (≥ 99.98)``."""
        low, high = self.interval
        if not self.tries:
            return "–"
        if self.count == 0:
            return f"0 (≤ {100 * high:.2g} %)"
        if self.count == self.tries:
            return f"100 % (≥ {100 * low:.{decimals}f})"
        return f"{100 * self.value:.{decimals}f} % ({100 * low:.{decimals}f}–{100 * high:.{decimals}f})"


@dataclass(frozen=True)
class Settled:
    """How a sample of sessions ended."""

    verified: Share
    refuted: Share
    mean_rounds: float


def pad_at(
    point: PaperPoint, *, sigma_mm: int = 50, bias_sigma_mm: int = 0, more: Sequence[tuple[float, float]] = ()
) -> Commissioning:
    """The pad of one of the paper's points, with more anchors if wanted (m); correlation and survey are known as 0."""
    return Commissioning(
        frame=FRAME,
        anchors=tuple(
            Anchor(
                anchor_id=f"A{i}",
                mac=i,
                east_mm=round(x * 1000),
                north_mm=round(y * 1000),
                up_mm=0,
                survey_sigma_mm=0,
                bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=bias_sigma_mm),),
            )
            for i, (x, y) in enumerate((*point.anchors, *more))
        ),
        range_sigma_mm=sigma_mm,
        installation_sigma_mm=0,
        max_range_mm=100_000,
        valid_from_ms=0,
        valid_until_ms=2,
        method="simulated",
        correlation_ppm=0,
    )


def place_of(point: PaperPoint) -> tuple[float, float]:
    """A paper's point in millimetres."""
    return point.position[0] * 1000, point.position[1] * 1000


def means(
    commissioning: Commissioning,
    truth: tuple[float, float],
    claim: tuple[float, float],
    errors_mm: Sequence[float],
    rounds: int,
) -> Reduced:
    """Means over ``rounds`` rounds with the given errors, as ``reduction.reduce`` would make them; all in one plane."""
    white = commissioning.range_sigma_mm**2 / rounds
    anchors = []
    for index, (anchor, error) in enumerate(zip(commissioning.anchors, errors_mm, strict=True)):
        place = (anchor.east_mm, anchor.north_mm)
        measured, expected = math.dist(truth, place) + error, math.dist(claim, place)
        anchors.append(
            AnchorMean(
                index=index,
                east=float(anchor.east_mm),
                north=float(anchor.north_mm),
                up=0.0,
                range_mm=measured,
                residual_mm=measured - expected,
                count=rounds,
                white=white,
                floor=float(anchor.bias[0].sigma_mm ** 2),
            )
        )
    return Reduced(
        anchors=tuple(anchors),
        east=claim[0],
        north=claim[1],
        up=0.0,
        t_ms=0,
        rounds=rounds,
        effective=float(rounds),
        bursts=0,
        height_sigma_mm=HEIGHT_SIGMA_FLOOR_MM,
        installation_sigma_mm=0.0,
    )


def outcome_of(item: Reduced, policy: Policy = POLICY) -> str:
    """The side that the decision takes on these means."""
    whole = solve(item)
    if whole is None:
        return "inconclusive"
    agreed = agreement(item, whole)
    found = [compare(policy, item, offset, (0.0, 0.0)) for offset in agreed.offsets or (whole,)]
    if agreed.usable and all(one.inside for one in found):
        return "verified"
    if agreed.usable and agreed.anchors >= REFUTING_ANCHORS and all(one.outside for one in found):
        return "refuted"
    return "inconclusive"


@lru_cache(maxsize=20_000)
def needed_sigmas(alternatives: stopping.Alternatives, s1_mm: float, step: float) -> float:
    """Distance from the buffer's edge, in standard deviations, from which on ``stopping.proved`` holds."""
    low, high = 0.0, _FAR_SIGMAS
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if stopping.proved(alternatives, ALPHA, BUFFER_MM, s1_mm, middle, step):
            high = middle
        else:
            low = middle
    return high


def settle(
    offset_mm: float,
    looks: Sequence[int],
    tries: int,
    *,
    one_round_mm: float = L1_ONE_ROUND_MM,
    floor_mm: float = 0.0,
    seed: int = 1,
) -> Settled:
    """Sessions of drones ``offset_mm`` from their claims along the long axis, looked at after each of ``looks``."""
    rng = np.random.default_rng(seed)
    bias: NDArray[np.float64] = rng.normal(0.0, floor_mm, tries) if floor_mm else np.zeros(tries)
    total = np.zeros(tries)
    rounds = np.full(tries, float(looks[-1]))
    open_ = np.arange(tries)
    verified = refuted = before = 0
    for n in looks:
        total += rng.normal(0.0, one_round_mm * math.sqrt(n - before), len(total)) + offset_mm * (n - before)
        before = n
        white = one_round_mm**2 / n
        deviation = math.sqrt(white + floor_mm**2)
        step = stopping.step_of(Matrix2(deviation**2, 0.0, 0.0), Matrix2(white, 0.0, 0.0), n)
        depth = (BUFFER_MM - np.abs(total / n + bias)) / deviation
        inside = depth >= needed_sigmas(stopping.INSIDE, deviation, step)
        outside = -depth >= needed_sigmas(stopping.OUTSIDE, deviation, step)
        verified += int(inside.sum())
        refuted += int(outside.sum())
        rounds[open_[inside | outside]] = n
        left = ~(inside | outside)
        open_, total, bias = open_[left], total[left], bias[left]
    return Settled(Share(verified, tries), Share(refuted, tries), float(rounds.mean()))


def wald_rounds(offset_mm: float, one_round_mm: float = L1_ONE_ROUND_MM) -> float:
    """Expected rounds of Wald's test between this offset and the buffer's edge, for errors of 1 % on each side."""
    delta = abs(abs(offset_mm) - BUFFER_MM)
    return 2 * one_round_mm**2 / delta**2 * (1 - 2 * ALPHA) * math.log((1 - ALPHA) / ALPHA)
