"""Attacks by words: the radio is honest, what is claimed is not."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import TWO_WAY, lying, policy, radially, still
from wonderland_research.attack_lab.batch import Batch, measured, moving, off, round_times, standing
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import FLAT, SQUARE, directions

STATED_MM: Final = 10_000
"""A common class of Remote ID receivers: better than 10 m."""
VAGUEST_MM: Final = 20_000
"""The default policy's limit for horizontal accuracy, and the decision's own for heights."""


def vague(level: int, rng: np.random.Generator, count: int) -> Batch:
    """As vague as is still taken, both ways."""
    claim, truth = lying(rng, count)
    return still(rng, level, claim, truth, accuracy_mm=VAGUEST_MM, height_accuracy_mm=VAGUEST_MM)


def height(level: int, accuracy_mm: int, rng: np.random.Generator, count: int) -> Batch:
    """Anchors in one plane; the claimed height makes the middle's slant range come out right."""
    claim, truth = radially(rng, count, pad=FLAT)
    slant2 = (truth**2).sum(axis=1)
    nearer = rng.random(count) < 0.5
    claim = np.where(nearer[:, None], 2.0 * truth - claim, claim)  # half of them claim to be nearer instead
    flat2 = (claim[:, :2] ** 2).sum(axis=1)
    claim[:, 2] = np.sqrt(np.maximum(slant2 - flat2, 0.0))  # where that cannot be, it claims the ground
    return still(rng, level, np.rint(claim), truth, pad=FLAT, height_accuracy_mm=accuracy_mm)


def clock(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Its stamps are wrong, so that it claims where it will be, or was, 3 to 9 m along its path."""
    place = SQUARE.places(rng, count)
    speed = rng.uniform(2.0, 15.0, count)
    heading = directions(rng, count)
    velocity = heading * speed[:, None]
    ahead = rng.uniform(3_000.0, 9_000.0, count) * rng.choice((-1.0, 1.0), count)
    truth = place[:, None, :] + velocity[:, None, :] * round_times()[None, :, None]
    claims = moving(place + heading * ahead[:, None], velocity)
    return Batch(SQUARE, claims, measured(rng, SQUARE, truth), off(truth, claims), level, policy(level))


def broadcast(
    level: int, nearest: float, farthest: float, stated_mm: int | None, rng: np.random.Generator, count: int
) -> Batch:
    """The truth to the pad, ``nearest`` to ``farthest`` mm beside it to everybody else."""
    place = SQUARE.places(rng, count)
    batch = still(rng, level, np.rint(place), place)
    shift = directions(rng, count) * rng.uniform(nearest, farthest, count)[:, None]
    batch.broadcast = standing(place + shift)
    batch.broadcast_accuracy_mm = stated_mm
    batch.won_mm = -1.0  # any permission is one too many
    return batch


ATTACKS: Final = (
    Attack(
        "remote-id-lie",
        Family.CLAIM,
        "Truth to the pad, a lie on Remote ID (3 to 30 m)",
        "What the drone broadcasts.",
        "A changed Remote ID module.",
        "Any permission.",
        "The pad hears the broadcast itself, and the contract holds it against the measurement: while none that was "
        "heard is supported, nothing is verified.",
        0,
        (Variant(TWO_WAY, make=partial(broadcast, 2, 3_000.0, 30_000.0, None)),),
        wire="remote-id-lie",
    ),
    Attack(
        "remote-id-lie-near",
        Family.CLAIM,
        "The same, 1.05 to 3 m beside the truth",
        "What the drone broadcasts.",
        "A changed Remote ID module.",
        "Any permission.",
        "As before; hardly beyond the buffer it may stay open.",
        0,
        (Variant(TWO_WAY, make=partial(broadcast, 2, 1_050.0, 3_000.0, None)),),
    ),
    Attack(
        "remote-id-lie-stated",
        Family.CLAIM,
        "The same, stated to be good to 10 m, 21 to 60 m beside the truth",
        "What the drone broadcasts, and how good it says that is.",
        "A changed Remote ID module.",
        "Any permission.",
        "A broadcast is held to twice what it states; none is excused more than the policy lets a claim be vague. "
        "Nearer than that the public was told the truth, vaguely.",
        0,
        (Variant(TWO_WAY, make=partial(broadcast, 2, 21_000.0, 60_000.0, STATED_MM)),),
    ),
    Attack(
        "vague-claim",
        Family.CLAIM,
        "A lie with the vaguest accuracy that is taken (20 m)",
        "The accuracies in its claims.",
        "Nothing.",
        "A permission more than one buffer from the claim.",
        "The claimed horizontal accuracy never widens the buffer; a vague height only makes the pad less sure.",
        0,
        (Variant(TWO_WAY, make=partial(vague, 2)),),
        wire="vague-claim",
    ),
    Attack(
        "height-lie",
        Family.CLAIM,
        "A height that makes the ranges fit, at anchors in one plane",
        "The height in its claims; the pad has no raised anchor.",
        "Nothing.",
        "A permission more than one buffer (horizontally) from the claim.",
        "Anchors see different elevations, so that the fit contradicts the claim or itself.",
        0,
        (Variant(TWO_WAY, make=partial(height, 2, 200)),),
        wire="height-lie",
    ),
    Attack(
        "height-lie-vague",
        Family.CLAIM,
        "The same, with a height that it says to know to 20 m only",
        "The height and its accuracy in the claims.",
        "Nothing.",
        "A permission more than one buffer (horizontally) from the claim.",
        "The height's uncertainty widens the ellipse: nothing is verified on it.",
        0,
        (Variant(TWO_WAY, make=partial(height, 2, VAGUEST_MM)),),
    ),
    Attack(
        "clock-lie",
        Family.CLAIM,
        "Wrong time stamps in flight: it claims where it will be, or was (3 to 9 m)",
        "The times in its claims.",
        "Nothing.",
        "A permission more than one buffer from the claim.",
        "A wrong clock is a lie along the path, and is judged as one; only 50 ms are granted to honest clocks.",
        0,
        (Variant(TWO_WAY, make=partial(clock, 2)),),
    ),
)
