"""Attacks on the pad: its anchors, where they stand, its operator."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import (
    DEAR,
    NEAR_LIE,
    TWO_WAY,
    at_levels,
    lying,
    pad_at,
    ranges_of_claim,
    still,
)
from wonderland_research.attack_lab.attacks.common import turned as turned_about
from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import FIVE, SIX, SQUARE, LabPad, directions

SMALLEST_MM, LARGEST_MM = 50.0, 15_000.0


def compromised(level: int, pad: LabPad, rng: np.random.Generator, count: int) -> Batch:
    """One anchor reports what its attacker wants: the claim's range, or an error of 5 cm to 15 m either way."""
    claim, truth = lying(rng, count, pad=pad)
    anchors = len(pad.anchors)
    bad = rng.integers(0, anchors, count)
    chosen = np.arange(anchors) == bad[:, None]
    size = np.exp(rng.uniform(np.log(SMALLEST_MM), np.log(LARGEST_MM), count)) * rng.choice((-1.0, 1.0), count)
    fitting = rng.random(count) < 0.5
    error = np.where(fitting[:, None], ranges_of_claim(pad, claim, truth)[:, 0], size[:, None])
    lie = np.where(chosen, error, 0.0)[:, None, :]
    return still(rng, level, claim, truth, pad=pad, extra=lie, frames=lie)


def moved(level: int, rng: np.random.Generator, count: int) -> Batch:
    """One anchor stands 0.1 to 3 m from where it was surveyed."""
    claim, truth = lying(rng, count)
    anchors = np.repeat(SQUARE.anchors[None, None], count, axis=0)
    which = rng.integers(0, len(SQUARE.anchors), count)
    shift = directions(rng, count) * rng.uniform(100.0, 3_000.0, count)[:, None]
    anchors = anchors.copy()
    anchors[np.arange(count), 0, which] += shift
    return still(rng, level, claim, truth, anchors=anchors)


def turned(level: int, rng: np.random.Generator, count: int) -> Batch:
    """All anchors stand turned about the pad's middle, so that a drone is seen where it would be after that turn."""
    pad = pad_at(level)
    claim = np.rint(pad.places(rng, count))
    arc = rng.uniform(NEAR_LIE, 5_000.0, count) * rng.choice((-1.0, 1.0), count)
    truth = turned_about(claim, arc)
    angle = arc / np.linalg.norm(claim[:, :2], axis=1)
    cosine, sine = np.cos(angle), np.sin(angle)
    anchors = np.repeat(pad.anchors[None, None], count, axis=0)
    east, north = anchors[..., 0].copy(), anchors[..., 1].copy()
    anchors[..., 0] = east * cosine[:, None, None] - north * sine[:, None, None]
    anchors[..., 1] = east * sine[:, None, None] + north * cosine[:, None, None]
    return still(rng, level, claim, truth, pad=pad, anchors=anchors)


def _one_anchor(name: str, pad: LabPad, stops: str) -> Attack:
    count = len(pad.anchors)
    return Attack(
        name,
        Family.PAD,
        f"One compromised anchor of {count}: any error, or the one that fits the lie (3 to 9 m)",
        "One of the pad's nodes: its firmware, or a transmitter beside it.",
        "Access to one anchor.",
        "A permission more than one buffer from the claim.",
        stops,
        0,
        (
            Variant(TWO_WAY, make=partial(compromised, 2, pad)),
            Variant((3,), make=partial(compromised, 3, pad), dear=DEAR),
        ),
        wire=name if pad is SQUARE else "",
    )


ATTACKS: Final = (
    _one_anchor(
        "compromised-anchor",
        SQUARE,
        "The others contradict it. Four anchors cannot say which one is bad, so that such a session ends open.",
    ),
    _one_anchor("compromised-anchor-of-5", FIVE, "The others contradict it, and still settle the session."),
    _one_anchor("compromised-anchor-of-6", SIX, "The others contradict it, and still settle the session."),
    Attack(
        "anchor-moved",
        Family.PAD,
        "One anchor moved by 0.1 to 3 m after commissioning; lies of 3 to 9 m",
        "A pad's anchor, by hand.",
        "A screwdriver.",
        "A permission more than one buffer from the claim.",
        "The ranges contradict one another; the pad notices it when idle, too.",
        0,
        (Variant(TWO_WAY, make=partial(moved, 2)),),
        wire="anchor-moved",
    ),
    Attack(
        "anchors-turned",
        Family.PAD,
        "All anchors turned about the pad's middle together, so that the drone is seen 3 to 5 m beside",
        "All of a pad's anchors, by hand, moved as one rigid body.",
        "A screwdriver and a survey: ranges among the anchors stay as they were.",
        "A permission more than one buffer from the claim.",
        "Level 4: the second pad sees the drone where it is. One pad alone is turned with its anchors.",
        4,
        at_levels(turned, *TWO_WAY),
        wire="anchors-turned",
    ),
)
