"""The insider: the drone's owner has its keys and changes its radio.

In two-way ranging the drone supplies time stamps, and every range is computed from them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import (
    FAR_LIE,
    NEAR_LIE,
    PAD_MEASURES,
    at_levels,
    lying,
    pad_at,
    radially,
    ranges_of_claim,
    still,
    turned,
)
from wonderland_research.attack_lab.batch import Batch, rounded_cm
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import ROUNDS, SMALL, SQUARE, Floats, LabPad, distances

SMALL_PAD_LIES_MM: Final = (NEAR_LIE, 4_000.0)
SQUARE_PAD_LIES_MM: Final = (NEAR_LIE, FAR_LIE)
_LUCKY: Final = 1e-4
"""In no more sessions than this share may lies at random happen to fit (3 of 100,000 were seen)."""


def invented(rng: np.random.Generator, count: int) -> Batch:
    """Level 0: the drone reports ranges that it made up."""
    claim, truth = lying(rng, count)
    return still(rng, 0, claim, truth, extra=ranges_of_claim(SQUARE, claim, truth))


def uniform(level: int, rng: np.random.Generator, count: int) -> Batch:
    """One false time for all: every range is off by the same, either way."""
    pad = pad_at(level)
    claim, truth = radially(rng, count, pad=pad)
    nearer = rng.random(count) < 0.5
    claim, truth = np.where(nearer[:, None], np.rint(truth), claim), np.where(nearer[:, None], claim, truth)
    extra = ranges_of_claim(pad, claim, truth).mean(axis=2, keepdims=True)
    return still(rng, level, claim, truth, pad=pad, extra=extra)


def per_anchor(level: int, rng: np.random.Generator, count: int) -> Batch:
    """A false time for each anchor, such that the ranges fit the claim exactly."""
    pad = pad_at(level)
    claim, truth = lying(rng, count, pad=pad)
    return still(rng, level, claim, truth, pad=pad, extra=ranges_of_claim(pad, claim, truth))


def per_anchor_far(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The same where time differences tell least: far out, along the bearing, and no farther off than need be."""
    pad = replace(pad_at(level), near=11_000.0)
    truth, claim = radially(rng, count, far=4_000.0, pad=pad)
    outer = rng.random(count) < 0.5
    claim, truth = np.where(outer[:, None], np.rint(claim), truth), np.where(outer[:, None], truth, claim)
    claim = np.rint(claim)
    return still(rng, level, claim, truth, pad=pad, extra=ranges_of_claim(pad, claim, truth))


