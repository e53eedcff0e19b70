"""Attacks on what a moving drone averages out: at a pad whose biases change over place (``proofs.travel``)."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import BUFFER_MM, DEAR, TWO_WAY, policy
from wonderland_research.attack_lab.batch import Batch, measured, moving, off, round_times
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import FLOWN, ROUND_MS, ROUNDS, Floats, directions, systematic_along

NEAREST_LIE, FARTHEST_LIE = 1.5 * BUFFER_MM, 3.0 * BUFFER_MM
SLOWEST, FASTEST = 0.05, 3.0
"""m/s: from half a metre in a session to 24 m."""
MIDDLE_MS: Final = 500.0 + 0.5 * ROUND_MS * ROUNDS


def _places(rng: np.random.Generator, count: int, velocity: Floats) -> Floats:
    """Where the drones are at the request; in the middle of the session they are about the pad."""
    return FLOWN.places(rng, count) - velocity * MIDDLE_MS


def _velocities(rng: np.random.Generator, count: int) -> Floats:
    speed = np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST), count))
    return directions(rng, count) * speed[:, None]


def _along(place: Floats, velocity: Floats) -> Floats:
    return np.asarray(place[:, None, :] + velocity[:, None, :] * round_times()[None, :, None])


def _batch(rng: np.random.Generator, level: int, claims: Floats, velocity: Floats, truth: Floats) -> Batch:
    said = moving(claims, velocity)
    ranges = measured(rng, FLOWN, truth, bias=systematic_along(rng, FLOWN, truth))
    return Batch(FLOWN, said, ranges, off(truth, said), level, policy(level))


def claimed(level: int, rng: np.random.Generator, count: int) -> Batch:
    """It hovers, 1.5 to 3 m beside where its claims fly by."""
    velocity = _velocities(rng, count)
    place = _places(rng, count, velocity)
    hovers = place + velocity * MIDDLE_MS + directions(rng, count) * rng.uniform(NEAREST_LIE, FARTHEST_LIE, (count, 1))
    return _batch(rng, level, place, velocity, np.repeat(hovers[:, None, :], ROUNDS, axis=1))


def flown(level: int, rng: np.random.Generator, count: int) -> Batch:
    """It flies as it claims to, 1.5 to 3 m beside."""
    velocity = _velocities(rng, count)
    place = _places(rng, count, velocity)
    beside = place + directions(rng, count) * rng.uniform(NEAREST_LIE, FARTHEST_LIE, (count, 1))
    return _batch(rng, level, place, velocity, _along(beside, velocity))


def honest(level: int, fly: bool, rng: np.random.Generator, count: int) -> Batch:
    """It flies, or hovers, where it says."""
    velocity = _velocities(rng, count) * (1.0 if fly else 0.0)
    place = np.rint(_places(rng, count, velocity))
    batch = _batch(rng, level, place, velocity, _along(place, velocity))
    batch.rightful = True
    return batch


ATTACKS: Final = (
    Attack(
        "claimed-motion",
        Family.CLAIM,
        "Hovering, 1.5 to 3 m beside a path that it claims to fly (0.05 to 3 m/s)",
        "What it claims; it would be believed to average the pad's biases out.",
        "Nothing.",
        "A permission more than one buffer from the claim.",
        "How far a drone went is read off the ranges of all anchors but one, never off its claims: a drone that "
        "hovers averages nothing out.",
        0,
        (Variant(TWO_WAY, make=partial(claimed, 2), dear=DEAR),),
    ),
    Attack(
        "flown-offset",
        Family.CLAIM,
        "Flying, 1.5 to 3 m beside a path that it claims to fly (0.05 to 3 m/s)",
        "What it claims; it does average the pad's biases out.",
        "Nothing.",
        "A permission more than one buffer from the claim.",
        "What is averaged out makes the estimate better, and shows the lie sooner.",
        0,
        (Variant(TWO_WAY, make=partial(flown, 2), dear=DEAR),),
        tolerated=0.01,
    ),
    Attack(
        "honest-flown",
        Family.BASELINE,
        "No attack: an honest drone in flight at the same pad",
        "Nothing.",
        "–",
        "Nothing: a permission is right. Counted here are honest drones that are refuted.",
        "–",
        0,
        (Variant(TWO_WAY, make=partial(honest, 2, True), dear=DEAR),),
    ),
)
