"""Lies at some moments and truth at others: keys, radio and ranges are honest, some of the signed claims are not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland_research.attack_lab.attacks.common import (
    DEAR,
    TIMED_LEVEL,
    TWO_WAY,
    WITNESSED_LEVEL,
    pad_at,
    policy,
    ranges_of_claim,
    still,
    turned,
)
from wonderland_research.attack_lab.batch import Batch, claim_times, measured, off, round_times, rounded_cm
from wonderland_research.attack_lab.blinks import heard
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import (
    FIRST_ROUND_MS,
    ROUND_MS,
    ROUNDS,
    SMALL,
    SQUARE,
    Floats,
    LabPad,
    directions,
    distances,
    witness_of,
)

CLAIM_MS: Final = 100
PLANNED_ROUNDS: Final = (10, 20, 40, 80, 160)
"""The attacker plans its lies for a session of so many rounds; it cannot know when the pad will be content."""
LEAST_LIE_MM: Final = 2_000.0
MOST_LIE_MM: Final = 10_000.0
LEAST_DROPPED_MM: Final = 1_500.0
MOST_DROPPED_MM: Final = 4_000.0
_FASTEST: Final = 6.0
SWINGS: Final = (1.0, 1.03, 2.0, 2.06, 3.0, 4.0, 4.1, 6.0, 8.0)
"""Periods in the session that the attacker plans for."""
ACCELERATION_MM_MS2: Final = 0.01


def plan(rng: np.random.Generator, kind: int, share: float, planned_ms: float) -> Floats:
    """How much of the lie each claim tells, −1 to 1 and beyond: few, many, both sides, growing, first, last, waves."""
    times = claim_times(CLAIM_MS)
    passed = (times - FIRST_ROUND_MS) / planned_ms
    drawn = rng.random(len(times))
    period = rng.choice([0.1, 0.25, 0.5, 1.0, 2.0])
    turn = (passed / period + rng.random()) % 1.0
    begin = rng.random() * (1.0 - share)
    told = (
        np.where(drawn < share, 1.0, 0.0),
        np.where(drawn < share / 2, 1.0, np.where(drawn > 1.0 - share / 2, -1.0, 0.0)),
        np.where(turn < share, 1.0, -share / (1.0 - share)),
        1.25 * np.sin(2.0 * np.pi * turn),
        np.where((passed >= begin) & (passed < begin + share), 1.0, 0.0),
        np.where(passed < share, 1.0, 0.0),
        np.where(passed > 1.0 - share, 1.0, 0.0),
        2.67 * (passed - 0.5),
        np.where(np.arange(len(times)) % 2 == 0, 1.0, -1.0),
    )[kind]
    during = (passed >= 0.0) & (passed <= 1.0)
    # Half of them keep the mean of their claims where they are.
    return told - told[during].mean() if rng.random() < 0.5 else told


KINDS: Final = 9


def some_plan(rng: np.random.Generator, planned_ms: float) -> Floats:
    """Any of the plans."""
    return plan(rng, int(rng.integers(KINDS)), rng.uniform(0.25, 0.7), planned_ms)


def middle_plan(rng: np.random.Generator, planned_ms: float) -> Floats:
    """A short lie about the middle of the session, whose claim the verdict's place may be of: sudden, slow, or both."""
    passed = (claim_times(CLAIM_MS) - FIRST_ROUND_MS) / planned_ms
    width = rng.uniform(0.02, 0.3)
    away = (passed - 0.5 - rng.uniform(-1.0, 1.0) * width) / width
    return np.asarray(
        (
            np.where(np.abs(away) < 0.5, 1.0, 0.0),
            np.maximum(0.0, 1.0 - np.abs(away)),
            np.where(np.abs(away) < 0.5, np.sign(away), 0.0),
        )[int(rng.integers(3))]
    )