def mixed(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Lies in a random half of the rounds, twice as large as needed, honest in the others."""
    claim, truth = lying(rng, count)
    half = rng.random((count, ROUNDS, 1)) < 0.5
    return still(rng, level, claim, truth, extra=np.where(half, 2.0 * ranges_of_claim(SQUARE, claim, truth), 0.0))


def choosy(
    level: int, pad: LabPad, lies_mm: tuple[float, float], attempts: int, rng: np.random.Generator, count: int
) -> Batch:
    """A lie across the line of sight, where the pad is least sure; of so many rounds the one whose noise suits best."""
    claim = np.rint(pad.places(rng, count))
    truth = turned(claim, rng.uniform(*lies_mm, count) * rng.choice((-1.0, 1.0), count))
    batch = still(rng, level, claim, truth, pad=pad)
    wanted = ranges_of_claim(pad, claim, truth)
    noise = best_noise(rng, wanted, float(pad.range_sigma), attempts)
    batch.range_mm = rounded_cm(distances(truth[:, None, :], pad.anchors) + noise)
    batch.attempts = attempts
    return batch


def best_noise(rng: np.random.Generator, wanted: Floats, sigma: float, attempts: int) -> Floats:
    """Of ``attempts`` draws for each round the one that goes farthest towards the wanted errors: (B, ROUNDS, A)."""
    count, _, anchors = wanted.shape
    size = np.maximum(np.linalg.norm(wanted, axis=2, keepdims=True), 1e-9)
    best = rng.normal(0.0, sigma, (count, ROUNDS, anchors))
    miss = np.abs((best * wanted / size).sum(axis=2, keepdims=True) - size)
    for _ in range(attempts - 1):
        other = rng.normal(0.0, sigma, (count, ROUNDS, anchors))
        its = np.abs((other * wanted / size).sum(axis=2, keepdims=True) - size)
        better = (its < miss)[:, :, 0]
        best[better] = other[better]
        miss = np.minimum(miss, its)
    return np.asarray(best, dtype=np.float64)


_STAMPS: Final = "The drone's UWB firmware: it reports false times to the pad."
_STAMPS_COST: Final = "A UWB chip whose firmware one can change, and the drone's own keys."
ATTACKS: Final = (
    Attack(
        "invented-ranges",
        Family.INSIDER,
        "Ranges made up by the drone that reports them (3 to 9 m)",
        "The drone's software, on pads whose boards let the drone compute the ranges (level 0).",
        "Nothing.",
        "A permission more than one buffer from the claim.",
        "Level 1: the pad measures itself. The default policy never verifies at level 0.",
        1,
        (Variant((0,), make=invented),),
    ),
    Attack(
        "uniform-stamp-lie",
        Family.INSIDER,
        "One false time for all anchors: every range off by the same, 3 to 9 m nearer or farther",
        _STAMPS,
        _STAMPS_COST,
        "A permission more than one buffer from the claim.",
        "Level 3: all anchors time-stamp the same frame, and one frame cannot have two times.",
        3,
        at_levels(uniform, *PAD_MEASURES, dear=1),
        wire="uniform-stamp-lie",
    ),
    Attack(
        "per-anchor-stamp-lie",
        Family.INSIDER,
        "A false time for each anchor, so that the ranges fit the claim exactly (3 to 9 m)",
        _STAMPS,
        _STAMPS_COST,
        "A permission more than one buffer from the claim.",
        "Level 3. No statistic of two-way ranges can: they are perfect.",
        3,
        at_levels(per_anchor, *PAD_MEASURES, dear=1),
        wire="per-anchor-stamp-lie",
    ),
    Attack(
        "per-anchor-stamp-lie-far",
        Family.INSIDER,
        "The same where time differences tell least: 11 to 18 m out, along the bearing, 3 to 4 m",
        _STAMPS,
        _STAMPS_COST,
        "A permission more than one buffer from the claim.",
        "Level 3: what the differences alone do not prove is not verified there.",
        3,
        (Variant((1, 2), make=partial(per_anchor_far, 2)), Variant((3,), make=partial(per_anchor_far, 3))),
    ),
    Attack(
        "mixed-rounds",
        Family.INSIDER,
        "Lies in a random half of the rounds, twice as large as needed, so that the mean fits",
        _STAMPS,
        _STAMPS_COST,
        "A permission more than one buffer from the claim.",
        "Bursts are left out about the median, and the rest does not fit the claim. Three in 100,000 were lucky; the "
        "same firmware wins every time by a false time for each anchor, which level 3 stops.",
        0,
        (Variant((1, 2), make=partial(mixed, 2)),),
        tolerated=_LUCKY,
        wire="mixed-rounds",
    ),
    Attack(
        "dropped-rounds",
        Family.INSIDER,
        "Only the round of ten whose noise suits the claim best reaches the pad",
        "Which of its frames the drone sends to the end; here it also foresees the pad's noise.",
        "A changed radio driver.",
        "A permission more than one buffer from the claim.",
        "Noise of centimetres cannot be chosen into metres, where the pad is as wide as it should be; and rounds that "
        "were attempted and did not come about count.",
        0,
        (Variant((1, 2), make=partial(choosy, 2, SQUARE, SQUARE_PAD_LIES_MM, 10)),),
        wire="dropped-rounds",
    ),
    Attack(
        "dropped-rounds-small-pad",
        Family.INSIDER,
        "Only the round of forty, at the paper's pad (0.34 by 0.56 m) from 12 to 14 m",
        "As before.",
        "As before.",
        "A permission more than one buffer from the claim.",
        "More than half of the rounds that the pad attempted are missing: no honest channel explains that.",
        0,
        (Variant((1, 2), make=partial(choosy, 2, SMALL, SMALL_PAD_LIES_MM, 40)),),
    ),
    Attack(
        "dropped-rounds-half",
        Family.INSIDER,
        "The better one of two rounds, which an honest channel might explain, at the paper's pad",
        "As before.",
        "As before.",
        "A permission more than one buffer from the claim.",
        "The better one of two moves the mean by half of the noise, which is less than a lie of three buffers needs.",
        0,
        (Variant((1, 2), make=partial(choosy, 2, SMALL, SMALL_PAD_LIES_MM, 2)),),
    ),
)
