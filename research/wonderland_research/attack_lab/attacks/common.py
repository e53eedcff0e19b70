"""What the families share: where drones stand and how far they lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.policies import Policy
from wonderland_research.attack_lab.batch import Batch, measured, off, standing
from wonderland_research.attack_lab.blinks import heard
from wonderland_research.attack_lab.model import Variant
from wonderland_research.attack_lab.places import (
    BETWEEN,
    POLICY,
    SQUARE,
    TIMED,
    Floats,
    LabPad,
    directions,
    distances,
    witness_of,
)

BUFFER_MM: Final = float(POLICY.buffer_mm)
NEAR_LIE: Final = 3.0 * BUFFER_MM
TIMED_LEVEL, WITNESSED_LEVEL = 3, 4
FAR_LIE: Final = 9.0 * BUFFER_MM
TWO_WAY: Final = (0, 1, 2)
PAD_MEASURES: Final = (1, 2)
ALL: Final = (0, 1, 2, 3, 4)


def pad_at(level: int) -> LabPad:
    """The square pad; where time stamps have to prove the place, six anchors wider apart; at level 4 two such pads."""
    return {TIMED_LEVEL: TIMED, WITNESSED_LEVEL: BETWEEN}.get(level, SQUARE)


DEAR: Final = 10
"""One try in ten where every look is a whole decision with time stamps."""


def at_levels(
    make: Callable[[int, np.random.Generator, int], Batch], *first: int, dear: int = DEAR
) -> tuple[Variant, ...]:
    """One simulation for these lower levels, which go the same way, and one each for 3 and 4."""
    return (
        Variant(first, make=partial(make, max(first))),
        Variant((TIMED_LEVEL,), make=partial(make, TIMED_LEVEL), dear=dear),
        Variant((WITNESSED_LEVEL,), make=partial(make, WITNESSED_LEVEL), dear=DEAR),
    )


def policy(level: int) -> Policy:
    """The defaults, and this level demanded."""
    return replace(POLICY, min_assurance=level)


def lying(
    rng: np.random.Generator, count: int, *, near: float = NEAR_LIE, far: float = FAR_LIE, pad: LabPad = SQUARE
) -> tuple[Floats, Floats]:
    """(claimed places, true places): a lie of ``near`` to ``far`` mm in any direction, level with the claim."""
    claim = np.rint(pad.places(rng, count))
    truth = claim + directions(rng, count) * rng.uniform(near, far, count)[:, None]
    return claim, truth


def radially(
    rng: np.random.Generator, count: int, *, near: float = NEAR_LIE, far: float = FAR_LIE, pad: LabPad = SQUARE
) -> tuple[Floats, Floats]:
    """(claimed, true): the drone stands nearer to the pad than it claims, or beyond it on the other side."""
    truth = pad.places(rng, count)
    outward = truth * np.array((1.0, 1.0, 0.0))
    outward = outward / np.maximum(np.linalg.norm(outward, axis=1), 1.0)[:, None]
    claim = np.rint(truth + outward * rng.uniform(near, far, count)[:, None])
    return claim, truth


def turned(places: Floats, arc_mm: Floats) -> Floats:
    """Places at the same distance from the pad's middle and height, an arc further round."""
    angle = arc_mm / np.maximum(np.linalg.norm(places[:, :2], axis=1), 1.0)
    cosine, sine = np.cos(angle), np.sin(angle)
    east, north = places[:, 0], places[:, 1]
    return np.column_stack((east * cosine - north * sine, east * sine + north * cosine, places[:, 2]))


def still(
    rng: np.random.Generator,
    level: int,
    claim: Floats,
    truth: Floats,
    *,
    pad: LabPad = SQUARE,
    extra: Floats | None = None,
    anchors: Floats | None = None,
    accuracy_mm: int = 100,
    height_accuracy_mm: int = 200,
    frames: Floats | None = None,
    witness_frames: Floats | None = None,
) -> Batch:
    """Drones that stand still at ``truth`` and claim ``claim``; ``extra`` are the attacker's errors in the ranges.

    ``frames``, ``witness_frames``: the attacker's delays of the drone's own frames for each anchor, if it has any.
    """
    claims = standing(claim)
    there = truth[:, None, :]
    timed = level >= TIMED_LEVEL
    witness = witness_of(pad) if level >= WITNESSED_LEVEL else None
    return Batch(
        pad,
        claims,
        measured(rng, pad, there, extra=extra, anchors=anchors),
        off(there, claims),
        assurance=level,
        policy=policy(level),
        accuracy_mm=accuracy_mm,
        height_accuracy_mm=height_accuracy_mm,
        heard_mm=heard(rng, pad, there, extra=frames, anchors=anchors) if timed else None,
        steady=extra is None or extra.shape[1] == 1,
        witness=witness,
        witness_heard_mm=None if witness is None else heard(rng, witness, there, extra=witness_frames),
    )


def ranges_of_claim(pad: LabPad, claim: Floats, truth: Floats) -> Floats:
    """Errors that make each anchor see exactly the claimed place: (B, 1, A)."""
    return (distances(claim, pad.anchors) - distances(truth, pad.anchors))[:, None, :]
