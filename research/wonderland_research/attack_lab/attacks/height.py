"""Lies about the height, where the pad's geometry tells it and the policy demands that it is proved."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.policies import Policy
from wonderland_research.attack_lab.attacks.common import DEAR, PAD_MEASURES, TIMED_LEVEL, TWO_WAY, policy, still
from wonderland_research.attack_lab.attacks.moments import (
    CLAIM_MS,
    KINDS,
    LEAST_LIE_MM,
    MOST_LIE_MM,
    PLANNED_ROUNDS,
    plan,
)
from wonderland_research.attack_lab.batch import Batch, claim_times, measured, round_times, vertically_off
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import CUBE, FLAT, MASTS, ROUND_MS, SIX, SQUARE, Floats, LabPad, distances

PADS: Final = (CUBE, MASTS, SQUARE, SIX, FLAT)
"""From one that tells every height to one that tells hardly any."""
LEAST_MM: Final = 1_000.0
MOST_MM: Final = 6_000.0
GNSS_HEIGHT_MM: Final = 250.0
BAD_ANCHOR_MM: Final = 4_000.0


def demanding(level: int) -> Policy:
    """The default policy with a proven height demanded."""
    return replace(policy(level), height_required=True)


def still_at(
    rng: np.random.Generator, level: int, pad: LabPad, claim: Floats, truth: Floats, extra: Floats | None = None
) -> Batch:
    """Drones that stand still, judged by their heights."""
    delay = None if extra is None or level < TIMED_LEVEL else np.zeros_like(extra)  # of frames: no difference is made
    batch = still(rng, level, np.rint(claim), truth, pad=pad, extra=extra, frames=delay)
    batch.policy = demanding(level)
    batch.vertical = True
    batch.off_mm = vertically_off(truth[:, None, :], batch.claims)
    return batch


def lie(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """1 to 6 m above or below where it is, and true on the map."""
    truth = pad.places(rng, count)
    lies = rng.uniform(LEAST_MM, MOST_MM, count) * rng.choice((-1.0, 1.0), count)
    return still_at(rng, level, pad, truth + lies[:, None] * np.array((0.0, 0.0, 1.0)), truth)


def delayed(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """It answers late or early by as much as makes its ranges, on average, those of the false height."""
    claim = pad.places(rng, count)
    truth = claim + rng.uniform(LEAST_MM, MOST_MM, count)[:, None] * np.array((0.0, 0.0, 1.0))
    truth[:, 2] = np.where(rng.random(count) < 0.5, truth[:, 2], np.maximum(2.0 * claim[:, 2] - truth[:, 2], 0.0))
    wanted = distances(claim, pad.anchors) - distances(truth, pad.anchors)
    extra = np.repeat(wanted.mean(axis=1)[:, None, None], len(pad.anchors), axis=2)
    return still_at(rng, level, pad, claim, truth, extra)


def mixed(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """Hovering or climbing; some of its claims are true in height, others are not."""
    place = pad.places(rng, count)
    climb = rng.uniform(-2.0, 2.0, count) * (rng.random(count) < 0.5)
    middle_ms = round_times().mean()

    def flown(times_ms: Floats) -> Floats:
        path = np.repeat(place[:, None, :], len(times_ms), axis=1)
        path[:, :, 2] += climb[:, None] * (times_ms - middle_ms)[None, :]
        return path

    size = LEAST_LIE_MM * (MOST_LIE_MM / LEAST_LIE_MM) ** rng.random(count)
    told = np.stack(
        [
            plan(rng, int(rng.integers(KINDS)), rng.uniform(0.25, 0.7), float(ROUND_MS * rng.choice(PLANNED_ROUNDS)))
            for _ in range(count)
        ]
    )
    claims = flown(claim_times(CLAIM_MS).astype(np.float64))
    claims[:, :, 2] += told * size[:, None]
    whole = np.rint(claims).astype(np.int64)
    truth = flown(round_times().astype(np.float64))
    return Batch(
        pad,
        whole,
        measured(rng, pad, truth),
        vertically_off(truth, whole, CLAIM_MS),
        level,
        demanding(level),
        claim_ms=CLAIM_MS,
        truth_mm=truth,
        height_accuracy_mm=200,
        vertical=True,
    )


def bad_anchor(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """An honest drone; one anchor measures too much, behind an obstacle, or whatever its owner likes."""
    truth = pad.places(rng, count)
    claim = truth + rng.normal(0.0, GNSS_HEIGHT_MM, count)[:, None] * np.array((0.0, 0.0, 1.0))
    extra = np.zeros((count, 1, len(pad.anchors)))
    extra[np.arange(count), 0, rng.integers(len(pad.anchors), size=count)] = rng.uniform(
        -BAD_ANCHOR_MM, BAD_ANCHOR_MM, count
    )
    batch = still_at(rng, level, pad, claim, truth, extra)
    batch.won_if_refuted = True
    return batch


def honest(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Claims are wrong by what a good receiver errs, 25 cm in height; some fly where anchors tell no height."""
    pad = PADS[int(rng.integers(len(PADS)))]
    low = replace(pad, low=0.0, high=3_000.0)
    truth = np.where((rng.random(count) < 0.5)[:, None], pad.places(rng, count), low.places(rng, count))
    claim = truth + rng.normal(0.0, GNSS_HEIGHT_MM, count)[:, None] * np.array((0.0, 0.0, 1.0))
    batch = still_at(rng, level, pad, claim, truth)
    batch.height_accuracy_mm = round(2.0 * GNSS_HEIGHT_MM)
    batch.won_if_refuted = True
    return batch


