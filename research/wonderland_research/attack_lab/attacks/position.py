"""Attacks on a drone's own position: it believes what it claims."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland_research.attack_lab.attacks.common import (
    BUFFER_MM,
    DEAR,
    TIMED_LEVEL,
    TWO_WAY,
    at_levels,
    lying,
    pad_at,
    policy,
    still,
)
from wonderland_research.attack_lab.batch import Batch, measured, moving, off, round_times, standing
from wonderland_research.attack_lab.blinks import heard
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import SQUARE, directions

DRAG_STARTS_MS: Final = (-1_000.0, 1_000.0)
"""When a drag begins, from the request; ranging begins half a second after it."""
GOAL_BUFFERS: Final = 2.0


def offset(level: int, rng: np.random.Generator, count: int) -> Batch:
    """3 to 9 m, any direction."""
    pad = pad_at(level)
    claim, truth = lying(rng, count, pad=pad)
    return still(rng, level, claim, truth, pad=pad)


def edge(level: int, rng: np.random.Generator, count: int) -> Batch:
    """Just outside of the buffer, by 0 to 30 %."""
    claim, truth = lying(rng, count, near=BUFFER_MM * 1.0005, far=1.3 * BUFFER_MM)
    return still(rng, level, claim, truth)


def meaconing(level: int, rng: np.random.Generator, count: int) -> Batch:
    """The same shift for every drone about, and they fly on while they are ranged."""
    place = SQUARE.places(rng, count)
    velocity = directions(rng, count) * rng.uniform(1.0, 5.0, count)[:, None]  # mm/ms = m/s
    claims = moving(place, velocity)
    shift = directions(rng, count) * rng.uniform(3.0, 30.0, count)[:, None] * 1000.0
    times = round_times()[None, :, None]
    truth = place[:, None, :] + velocity[:, None, :] * times + shift[:, None, :]
    return Batch(SQUARE, claims, measured(rng, SQUARE, truth), off(truth, claims), level, policy(level))


def drag(level: int, slowest: float, fastest: float, rng: np.random.Generator, count: int) -> Batch:
    """The receiver is led away while the drone holds what it reads, so that it flies the other way."""
    pad = pad_at(level)
    place = pad.places(rng, count)
    claims = standing(place)
    speed = rng.uniform(slowest, fastest, count)
    start = rng.uniform(*DRAG_STARTS_MS, count)
    led = np.maximum(round_times()[None, :] - start[:, None], 0.0) * speed[:, None]
    truth = np.rint(place)[:, None, :] - directions(rng, count)[:, None, :] * led[:, :, None]
    batch = Batch(
        pad,
        claims,
        measured(rng, pad, truth),
        off(truth, claims),
        level,
        policy(level),
        heard_mm=heard(rng, pad, truth) if level >= TIMED_LEVEL else None,
    )
    batch.won_mm = GOAL_BUFFERS * BUFFER_MM
    return batch


ATTACKS: Final = (
    Attack(
        "gnss-offset",
        Family.GNSS,
        "Fixed GNSS offset of 3 to 9 m",
        "The drone's GNSS receiver, by radio; the drone itself is honest.",
        "A software-defined radio near the drone, some hundred euros.",
        "A permission more than one buffer from the claim.",
        "The ranges: they do not depend on GNSS. Level 0 too, as an honest drone reports its ranges truthfully.",
        0,
        at_levels(offset, *TWO_WAY),
        wire="gnss-offset",
    ),
    Attack(
        "gnss-drag",
        Family.GNSS,
        "Slow drag at 1 m/s",
        "The drone's GNSS receiver, led away so slowly that no filter of an autopilot complains.",
        "As before, and a spoofer that aligns itself with the real signals.",
        "A permission two buffers or more from the claim.",
        "The ranges, of which the newest are judged alone, too: refuted before the error is two buffers, but for "
        "fewer than 1 in 10,000 (seen: 1 in 72,298 at 2.01 m, 1 in 60,086 at 2.18 m). Those drags began a second "
        "before the request, so that the drone was 1.5 m off when ranging began: ten rounds later, at the pad's first"
        " look, it is two buffers off, and Wald's bound leaves no room for less. A permission that came before the "
        "drag, or in its first buffer (2 in 1,000 of them a decimetre beyond), is not taken back; it expires with the"
        " session.",
        0,
        (Variant(TWO_WAY, make=partial(drag, 2, 1.0, 1.0)), Variant((3,), make=partial(drag, 3, 1.0, 1.0), dear=DEAR)),
        wire="gnss-drag",
    ),
    Attack(
        "gnss-drag-slow",
        Family.GNSS,
        "Slower drags, 0.05 to 0.8 m/s",
        "As before.",
        "As before.",
        "A permission two buffers or more from the claim.",
        "As before: slow does not help against a sensor that the spoofer does not reach.",
        0,
        (Variant(TWO_WAY, make=partial(drag, 2, 0.05, 0.8)),),
        wire="gnss-drag-slow",
    ),
    Attack(
        "gnss-meaconing",
        Family.GNSS,
        "Meaconing: all drones about are shifted together, 3 to 30 m, in flight",
        "GNSS for a whole area: recorded and sent again.",
        "A stronger transmitter; every receiver about agrees with every other.",
        "A permission more than one buffer from the claim.",
        "The ranges: agreement among drones is no part of the verdict.",
        0,
        (Variant(TWO_WAY, make=partial(meaconing, 2)),),
        wire="gnss-meaconing",
    ),
    Attack(
        "edge-retries",
        Family.GNSS,
        "Hovering 1.0 to 1.3 buffers from the claim and asking again and again",
        "Where the drone is, and how often it asks.",
        "Patience.",
        "A permission more than one buffer from the claim.",
        "The sequential test: at the edge itself one session in a hundred may be wrong, fewer beyond. Each try is a "
        "session, so that twenty tries may win twenty times as often: at most some decimetres.",
        0,
        (Variant(TWO_WAY, make=partial(edge, 2)),),
        tolerated=0.01,
    ),
)