def mixed(
    level: int,
    pad: LabPad,
    rng: np.random.Generator,
    count: int,
    *,
    aloud: bool = False,
    planned: Callable[[np.random.Generator, float], Floats] = some_plan,
) -> Batch:
    """Hovering or in flight; across the line of sight more often than not, where a pad sees least."""
    place = pad.places(rng, count)
    velocity = directions(rng, count) * rng.uniform(0.5, _FASTEST, count)[:, None] * (rng.random((count, 1)) < 0.5)
    middle_ms = FIRST_ROUND_MS + ROUND_MS * ROUNDS / 2

    def flown(times_ms: Floats) -> Floats:
        return np.asarray(place[:, None, :] + velocity[:, None, :] * (times_ms - middle_ms)[None, :, None])

    away = np.maximum(np.linalg.norm(place[:, :2], axis=1), 1.0)
    across = np.column_stack((-place[:, 1] / away, place[:, 0] / away, np.zeros(count)))
    heading = np.where(rng.random((count, 1)) < 0.6, across, directions(rng, count))
    size = LEAST_LIE_MM * (MOST_LIE_MM / LEAST_LIE_MM) ** rng.random(count)
    told = np.stack([planned(rng, float(ROUND_MS * rng.choice(PLANNED_ROUNDS))) for _ in range(count)])
    lies = told[:, :, None] * (heading * size[:, None])[:, None, :]
    claims = np.rint(flown(claim_times(CLAIM_MS).astype(np.float64)) + lies).astype(np.int64)
    truth = flown(round_times().astype(np.float64))
    witness = witness_of(pad) if level >= WITNESSED_LEVEL else None
    return Batch(
        pad,
        claims,
        measured(rng, pad, truth),
        off(truth, claims, CLAIM_MS),
        level,
        policy(level),
        broadcast=claims if aloud else None,
        claim_ms=CLAIM_MS,
        truth_mm=truth,
        heard_mm=heard(rng, pad, truth) if level >= TIMED_LEVEL else None,
        witness=witness,
        witness_heard_mm=None if witness is None else heard(rng, witness, truth),
    )


