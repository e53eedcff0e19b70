"""Whether a likelihood means what it says: of drones that were told 0.7, 7 in 10 should be within the buffer.

Twice. ``gaussian`` draws estimates with the covariance that the likelihood is then computed with: it holds the
quadrature, and nothing else. ``decided`` draws whole sessions at the paper's points, a bias for each anchor and noise
for each round, and asks the contract's own decision: estimate, ellipse, arc and reduction take part, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from wonderland.proofs.likelihood import Matrix2, inside_disc
from wonderland.proofs.prospects import prospect
from wonderland_research.evaluate import prepare
from wonderland_research.paper_points import POINTS, SIGMA_M
from wonderland_research.reproduction.sampling import BUFFER_MM, POLICY, Share, pad_at, place_of
from wonderland_simulator.recording import RecordedRound

DECILES: Final = 10
BIASES_MM: Final = (20, 20, 5, 5)
"""1σ of each anchor at the paper's four points: what each pad can be commissioned to and still tells something."""
SESSION_ROUNDS: Final = (10, 20, 42, 86)
REACH_SIGMAS: Final = 4.0
"""Claims farther than this from the buffer's edge have likelihoods of 0 or 1; they would fill two deciles."""


@dataclass(frozen=True)
class Decile:
    """Drones whose likelihood was stated within a tenth."""

    stated: float
    observed: Share


@dataclass(frozen=True)
class Decided:
    """Sessions judged by the contract's own decision."""

    deciles: tuple[Decile, ...]
    right: Share
    """Of the verified: truly within the buffer."""

    @property
    def sessions(self) -> int:
        """How many had a likelihood."""
        return sum(one.observed.tries for one in self.deciles)


def gaussian(tries: int, seed: int) -> tuple[Decile, ...]:
    """Drones anywhere about their claims; of those whose likelihood is near p a share p is within the buffer.

    Those whose estimate is farther than 3.5 standard deviations from the buffer's edge are left out: their likelihood
    is 0 or 1, and they would fill two deciles.
    """
    rng = np.random.default_rng(seed)
    s1 = 10 ** rng.uniform(2.0, 2.78, 4 * tries)
    s2 = s1 * rng.uniform(0.05, 1.0, len(s1))
    reach = 3.6 * BUFFER_MM
    x, y = rng.uniform(-reach, reach, len(s1)), rng.uniform(-reach, reach, len(s1))
    east, north = x + rng.normal(0.0, s1), y + rng.normal(0.0, s2)
    chosen = np.flatnonzero(np.abs(np.hypot(east, north) - BUFFER_MM) < 3.5 * s1)[:tries]
    found = []
    for i in chosen.tolist():
        covariance = Matrix2(float(s1[i]) ** 2, 0.0, float(s2[i]) ** 2)
        likelihood = inside_disc(float(east[i]), float(north[i]), covariance, BUFFER_MM)
        found.append((likelihood, math.hypot(x[i], y[i]) <= BUFFER_MM))
    return by_deciles(found)


def decided(tries: int, seed: int) -> Decided:
    """Whole sessions by turns at the paper's points, claims drawn evenly by area about the truth."""
    rng = np.random.default_rng([seed, tries])
    found: list[tuple[float, bool]] = []
    verified: list[bool] = []
    for number in range(tries):
        likelihood, right, outcome = _session(number % len(POINTS), rng)
        if likelihood is not None:
            found.append((likelihood, right))
        if outcome == "verified":
            verified.append(right)
    return Decided(by_deciles(found), Share(sum(verified), len(verified)))


def by_deciles(found: list[tuple[float, bool]]) -> tuple[Decile, ...]:
    """Likelihoods and whether the drone was within the buffer, by tenths of the likelihood."""
    stated, counts, right = [0.0] * DECILES, [0] * DECILES, [0] * DECILES
    for likelihood, inside in found:
        decile = min(int(likelihood * DECILES), DECILES - 1)
        stated[decile] += likelihood
        counts[decile] += 1
        right[decile] += inside
    return tuple(
        Decile(total / max(count, 1), Share(hits, count))
        for total, count, hits in zip(stated, counts, right, strict=True)
    )


def _session(index: int, rng: np.random.Generator) -> tuple[float | None, bool, str]:
    """(likelihood, whether the claim is right, outcome) of one session."""
    point, bias_mm = POINTS[index], BIASES_MM[index]
    commissioning = pad_at(point, bias_sigma_mm=bias_mm)
    rounds = int(rng.choice(SESSION_ROUNDS))
    expected = prospect(commissioning, POLICY, *place_of(point), 0.0)
    if expected is None:
        raise ValueError(f"{point.name} has no estimate")
    shrinking = expected.one_round + expected.floor.scaled(-1.0)
    s1 = (expected.floor + shrinking.scaled(1.0 / rounds)).ellipse().s1
    while True:
        reach = BUFFER_MM + REACH_SIGMAS * s1
        east, north = rng.uniform(-reach, reach, 2).tolist()
        away = math.hypot(east, north)
        if abs(away - BUFFER_MM) < REACH_SIGMAS * s1:
            break
    truth = (point.position[0], point.position[1], 0.0)
    bias_m = rng.normal(0.0, bias_mm / 1000, len(point.anchors))
    ranges = np.hypot(*(np.array(point.anchors) - truth[:2]).T) + bias_m
    drawn = ranges + rng.normal(0.0, SIGMA_M, (rounds, len(ranges)))
    recorded = tuple(
        RecordedRound(0.05 * n, {f"A{i}": float(value) for i, value in enumerate(row)}, truth)
        for n, row in enumerate(drawn)
    )
    verdict = prepare(
        recorded, commissioning, POLICY, lambda _, place: (place[0] + east / 1000, place[1] + north / 1000, place[2])
    ).verdict()
    likelihood = None if verdict.signed is None else verdict.signed.likelihood_ppm / 1_000_000
    return likelihood, away <= BUFFER_MM, verdict.outcome
