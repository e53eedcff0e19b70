"""Attacks from outside on the ranging itself: the attacker has no key of the session.

The drone is honest, but its GNSS is spoofed to the claimed place; the attacker tries to make the ranges agree.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import (
    NEAR_LIE,
    PAD_MEASURES,
    TIMED_LEVEL,
    at_levels,
    lying,
    pad_at,
    radially,
    ranges_of_claim,
    still,
)
from wonderland_research.attack_lab.batch import Batch
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import ROUNDS, SQUARE, WIDE, Floats, directions, distances

SUCCESS: Final = 0.04
"""Share of ranges that a blind reduction shortens (arXiv 2111.05313: at most 4 %)."""
DEEPEST_MM: Final = 12_000.0
_LONGEST_DELAY_MM: Final = 40_000.0
_HALVINGS: Final = 20
_ITERATIONS: Final = 12


def random_reduction(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Each range is shortened with a chance of 4 %, by anything up to 12 m."""
    claim, truth = lying(rng, count)
    shape = (count, ROUNDS, len(SQUARE.anchors))
    hit = rng.random(shape) < SUCCESS
    return still(rng, level, claim, truth, extra=np.where(hit, -rng.uniform(0.0, DEEPEST_MM, shape), 0.0))


def known_sequence(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The time-stamp sequence is public: frames are sent early, to each anchor by as much as it takes."""
    truth, claim = radially(rng, count)  # the claim is the nearer place
    claim = np.rint(claim)
    return still(rng, level, claim, truth, extra=ranges_of_claim(SQUARE, claim, truth))


def blind_sequence(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The same where the sequence is keyed: what comes early has the wrong one and counts in 4 % of the cases only."""
    truth, claim = radially(rng, count)
    claim = np.rint(claim)
    wanted = ranges_of_claim(SQUARE, claim, truth)
    hit = rng.random((count, ROUNDS, len(SQUARE.anchors))) < SUCCESS
    return still(rng, level, claim, truth, extra=np.where(hit, wanted, 0.0))


def relayed(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The honest drone is 20 to 300 m away; a box at the claimed place passes frames on, 10 to 100 ns late."""
    claim = np.rint(SQUARE.places(rng, count))
    truth = claim + directions(rng, count) * rng.uniform(20_000.0, 300_000.0, count)[:, None]
    path = np.linalg.norm(truth - claim, axis=1) + rng.uniform(3_000.0, 30_000.0, count)
    extra = distances(claim, SQUARE.anchors) + path[:, None] - distances(truth, SQUARE.anchors)
    return still(rng, level, claim, truth, extra=extra[:, None, :])


def delay(level: int, rng: np.random.Generator, count: int) -> Batch:
    """All ranges grow by the same; the claim is farther out on the same bearing."""
    pad = pad_at(level)
    claim, truth = radially(rng, count, pad=pad)
    return still(rng, level, claim, truth, pad=pad, extra=_common(ranges_of_claim(pad, claim, truth)))


def delay_and_height(level: int, rng: np.random.Generator, count: int) -> Batch:
    """One delay of all answers, and that place *and height* claimed which fit the ranges then best.

    Four anchors are what it fits best: level 3 has to hold at the square pad, too.
    """
    pad = SQUARE if level == TIMED_LEVEL else pad_at(level)
    truth = pad.places(rng, count)
    wanted = rng.uniform(NEAR_LIE, 4_000.0, count)
    shortest, longest = np.zeros(count), np.full(count, _LONGEST_DELAY_MM)
    for _ in range(_HALVINGS):
        tried = 0.5 * (shortest + longest)
        near = np.linalg.norm((_fitting(pad.anchors, truth, tried) - truth)[:, :2], axis=1) < wanted
        shortest, longest = np.where(near, tried, shortest), np.where(near, longest, tried)
    claim = np.rint(_fitting(pad.anchors, truth, longest))
    return still(rng, level, claim, truth, pad=pad, extra=np.rint(longest)[:, None, None])


def _fitting(anchors: Floats, truth: Floats, delay: Floats) -> Floats:
    """The places (count, 3) that fit ranges from ``truth`` plus a delay (mm) best: Levenberg–Marquardt, all at once."""
    ranges = distances(truth, anchors) + delay[:, None]
    place = truth * (1.0 + delay / np.linalg.norm(truth, axis=1))[:, None]
    for _ in range(_ITERATIONS):
        arms = place[:, None, :] - anchors[None, :, :]
        lengths = np.linalg.norm(arms, axis=2)
        lines = arms / lengths[:, :, None]
        normal = lines.transpose(0, 2, 1) @ lines + 1e-6 * np.eye(3)
        place = (
            place + np.linalg.solve(normal, (lines * (ranges - lengths)[:, :, None]).sum(axis=1)[:, :, None])[:, :, 0]
        )
    return np.asarray(place, dtype=np.float64)


def delay_within(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The same where drone and claim stand between the anchors."""
    claim, truth = lying(rng, count, pad=WIDE, far=6_000.0)
    extra = np.maximum(_common(ranges_of_claim(WIDE, claim, truth)), 0.0)
    return still(rng, level, claim, truth, pad=WIDE, extra=extra + rng.uniform(0.0, 3_000.0, (count, 1, 1)))


def overshadowed(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Each anchor hears the drone's frame late by as much as it takes; the claim is farther from all of them."""
    pad = pad_at(level)
    claim, truth = radially(rng, count, pad=pad)
    late = np.maximum(ranges_of_claim(pad, claim, truth), 0.0)
    return still(rng, level, claim, truth, pad=pad, extra=late, frames=late)


def _common(extra: Floats) -> Floats:
    return np.asarray(extra.mean(axis=2, keepdims=True), dtype=np.float64)


ATTACKS: Final = (
    Attack(
        "random-reduction",
        Family.RADIO,
        "Random reduction: 4 % of the ranges shortened by 0 to 12 m",
        "A transmitter near the anchors, blind to the keyed sequence (Ghost Peak, Cicada).",
        "A software-defined radio or a changed UWB chip near the pad.",
        "A permission more than one buffer from the claim.",
        "Many rounds: a few short ranges are bursts and left out; no position rests on a single one.",
        0,
        (Variant((1, 2), make=partial(random_reduction, 2)),),
        wire="random-reduction",
    ),
    Attack(
        "early-commit",
        Family.RADIO,
        "Frames sent early to each anchor (early detect, late commit)",
        "A transmitter near each anchor, and the time-stamp sequence where it is public.",
        "Some changed UWB chips, synchronised.",
        "A permission more than one buffer from the claim.",
        "A sequence keyed for this session (level 2): the attacker cannot send what it cannot know.",
        2,
        (Variant((1,), make=partial(known_sequence, 1)), Variant((2,), make=partial(blind_sequence, 2))),
    ),
    Attack(
        "relay",
        Family.RADIO,
        "Relay: the honest drone is 20 to 300 m away, a box at the claimed place passes frames on",
        "Two radios and a fast link between them.",
        "Some hundred euros.",
        "A permission more than one buffer from the claim.",
        "Time of flight: the way round is always longer, for all anchors alike.",
        0,
        (Variant((1, 2), make=partial(relayed, 2)),),
        wire="relay",
    ),
    Attack(
        "delay-line",
        Family.RADIO,
        "Enlargement, all ranges alike: the drone is 3 to 9 m nearer than it claims, outside of the anchors' hull",
        "The drone's antenna path: a cable or a delay of its answers. No key, no time stamp.",
        "A few metres of cable.",
        "A permission more than one buffer from the claim.",
        "Level 3: what delays all anchors alike cancels in the differences. At level 2 the verdict says `upper_bound`.",
        3,
        at_levels(delay, *PAD_MEASURES),
        wire="delay-line",
    ),
    Attack(
        "delay-line-height",
        Family.RADIO,
        "The same with a false height that makes the ranges fit, lies of 3 to 4 m",
        "The drone's antenna path, and the height in its claims.",
        "A few metres of cable and a word.",
        "A permission more than one buffer from the claim.",
        "Level 3, at four anchors (played there) as at six: differences have to prove the place whatever the height.",
        3,
        at_levels(delay_and_height, *PAD_MEASURES),
    ),
    Attack(
        "delay-line-inside",
        Family.RADIO,
        "The same with a claim between the anchors",
        "As before; the anchors surround the drone.",
        "As before.",
        "A permission more than one buffer from the claim.",
        "While the height is true, geometry: to be farther from one anchor is to be nearer to another.",
        0,
        (Variant((1, 2), make=partial(delay_within, 2)),),
    ),
    Attack(
        "overshadowing",
        Family.RADIO,
        "Enlargement of each range as wanted: the drone's frame is drowned and sent again late",
        "A strong transmitter for each anchor that also cancels the first path.",
        "Laboratory equipment, synchronised to a nanosecond, beside every anchor.",
        "A permission more than one buffer from the claim.",
        "Level 4: the second pad hears the drone's own frames. At one pad nothing: a range is an upper bound.",
        4,
        at_levels(overshadowed, *PAD_MEASURES),
    ),
)
