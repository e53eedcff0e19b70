"""The drone's clock against the pad's: what echoes tell, and that a false time buys nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.proof_world import START_MS, World

from wonderland.proofs.drone_clock import HONEST_MS, UNKNOWN, drone_clock
from wonderland.proofs.records.sessions import ClockReading
from wonderland.proofs.verdict import preview

NOW_MS = START_MS + 20_000


def reading(offset_ms, asked_ms=1_000, there_ms=20, back_ms=30, answered=True):
    """The drone read its clock ``there_ms`` after it was asked; the answer took ``back_ms``."""
    return ClockReading(
        uav_ms=asked_ms + there_ms + offset_ms,
        heard_ms=asked_ms + there_ms + back_ms,
        asked_ms=asked_ms if answered else None,
    )


def test_without_readings_the_clock_is_taken_for_an_honest_one():
    assert drone_clock(()) == UNKNOWN
    assert UNKNOWN.sigma_ms == 50


@given(
    offset=st.integers(-900, 900),
    trips=st.lists(st.tuples(st.integers(0, 300), st.integers(0, 300)), min_size=1, max_size=8),
)
def test_the_true_offset_lies_within_what_the_readings_allow(offset, trips):
    readings = [
        reading(offset, asked_ms=1_000 + 500 * index, there_ms=there, back_ms=back)
        for index, (there, back) in enumerate(trips)
    ]
    clock = drone_clock(readings)
    assert not clock.contradictory
    assert clock.beyond_ms <= abs(offset)
    assert abs(clock.offset_ms - offset) <= 3.5 * clock.sigma_ms + max(0, abs(offset) - HONEST_MS)
    if abs(offset) <= HONEST_MS:
        assert abs(clock.offset_ms - offset) <= 1.75 * clock.sigma_ms  # half the width of a uniform distribution
        assert clock.beyond_ms == 0


def test_quick_echoes_tell_more_than_the_constant_did():
    assert drone_clock([reading(5, there_ms=15, back_ms=15)]).sigma_ms < 15
    assert drone_clock([reading(5, there_ms=15, back_ms=15)]).offset_ms == pytest.approx(5, abs=15)


def test_one_that_is_ahead_by_its_claims_alone():
    """A claim is no answer: it bounds the offset from one side only."""
    clock = drone_clock([reading(2_000, answered=False)])
    assert clock.beyond_ms == clock.offset_ms == 1_970
    assert drone_clock([reading(-2_000, answered=False)]).beyond_ms == 0


def test_times_that_no_clock_has():
    assert drone_clock([reading(0), reading(900, asked_ms=2_000)]).contradictory


# --- in the verdict --------------------------------------------------------------------------------------------------


def judged(truth, claimed, readings, clock_ms=0, **policy):
    """The drone's clock is ``clock_ms`` ahead, and so are its claims."""
    world = World(seed=1)
    session = world.session(world.claim(claimed(0), START_MS), **policy)
    evidence = world.evidence(truth, claimed, rounds=40)
    claims = tuple(replace(claim, t_ms=claim.t_ms + clock_ms) for claim in evidence.claims)
    return preview(session, world.commissioning, replace(evidence, claims=claims, clock=readings), NOW_MS)


def flying(t):
    return (3000 + 5 * t, 6000, 4000)


def hovering(_t):
    return (3000, 6000, 4000)


def echoes(offset_ms):
    return tuple(reading(offset_ms, asked_ms=START_MS + 700 + 400 * i) for i in range(4))


def codes(verdict):
    return {reason.code for reason in verdict.reasons}


def test_echoes_make_the_ellipse_of_a_flying_drone_smaller():
    without, with_echoes = judged(flying, flying, ()), judged(flying, flying, echoes(0))
    assert with_echoes.covariance.ee_mm2 < 0.3 * without.covariance.ee_mm2
    assert (with_echoes.outcome, with_echoes.clock.readings) == ("verified", 4)
    assert abs(with_echoes.clock.offset_ms) <= 25


def test_claims_are_judged_where_the_drone_was_when_it_said_them():
    """80 ms late at 5 m/s is 0.4 m: an honest clock's error, and known."""
    verdict = judged(flying, flying, echoes(-80), clock_ms=-80)
    assert verdict.outcome == "verified"
    assert verdict.clock.offset_ms == pytest.approx(-80, abs=20)
    assert verdict.signed.error_mm < 200


@pytest.mark.parametrize("offset_ms", [-1_500, 1_500])
def test_a_clock_that_is_far_off_verifies_no_drone_that_flies(offset_ms):
    flies = judged(flying, flying, echoes(offset_ms), clock_ms=offset_ms)
    assert flies.outcome != "verified"
    assert "clock_off" in codes(flies)
    hovers = judged(hovering, hovering, echoes(offset_ms), clock_ms=offset_ms)
    assert hovers.outcome == "verified"
    assert hovers.clock.offset_ms == pytest.approx(offset_ms, abs=30)


@pytest.mark.parametrize("lie_ms", [-4_000, -1_000, -400, 400, 1_000, 4_000])
def test_lying_about_the_clock_moves_no_claim_out_of_the_way(lie_ms):
    """It is 3 m ahead of its claim, and says that its clock is off by as much: the shift must not excuse it."""
    behind = lambda t: flying(t - 600)  # noqa: E731
    verdict = judged(flying, behind, echoes(lie_ms))
    assert verdict.outcome != "verified"


def test_contradictory_times_verify_nothing():
    verdict = judged(hovering, hovering, (reading(0, asked_ms=START_MS + 700), reading(900, asked_ms=START_MS + 1_100)))
    assert verdict.outcome != "verified"
    assert "clock_contradicts" in codes(verdict)