_WINS: Final = "A permission that demands a proven height, with one more than a buffer off."
ATTACKS: Final = (
    Attack(
        "height-honest",
        Family.BASELINE,
        "No attack: an honest drone whose height has to be proved, at pads that tell much of it, and little",
        "Nothing.",
        "–",
        "The drone is refuted.",
        "Near the anchors' plane the likelihood of a height is no bell: the ranges themselves are asked.",
        0,
        (Variant(TWO_WAY, make=partial(honest, 2), dear=DEAR),),
    ),
    Attack(
        "height-offset",
        Family.CLAIM,
        "1 to 6 m above or below where it is, six anchors at two heights",
        "The height in its claims.",
        "Nothing.",
        _WINS,
        "The ranges alone give the height, without its claim.",
        0,
        (Variant(TWO_WAY, make=partial(lie, 2, MASTS), dear=DEAR),),
        wire="height-offset",
    ),
    Attack(
        "height-offset-cube",
        Family.CLAIM,
        "The same inside a cube of eight anchors, and above it",
        "The height in its claims.",
        "Nothing.",
        _WINS,
        "As before.",
        0,
        (Variant(TWO_WAY, make=partial(lie, 2, CUBE), dear=DEAR),),
    ),
    Attack(
        "height-offset-square",
        Family.CLAIM,
        "The same at four anchors, one raised: nobody is refuted on them, and nothing false is proved",
        "The height in its claims.",
        "Nothing.",
        _WINS,
        "Four ranges leave one to contradict the three unknowns.",
        0,
        (Variant(TWO_WAY, make=partial(lie, 2, SQUARE), dear=DEAR),),
    ),
    Attack(
        "height-mixed",
        Family.CLAIM,
        "False heights in some of its claims (2 to 10 m, a quarter to all), the truth in the others",
        "The height in its claims.",
        "Nothing.",
        "A permission that demands a proven height, with one more than a buffer off, or while a quarter of the claimed "
        "heights are two buffers off.",
        "Heights that waver beyond what the ranges follow prove nothing.",
        0,
        (Variant(TWO_WAY, make=partial(mixed, 2, MASTS), dear=DEAR),),
    ),
    Attack(
        "height-one-anchor",
        Family.PAD,
        "One anchor measures up to 4 m too much or too little; the drone is honest",
        "One anchor, or what stands before it.",
        "Its key, or a wall.",
        "The drone is refuted.",
        "No height is contradicted that is not without each of the anchors.",
        0,
        (Variant(TWO_WAY, make=partial(bad_anchor, 2, SIX), dear=DEAR),),
    ),
    Attack(
        "height-delayed",
        Family.RADIO,
        "It answers late or early by as much as a false height wants, six anchors, one raised",
        "The drone's antenna path, and the height in its claims.",
        "A delay line.",
        _WINS,
        "Below level 3 nothing, where all anchors stand below it: one delay is as good as a height. From level 3 "
        "on the time stamps of its frames have to prove the height as well.",
        TIMED_LEVEL,
        (
            Variant(PAD_MEASURES, make=partial(delayed, 2, SIX), dear=DEAR),
            Variant((TIMED_LEVEL,), make=partial(delayed, TIMED_LEVEL, MASTS), dear=DEAR),
        ),
    ),
)
