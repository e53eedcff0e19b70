"""What a drone's calibration does to a verdict, and what no false one can."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from kit.proof_world import START_MS, World

from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.verdict import decide

BETWEEN = (300.0, 500.0, 1_800.0)
FIVE = ((1500, 1500), (-1500, 1500), (-1500, -1500), (1500, -1500), (0, 2200))
DELAY_MM = 300


def judged(world, truth, claimed, offset_mm, *, delay_mm=DELAY_MM, bias_mm=(0,) * 6, rounds=60, sigma_mm=20, **more):
    """The verdict on one evidence, not calibrated and calibrated to ``offset_mm``."""
    session = world.session(world.claim(claimed, START_MS))
    biases = tuple(delay_mm + each for each in bias_mm)
    evidence = world.evidence(lambda _: truth, lambda _: claimed, rounds=rounds, bias_mm=biases, **more)
    drone = DroneOffset(offset_mm=offset_mm, sigma_mm=sigma_mm, measured_ms=0)
    return [
        decide(
            replace(session, calibration=calibration),
            world.commissioning,
            evidence,
            confirmed=True,
            signature_valid=True,
            authorisation=(),
            now_ms=START_MS + 20_000,
            evidence_sha256="0" * 64,
        )
        for calibration in (None, drone)
    ]


def codes(verdict):
    return {reason.code for reason in verdict.reasons}


def test_between_the_anchors_it_explains_what_no_place_does():
    plain, calibrated = judged(World(seed=1), BETWEEN, BETWEEN, DELAY_MM)
    assert (plain.outcome, "ranges_inconsistent" in codes(plain)) == ("inconclusive", True)
    assert (calibrated.outcome, calibrated.permission) == ("verified", "granted")
    assert "ranges_inconsistent" not in codes(calibrated)
    (said,) = [each for each in calibrated.reasons if each.code == "calibrated"]
    assert dict(said.facts) == {"offset_mm": DELAY_MM, "sigma_mm": 20}


def test_a_lie_is_refuted_as_before():
    claimed = (BETWEEN[0] + 3_000.0, BETWEEN[1], BETWEEN[2])
    _, calibrated = judged(World(seed=2), BETWEEN, claimed, DELAY_MM)
    assert calibrated.outcome == "refuted"


def test_one_bad_anchor_of_five_is_found_beside_it():
    world = World(seed=3, anchors=FIVE)
    _, calibrated = judged(world, BETWEEN, BETWEEN, DELAY_MM, bias_mm=(0, 0, 700, 0, 0))
    assert calibrated.outcome == "verified"
    assert "anchor_suspected" in codes(calibrated)


def test_a_bound_is_no_smaller_for_it():
    far = (9_000.0, 9_000.0, 4_000.0)
    plain, calibrated = judged(World(seed=4), far, far, 500, delay_mm=0)
    assert calibrated.within_mm >= plain.within_mm
    plain, calibrated = judged(World(seed=4), far, far, -500, delay_mm=0)
    assert calibrated.within_mm >= plain.within_mm


def test_a_height_is_proved_by_the_ranges_that_bear_the_offset_out_alone():
    """Between the anchors corrected ranges agree, and those as measured do not; farther out both do, or are vague."""
    _, calibrated = judged(World(seed=1), BETWEEN, BETWEEN, DELAY_MM)
    assert "height_proved" in codes(calibrated)
    far = (3_000.0, 6_000.0, 4_000.0)
    plain, false = judged(World(seed=7), far, far, 500, delay_mm=0)
    assert (plain.outcome, plain.height.outcome) == ("verified", "proved")
    assert false.height is None or false.height.outcome != "contradicted"
    lie = (far[0], far[1], far[2] + 1_150.0)
    for offset_mm in (-500, 500):
        plain, false = judged(World(seed=7), far, lie, offset_mm, delay_mm=0, rounds=160)
        assert plain.height.outcome != "proved"
        assert false.height is None or false.height.outcome != "proved"
        assert "height_proved" not in codes(false)


def test_a_false_offset_that_makes_a_false_height_agree_proves_none():
    """The attack lab found it: with the claimed height false the ranges contradict one another on the map, and a false
    offset heals that; in space they fit the true height as they were measured."""
    truth = (2_500.0, -4_000.0, 5_000.0)
    for rise in (-1_100.0, 1_100.0):
        for offset_mm in (-500, 500):
            claimed = (truth[0], truth[1], truth[2] + rise)
            _, false = judged(World(seed=8), truth, claimed, offset_mm, delay_mm=0, rounds=160)
            assert "height_proved" not in codes(false)
            assert false.height is None or false.height.outcome != "proved"


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10**6),
    east=st.floats(-10_000, 10_000),
    north=st.floats(-10_000, 10_000),
    lie=st.tuples(st.floats(-2_500, 2_500), st.floats(-2_500, 2_500)),
    offset_mm=st.integers(-500, 500),
    sigma_mm=st.integers(20, 200),
)
def test_no_offset_verifies_or_refutes_what_the_ranges_do_not(seed, east, north, lie, offset_mm, sigma_mm):
    """Of a drone without a delay, whose ranges agree: a calibration only ever leaves open what was settled."""
    truth = (east, north, 4_000.0)
    claimed = (east + lie[0], north + lie[1], 4_000.0)
    plain, calibrated = judged(World(seed=seed), truth, claimed, offset_mm, delay_mm=0, rounds=30, sigma_mm=sigma_mm)
    if "ranges_inconsistent" not in codes(plain):
        assert calibrated.outcome in {plain.outcome, "inconclusive"}


@pytest.mark.parametrize("offset_mm", [-500, 500])
def test_nor_does_it_convict(offset_mm):
    far = (14_000.0, 3_000.0, 2_000.0)
    _, calibrated = judged(World(seed=6), far, far, offset_mm, delay_mm=0, rounds=160)
    assert calibrated.outcome != "refuted"