def swinging(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """It claims to hover, and swings across the line of sight: whole periods in the session, or nearly."""
    claim = np.rint(pad.places(rng, count))
    planned_ms = float(ROUND_MS) * rng.choice(PLANNED_ROUNDS[2:], count)
    period_ms = planned_ms / rng.choice(SWINGS, count)
    # From one side to the other by turning as fast as it can all the time: two parabolas.
    peak_mm = np.minimum(ACCELERATION_MM_MS2 * period_ms**2 / 32.0, rng.uniform(1_200.0, 4_000.0, count))
    part = 2.0 * ((round_times()[None, :] / period_ms[:, None] + rng.random((count, 1))) % 1.0)
    side = np.where(part < 1.0, 1.0, -1.0) * 4.0 * (part % 1.0) * (1.0 - part % 1.0)
    away = np.maximum(np.linalg.norm(claim[:, :2], axis=1), 1.0)
    across = np.column_stack((-claim[:, 1] / away, claim[:, 0] / away, np.zeros(count)))
    truth = claim[:, None, :] + (peak_mm[:, None] * side)[:, :, None] * across[:, None, :]
    said = np.repeat(claim[:, None, :], len(claim_times(CLAIM_MS)), axis=1).astype(np.int64)
    return Batch(
        pad,
        said,
        measured(rng, pad, truth),
        off(truth, said, CLAIM_MS),
        level,
        policy(level),
        claim_ms=CLAIM_MS,
        truth_mm=truth,
    )


def timed(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The same where time stamps have to agree."""
    return mixed(level, pad_at(level), rng, count)


def glitch(rng: np.random.Generator, count: int) -> Batch:
    """An honest drone whose receiver jumps by 2 to 10 m for 0.4 s, some time."""
    batch = mixed(2, SQUARE, rng, count)
    times = claim_times(CLAIM_MS)
    start = rng.uniform(0.0, 4_000.0, count)
    during = (times[None, :] >= start[:, None]) & (times[None, :] < start[:, None] + 400.0)
    assert batch.truth_mm is not None
    whole = np.stack(
        [
            np.stack([np.interp(times, batch.t_ms, truth[:, axis]) for axis in range(3)], axis=1)
            for truth in batch.truth_mm
        ]
    )
    jump = directions(rng, count) * rng.uniform(LEAST_LIE_MM, MOST_LIE_MM, count)[:, None]
    batch.claims = np.rint(whole + during[:, :, None] * jump[:, None, :]).astype(np.int64)
    batch.off_mm = off(batch.truth_mm, batch.claims, CLAIM_MS)
    batch.won_if_refuted = True
    return batch


def silent(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """Of each round the one anchor whose noise suits the claim least is left out of the drone's frames."""
    claim = np.rint(pad.places(rng, count))
    truth = turned(claim, rng.uniform(LEAST_DROPPED_MM, MOST_DROPPED_MM, count) * rng.choice((-1.0, 1.0), count))
    batch = still(rng, level, claim, truth, pad=pad)
    wanted = ranges_of_claim(pad, claim, truth)
    noise = rng.normal(0.0, float(pad.range_sigma), (count, ROUNDS, len(pad.anchors)))
    batch.range_mm = rounded_cm(distances(truth[:, None, :], pad.anchors) + noise)
    worst = (noise * np.sign(wanted)).argmin(axis=2)
    np.put_along_axis(batch.range_mm, worst[:, :, None], NO_RANGE, axis=2)
    return batch


WINS: Final = (
    "A permission with a certified place more than one buffer from the drone at its moment, or while a quarter of the "
    "claimed moments are two buffers off."
)
_STOPS: Final = (
    "Every claimed moment is judged: rounds in which half of the anchors contradict the claims of the others, claims "
    "that no round saw, and a bound on how far the claims waver about the drone; where that is not small nothing is "
    "verified. The place is that of the rounds that agree."
)
ATTACKS: Final = (
    Attack(
        "mixed-claims",
        Family.CLAIM,
        "Lies in some of its signed claims, the truth in the others (2 to 10 m, a quarter to all)",
        "What it claims at each moment; it knows where the pad looks and how often.",
        "Nothing.",
        WINS,
        _STOPS,
        0,
        (
            Variant(TWO_WAY, make=partial(mixed, 2, SQUARE)),
            Variant((TIMED_LEVEL,), make=partial(timed, TIMED_LEVEL), dear=DEAR),
            Variant((WITNESSED_LEVEL,), make=partial(timed, WITNESSED_LEVEL), dear=DEAR),
        ),
        wire="mixed-claims",
    ),
    Attack(
        "mixed-claims-small-pad",
        Family.CLAIM,
        "The same at the paper's pad from 12 to 14 m, where no single range gives a lie away",
        "As before.",
        "Nothing.",
        WINS,
        _STOPS,
        0,
        (Variant(TWO_WAY, make=partial(mixed, 2, SMALL)),),
    ),
    *(
        Attack(
            f"mixed-claims-middle{suffix}",
            Family.CLAIM,
            f"A short lie (2 to 10 m) about the middle of the session, which the verdict's place might be of; {where}",
            "As before.",
            "Nothing.",
            WINS,
            "The place is that of a moment which the rounds about it bear out, with a claim like its neighbours'.",
            0,
            (Variant(TWO_WAY, make=partial(mixed, 2, pad, planned=middle_plan)),),
        )
        for suffix, pad, where in (("", SQUARE, "the lab's square"), ("-small-pad", SMALL, "the paper's pad"))
    ),
    *(
        Attack(
            f"swinging{suffix}",
            Family.CLAIM,
            f"It claims to hover, and swings by up to 4 m as fast as it can turn (10 m/s²); {where}",
            "How it flies; its claims stand still.",
            "Nothing.",
            WINS,
            "Means over stretches of the session, of many lengths, against what the radio's errors can be: those that "
            "no place explains, and those from one round to the next.",
            0,
            (Variant(TWO_WAY, make=partial(swinging, 2, pad)),),
            tolerated=tolerated,
        )
        # From 13 m the paper's pad knows a place to a metre in half a second: swings of 1.0 to 1.2 m can hide.
        for suffix, pad, where, tolerated in (
            ("", SQUARE, "the lab's square", 0.005),
            ("-small-pad", SMALL, "the paper's pad", 0.03),
        )
    ),
    Attack(
        "mixed-claims-aloud",
        Family.CLAIM,
        "The same, and it broadcasts what it signs",
        "As before, and its Remote ID.",
        "Nothing.",
        WINS,
        _STOPS,
        0,
        (Variant(TWO_WAY, make=partial(mixed, 2, SQUARE, aloud=True), dear=DEAR),),
    ),
    Attack(
        "gnss-glitch",
        Family.GNSS,
        "An honest drone whose receiver jumps by 2 to 10 m for 0.4 s",
        "Nothing: it happens.",
        "Nothing.",
        "The drone is refuted, or certified at a wrong place.",
        "Claims that contradict one another refute nobody; the place is that of the rounds that agree.",
        0,
        (Variant(TWO_WAY, make=glitch),),
    ),
    Attack(
        "silent-anchors",
        Family.INSIDER,
        "One anchor of each round is left out, the one whose noise suits a lie of 1.5 to 4 m least; the paper's pad",
        "Which responders the drone names in its frames; here it also foresees the pad's noise.",
        "A changed radio driver.",
        "A permission more than one buffer from the claim.",
        "Silence that varies from round to round counts, whichever anchor keeps it: fewer than half of the rounds are "
        "whole.",
        0,
        (Variant((1, 2), make=partial(silent, 2, SMALL)),),
        wire="silent-anchors",
    ),
)
