"""The stated share of honest drones against the contract's own decision."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from kit.proof_world import START_MS, World

from wonderland.proofs.honest import looks_of, narrower, rounds_for, share_by, share_verified
from wonderland.proofs.likelihood import Matrix2, inside_disc
from wonderland.proofs.prospects import prospect
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import Evidence
from wonderland.proofs.reduction import HEIGHT_SIGMA_FLOOR_MM
from wonderland.proofs.stopping import sides
from wonderland.proofs.verdict import preview

DRONES = 200
PAD = {"sigma_mm": 120, "bias_sigma_mm": 60}
NEAR, EDGE, BEYOND = (3000.0, 4000.0, 4000.0), (5000.0, 6600.0, 4000.0), (7000.0, 9240.0, 4000.0)


def first_look_that_verifies(seed: int, place, policy: Policy) -> int:
    """Rounds by which one honest drone is verified, its errors drawn from the commissioning; 0 if never."""
    world = World(seed=seed, **PAD)
    common = world.rng.gauss(0, world.commissioning.installation_sigma_mm)
    bias = [
        common + world.rng.gauss(0, math.hypot(anchor.bias[0].sigma_mm, anchor.survey_sigma_mm))
        for anchor in world.commissioning.anchors
    ]
    real = (*place[:2], place[2] + world.rng.gauss(0, HEIGHT_SIGMA_FLOOR_MM))
    looks = looks_of(policy)
    whole = world.evidence(lambda _: real, lambda _: place, rounds=looks[-1], bias_mm=bias)
    session = replace(world.session(world.claim(place, START_MS)), policy=policy)
    for look in looks:
        verdict = preview(session, world.commissioning, _first(whole, look), START_MS + 20_000)
        if verdict.outcome != "inconclusive" or verdict.more_rounds < 0:
            return look if verdict.outcome == "verified" else 0
    return 0


def _first(evidence: Evidence, rounds: int) -> Evidence:
    ranges = evidence.ranges
    anchors = tuple(replace(anchor, range_mm=anchor.range_mm[:rounds]) for anchor in ranges.anchors)
    last = ranges.t_ms[rounds - 1] + 200
    claims = tuple(claim for claim in evidence.claims if claim.t_ms <= last)
    return replace(evidence, ranges=replace(ranges, t_ms=ranges.t_ms[:rounds], anchors=anchors), claims=claims)


@pytest.mark.parametrize("place", [NEAR, EDGE, BEYOND])
def test_as_many_are_verified_as_is_stated(place):
    policy = Policy()
    expected = prospect(World(**PAD).commissioning, policy, *place, height_sigma_mm=200.0)
    assert 0 < expected.rounds < 160
    found = [first_look_that_verifies(seed, place, policy) for seed in range(DRONES)]
    for look in (20, 60, 160):
        stated = share_by(expected, policy, look)
        seen = sum(0 < rounds <= look for rounds in found) / DRONES
        assert seen == pytest.approx(stated, abs=0.1), look
    rounds = rounds_for(expected, policy)
    if rounds > 0:
        assert sum(0 < seen <= rounds for seen in found) >= 0.82 * DRONES  # 0.9, three standard deviations down
    else:
        assert sum(seen > 0 for seen in found) < 0.9 * DRONES


def test_go_means_more_than_that_an_exact_claim_is_verified():
    policy = Policy()
    commissioning = World(**PAD).commissioning
    assert 0 < prospect(commissioning, policy, *BEYOND).rounds <= policy.max_rounds
    assert rounds_for(prospect(commissioning, policy, *BEYOND), policy) == -1
    assert rounds_for(prospect(commissioning, policy, *NEAR), policy) > 0


def test_the_policys_rounds_are_all_there_are():
    assert looks_of(Policy(min_rounds=20, max_rounds=55)) == (20, 24, 29, 35, 42, 50, 55)
    assert looks_of(Policy(max_rounds=500))[-1] == 160
    world = World(**PAD)
    found = prospect(world.commissioning, Policy(), *EDGE)
    assert share_by(found, Policy(), 160) > share_by(found, Policy(), 20)


def test_a_narrower_buffer_stands_for_the_share():
    policy = Policy()
    scale = narrower(policy)
    assert 0.5 < scale < 0.7
    assert narrower(policy, 500_000) > scale
    s1 = 200.0
    assert share_verified(Matrix2(s1 * s1, 0.0, 1.0), policy) > 0.9
    assert share_verified(Matrix2(s1 * s1, 0.0, s1 * s1), policy) < share_verified(Matrix2(s1 * s1, 0.0, 1.0), policy)
    assert share_verified(Matrix2(340.0**2, 0.0, 1.0), policy) == 0.0


@pytest.mark.parametrize("s1", [60.0, 150.0, 250.0, 320.0])
@pytest.mark.parametrize("ratio", [0.001, 0.3, 1.0])
@pytest.mark.parametrize("step", [0.0, 1e-4])
def test_the_share_is_the_mass_of_what_the_contract_would_verify(s1, ratio, step):
    """The depth of an estimate on the major axis, by the search that the contract makes."""
    policy, c, s = Policy(), math.cos(0.7), math.sin(0.7)
    large, small = s1 * s1, s1 * s1 * ratio * ratio
    covariance = Matrix2(c * c * large + s * s * small, c * s * (large - small), s * s * large + c * c * small)
    low, high = 0.0, float(policy.buffer_mm)
    for _ in range(12):
        middle = 0.5 * (low + high)
        inside = sides(middle * c, middle * s, covariance, policy, step).inside
        low, high = (middle, high) if inside else (low, middle)
    assert low > 0.0
    assert share_verified(covariance, policy, step) == pytest.approx(inside_disc(0, 0, covariance, low), abs=1e-9)
