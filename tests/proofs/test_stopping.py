from __future__ import annotations

import mpmath
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs import stopping
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.records.policies import Policy
from wonderland_research.reproduction.sampling import EVERY_ROUND, settle

R, ALPHA = 1000.0, 0.01
POLICY = Policy()
SIDES = st.sampled_from([stopping.INSIDE, stopping.OUTSIDE])


def evidence(alternatives, s1, away, step):
    """Σ w·exp(ηD − η²/2 + 0.583 ρ), by mpmath."""
    total = mpmath.mpf(0)
    for distance, weight in alternatives:
        delta = mpmath.mpf(distance) * R
        eta = delta / s1
        total += weight * mpmath.exp(eta * away - eta * eta / 2 + mpmath.mpf("0.583") * min(delta * step, 1.6))
    return total


@given(SIDES, st.floats(10, 20_000), st.floats(0.01, 30), st.floats(0, 0.01))
@settings(deadline=None, max_examples=200)
def test_the_mixture_is_what_it_is_said_to_be(alternatives, s1, away, step):
    weight = stopping.FAR_WEIGHT if s1 > stopping.FAR_BUFFERS * R else stopping.ANYWHERE_WEIGHT
    anywhere = away * away / 2 >= mpmath.log(1 / (mpmath.mpf(ALPHA) * weight))
    excess = evidence(alternatives, s1, away, step) * ALPHA
    if abs(excess - 1) > 1e-9 and abs(away * away / 2 - mpmath.log(1 / (ALPHA * weight))) > 1e-9:
        assert stopping.proved(alternatives, ALPHA, R, s1, away, step) == bool(anywhere or excess >= 1)


@given(SIDES, st.floats(10, 20_000), st.floats(0, 20), st.floats(0, 10), st.floats(0, 0.01), st.floats(1e-6, 0.009))
@settings(deadline=None, max_examples=150)
def test_farther_stays_proved_and_stricter_demands_more(alternatives, s1, away, more, step, stricter):
    if stopping.proved(alternatives, ALPHA, R, s1, away, step):
        assert stopping.proved(alternatives, ALPHA, R, s1, away + more, step)
    else:
        assert not stopping.proved(alternatives, ALPHA, R, s1, away, 0.0)
        assert not stopping.proved(alternatives, stricter, R, s1, away, step)


@given(st.floats(0, 5000), st.floats(1, 1e7), st.floats(0, 1e5))
@settings(deadline=None, max_examples=100)
def test_the_rounds_that_are_foreseen_settle_it(away, white, floor):
    rounds = stopping.rounds_needed(away, white, floor, POLICY)
    if rounds < 0:
        return
    s1 = (white / (rounds + 1) + floor) ** 0.5
    side = stopping.INSIDE if away <= R else stopping.OUTSIDE
    assert stopping.proved(side, ALPHA, R, s1, abs(R - away) / s1, 0.0)


@pytest.mark.parametrize(("rounds", "white", "floor"), [(1, 100.0, 0.0), (10, 0.0, 100.0), (0, 1.0, 1.0)])
def test_where_the_last_round_told_nothing_there_is_no_credit(rounds, white, floor):
    assert stopping.step_of(Matrix2(white + floor, 0, white + floor), Matrix2(white, 0, white), rounds) == 0.0


def test_the_step_is_that_of_the_information():
    """White noise alone: 1/s1² grows by the same with each round; a floor lets it grow ever less."""
    one = 1800.0**2
    steps = [
        stopping.step_of(Matrix2(one / n + floor, 0, 1), Matrix2(one / n, 0, 0), n)
        for floor in (0.0, 200.0**2)
        for n in (5, 50)
    ]
    assert steps[0] == pytest.approx(1 / 1800.0) == steps[1]
    assert steps[0] > steps[2] > steps[3] > 0.0


def test_a_sample_of_drones_on_the_edge_and_off_it():
    """The full sample is ``tests/bench/test_verdict_statistics.py``."""
    edge = settle(R, EVERY_ROUND, 2000, seed=5)
    assert edge.verified.count <= 40
    assert edge.refuted.count <= 40
    lie = settle(3 * R, EVERY_ROUND, 500, seed=5)
    assert (lie.refuted.count, lie.verified.count) == (500, 0)
    assert lie.mean_rounds < 9.0
    assert settle(0.0, EVERY_ROUND, 500, seed=5).refuted.count == 0
