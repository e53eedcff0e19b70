"""What an outsider won with, and whom it convicted: dashes, claims that nobody ranged, old fixes, one wrong fix."""

from __future__ import annotations

import dataclasses
import math
import random

import pytest
from kit.proof_world import START_MS

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.verdict import preview

PAPERS = ((-171, -279), (-171, 279), (171, 279), (171, -279))
FAR = (8_000.0, 0.0, 1_000.0)
HERE = (3_000.0, 6_000.0, 4_000.0)
ACCELERATION = 0.01


def dash(t_ms, middle_ms, peak_mm):
    """Aside and back, from rest to rest, as fast as a drone can."""
    quarter = math.sqrt(peak_mm / ACCELERATION)
    away = abs(t_ms - middle_ms)
    if away < quarter:
        return peak_mm - ACCELERATION * away * away / 2
    return ACCELERATION * (2 * quarter - away) ** 2 / 2 if away < 2 * quarter else 0.0


def judged(world, evidence, asked, now_ms):
    return preview(world.session(world.claim(asked, START_MS)), world.commissioning, evidence, now_ms)


def claimed_at(world, evidence, times, place):
    claims = tuple(world.claim(place(t), START_MS + t) for t in times)
    return dataclasses.replace(evidence, claims=claims)


@pytest.mark.parametrize("peak_mm", [1_300.0, 1_600.0])
def test_a_dash_aside_is_not_the_moment_of_the_place(make_world, now_ms, peak_mm):
    """The claims stand still, the drone does not: 40 of 40 were certified up to 1.8 m off."""
    granted = 0
    for seed in range(10):
        world = make_world(seed=seed, anchors=PAPERS, sigma_mm=20, bias_sigma_mm=2)
        truth = lambda t: (FAR[0], FAR[1] + dash(t, 4_475, peak_mm), FAR[2])  # noqa: E731
        verdict = judged(world, world.evidence(truth, lambda t: FAR, rounds=160), FAR, now_ms)
        if verdict.permission != "granted":
            continue
        granted += 1
        at = truth(verdict.estimate_ms - START_MS)
        assert math.hypot(verdict.estimate.east_mm - at[0], verdict.estimate.north_mm - at[1]) < 1_000
    assert granted, "a drone that is where it claims but for a second may land"


@pytest.mark.parametrize("heard", [0, 2])
def test_claims_that_stand_still_while_nobody_ranges_are_unseen(world, now_ms, heard):
    """Half of the rounds measure nothing; the drone is elsewhere meanwhile, and its claims stay."""
    evidence = world.evidence(lambda t: HERE, lambda t: HERE, rounds=80)
    ranges = evidence.ranges
    anchors = tuple(
        dataclasses.replace(column, range_mm=(*[NO_RANGE] * 38, *column.range_mm[38:])) if index >= heard else column
        for index, column in enumerate(ranges.anchors)
    )
    silent = dataclasses.replace(evidence, ranges=dataclasses.replace(ranges, anchors=anchors))
    assert judged(world, evidence, HERE, now_ms).permission == "granted"
    assert judged(world, silent, HERE, now_ms).permission == "refused"


@pytest.mark.parametrize("speed", [2.0, 3.0, 5.0])
def test_a_drone_in_flight_whose_newest_fix_is_old_is_not_refuted(make_world, now_ms, speed):
    """Fixes once a second; the last rounds come after the last of them."""
    for seed in range(10):
        world = make_world(seed=seed)
        flown = lambda t: (HERE[0] + speed * (t - 2_000), HERE[1], HERE[2])  # noqa: E731
        evidence = claimed_at(world, world.evidence(flown, flown, rounds=60), (0, 1_000, 2_000), flown)
        assert judged(world, evidence, flown(0), now_ms).outcome != "refuted"


def test_one_wrong_fix_in_a_second_convicts_nobody(make_world, now_ms):
    """Of 1,500 such drones, hovering or in flight, 118 were refuted."""
    for seed in range(200):
        rng, world = random.Random(seed), make_world(seed=seed)
        place = (rng.uniform(-9_000, 9_000), rng.uniform(-9_000, 9_000))
        heading, off_mm = rng.uniform(0, math.tau), rng.uniform(2_000, 10_000)
        rounds, wrong_ms, speed = rng.choice([10, 20, 40]), rng.choice([1_000, 2_000]), rng.choice([0.0, 2.0])
        flown = lambda t: (place[0] + speed * (t - 1_000), place[1], 4_000.0)  # noqa: B023, E731

        def told(t):
            east, north, up = flown(t)  # noqa: B023
            off = off_mm if t == wrong_ms else 0.0  # noqa: B023
            return east + off * math.cos(heading), north + off * math.sin(heading), up  # noqa: B023

        evidence = claimed_at(world, world.evidence(flown, flown, rounds=rounds), range(-1_000, 4_000, 1_000), told)
        assert judged(world, evidence, flown(0), now_ms).outcome != "refuted", seed


def test_all_fixes_wrong_are_refuted_at_one_a_second_as_well(world, now_ms):
    told = (HERE[0] + 6_000, HERE[1], HERE[2])
    evidence = claimed_at(
        world, world.evidence(lambda t: HERE, lambda t: told, rounds=60), range(0, 5_000, 1_000), lambda t: told
    )
    assert judged(world, evidence, told, now_ms).outcome == "refuted"
