"""Lies that some anchors cannot tell from the truth: the mirror image in the upright plane through two of them."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland_research.attack_lab.attacks.common import TWO_WAY, policy
from wonderland_research.attack_lab.attacks.moments import WINS
from wonderland_research.attack_lab.batch import Batch, claim_times, measured, off, round_times
from wonderland_research.attack_lab.model import Attack, Family, Variant
from wonderland_research.attack_lab.places import CUBE, MASTS, ROUND_MS, ROUNDS, ROW, SIX, SQUARE, Floats, LabPad

CLAIM_MS: Final = ROUND_MS
"""A claim for each round, so that none lies between truth and lie."""
NEAREST_MM: Final = 1_200.0
FARTHEST_MM: Final = 4_000.0
"""From the mirror: the lie is twice as far off."""
LEAST_BASE_MM: Final = 500.0


def mirrored(pad: LabPad, rng: np.random.Generator, count: int, *, heard: int | None = None) -> Batch:
    """Hovering or circling about; true for some rounds, then at its mirror image for some.

    ``heard``: in lying rounds it leaves anchors out of its frames until so many are heard, of which two fit the lie;
    without it the pad's first two anchors fit it, with all that stand in a row with them.
    """
    rounds, claims_at = round_times().astype(np.float64), claim_times(CLAIM_MS).astype(np.float64)
    truth = np.empty((count, ROUNDS, 3))
    claims = np.empty((count, len(claims_at), 3))
    silent = np.zeros((count, ROUNDS, len(pad.anchors)), dtype=np.bool_)
    for index in range(count):
        place, order, base, normal = _standpoint(pad, rng, silence=heard is not None)
        flown = _Flight(rng, place)
        lies = _Lies(rng)
        truth[index], said = flown(rounds), flown(claims_at)
        over = (said[:, :2] - base) @ normal
        told = lies(claims_at)
        said[:, :2] -= 2.0 * (told * over)[:, None] * normal
        claims[index] = said
        if heard is not None:
            silent[index][:, order[heard:]] = lies(rounds)[:, None]
    range_mm = measured(rng, pad, truth)
    range_mm[silent] = NO_RANGE
    whole = np.rint(claims).astype(np.int64)
    away = off(truth, whole, CLAIM_MS)
    return Batch(pad, whole, range_mm, away, 2, policy(2), claim_ms=CLAIM_MS, truth_mm=truth)


def _standpoint(pad: LabPad, rng: np.random.Generator, *, silence: bool) -> tuple[Floats, list[int], Floats, Floats]:
    """Where it is, the anchors with the two of the mirror first, a point of the mirror and its normal."""
    count = len(pad.anchors)
    while True:
        order = [int(each) for each in rng.permutation(count)] if silence else list(range(count))
        place = pad.places(rng, 1)[0]
        base, along = pad.anchors[order[0], :2], pad.anchors[order[1], :2] - pad.anchors[order[0], :2]
        length = float(np.linalg.norm(along))
        normal = np.array((-along[1], along[0])) / max(length, 1.0)
        if length >= LEAST_BASE_MM and NEAREST_MM < abs(float((place[:2] - base) @ normal)) < FARTHEST_MM:
            return place, order, base, normal


class _Flight:
    """A drone that hovers, or swings about a place by up to a metre."""

    def __init__(self, rng: np.random.Generator, place: Floats) -> None:
        self._place = place
        self._reach = rng.uniform(600.0, 1_200.0) * (rng.random() < 0.5)
        self._period_ms = rng.uniform(1_500.0, 3_000.0)
        self._phases = rng.uniform(0.0, 2.0 * np.pi, 2)

    def __call__(self, times_ms: Floats) -> Floats:
        turns = 2.0 * np.pi * times_ms / self._period_ms
        path = np.repeat(self._place[None, :], len(times_ms), axis=0)
        path[:, 0] += self._reach * np.sin(turns + self._phases[0])
        path[:, 1] += self._reach * np.sin(turns / 1.3 + self._phases[1])
        return path


class _Lies:
    """Which moments are lied about: in turn some rounds of truth and some of lies."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._period = int(rng.integers(4, 25))
        self._lying = max(1, round(self._period * rng.uniform(0.3, 0.6)))
        self._shift = int(rng.integers(self._period))

    def __call__(self, times_ms: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        turn = (np.rint(times_ms / ROUND_MS).astype(np.int64) + self._shift) % self._period
        return np.asarray(turn >= self._period - self._lying)


_STOPS: Final = (
    "A round in which anchors are missing, or contradict the claim, counts only where those that are left know no "
    "second place; of the others each claim has to lie on the flight that the rounds before and after show."
)
ATTACKS: Final = (
    Attack(
        "mirrored-claims",
        Family.CLAIM,
        "Claims its mirror image behind three anchors in a row, a third to a half of the time, else the truth",
        "What it claims at each moment.",
        "Nothing.",
        WINS,
        _STOPS,
        0,
        (Variant(TWO_WAY, make=partial(mirrored, ROW)),),
    ),
    *(
        Attack(
            name,
            Family.INSIDER,
            f"The same behind any two anchors, while all but {left} are left out of its frames; {where}",
            "Which responders the drone names in its frames, and what it claims.",
            "A changed radio driver.",
            WINS,
            _STOPS,
            0,
            (Variant(TWO_WAY, make=partial(mirrored, pad, heard=heard)),),
        )
        for name, pad, heard, left, where in (
            ("mirrored-silence", SQUARE, 3, "three", "four anchors in a square"),
            ("mirrored-silence-of-6", SIX, 3, "three", "six on a circle"),
            ("mirrored-silence-masts", MASTS, 3, "three", "six on masts of two heights"),
            ("mirrored-silence-cube", CUBE, 3, "three", "eight at the corners of a cube"),
            ("mirrored-silence-two", SQUARE, 2, "two", "four anchors in a square"),
        )
    ),
)
