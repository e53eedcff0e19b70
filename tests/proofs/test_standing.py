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


def off_and_share(verdict, truth, claims):
    """How far the certified place is from the drone at its moment, in mm, and the share of claims two buffers off."""
    at = truth(verdict.estimate_ms - START_MS)
    off = math.hypot(verdict.estimate.east_mm - at[0], verdict.estimate.north_mm - at[1])
    far = sum(math.dist(place[:2], truth(t)[:2]) >= 2_000 for t, place in claims)
    return off, far / len(claims)


def along(place, bearing, off_mm):
    return place[0] + off_mm * math.cos(bearing), place[1] + off_mm * math.sin(bearing), place[2]


def at_moments(world, rounds_ms, truth, claims, *, attempted):
    """What the drone signed at these moments, and rounds at those only."""
    evidence = world.evidence(lambda t: truth(rounds_ms[(t - 500) // 50]), lambda t: HERE, rounds=len(rounds_ms))
    ranges = dataclasses.replace(evidence.ranges, t_ms=tuple(START_MS + t for t in rounds_ms))
    return dataclasses.replace(
        evidence,
        ranges=ranges,
        claims=tuple(world.claim(place, START_MS + t) for t, place in claims),
        radio=dataclasses.replace(evidence.radio, attempted_rounds=attempted),
    )


@pytest.mark.parametrize("leaps", ["in runs", "in turn"])
def test_leaps_that_balance_within_one_stretch_certify_no_false_place(make_world, now_ms, leaps):
    """The claims lean to one side before a stretch and to the other after it, and leap to and fro within it."""
    rounds = 160
    for seed in range(25):
        rng, world = random.Random(seed), make_world(seed=seed, anchors=PAPERS, sigma_mm=20, bias_sigma_mm=4)
        bearing = rng.uniform(0, math.tau)
        place = along((0.0, 0.0, 1_500.0), bearing, rng.uniform(4_000, 10_000))
        half = rounds // 12
        farther = half // 2 + 1
        near_mm, lean_mm = rng.uniform(1_060, 1_300), rng.uniform(150, 450)
        far_mm = near_mm * farther / (half - farther)
        pattern = [near_mm] * farther + [-far_mm] * (half - farther)
        if leaps == "in turn":
            pattern = [near_mm if index % 2 == 0 else -far_mm for index in range(half)]
        begin = (rounds - 2 * half) // 2

        def lie(index, begin=begin, half=half, pattern=pattern, lean_mm=lean_mm):
            if begin <= index < begin + 2 * half:
                return pattern[(index - begin) % half]
            return lean_mm if index < begin else -lean_mm

        times = [500 + 50 * index for index in range(rounds)]
        across = bearing + math.pi / 2
        claims = [(t, along(place, across, lie(index))) for index, t in enumerate(times)]
        claims = [(400, claims[0][1]), *claims, (times[-1] + 100, claims[-1][1])]
        truth = lambda t, place=place: place  # noqa: E731
        evidence = at_moments(world, times, truth, claims, attempted=rounds)
        verdict = judged(world, evidence, claims[0][1], now_ms)
        if verdict.permission == "granted":
            assert off_and_share(verdict, truth, claims)[0] < 1_000, seed


@pytest.mark.parametrize("silent", [4, 8, 12])
def test_claims_clustered_where_nobody_ranges_prove_nothing(make_world, now_ms, silent):
    """Claims within reach of the flight in each silent gap, on a mean offset that verifies: most of them are far off."""
    for seed in range(12):
        rng, world = random.Random(seed), make_world(seed=seed, sigma_mm=20, bias_sigma_mm=2)
        place = along((0.0, 0.0, 2_000.0), rng.uniform(0, math.tau), rng.uniform(2_500, 6_000))
        bearing, mean_mm = rng.uniform(0, math.tau), rng.uniform(500, 900)
        times: list[int] = []
        gaps: list[tuple[int, int]] = []
        t = 500
        while len(times) < 80:
            times += range(t, t + 50 * silent, 50)
            t += 2 * 50 * silent
            gaps.append((times[-1], t))
        gaps.pop()
        claims = [(400, along(place, bearing, mean_mm))]
        each = min(8, 170 // len(gaps) - 2)
        for begin, end in gaps:
            claims.append((begin + 1, along(place, bearing, mean_mm)))
            for part in range(each):
                at = round((begin + end) / 2 + (part - each / 2) * 0.3 * (end - begin) / each)
                reach = 1_000 + ACCELERATION * (at - begin) * (end - at) / 2
                claims.append((at, along(place, bearing, mean_mm + 0.97 * reach)))
            claims.append((end - 1, along(place, bearing, mean_mm)))
        claims.append((times[-1] + 100, along(place, bearing, mean_mm)))

        def truth(t, gaps=gaps, place=place, bearing=bearing):
            for begin, end in gaps:
                if begin < t < end:
                    middle, quarter = (begin + end) / 2, (end - begin) / 4
                    return along(place, bearing, -dash(t, middle, ACCELERATION * quarter * quarter))
            return place

        evidence = at_moments(world, times, truth, claims, attempted=(times[-1] - 500) // 50 + 1)
        verdict = judged(world, evidence, claims[0][1], now_ms)
        if verdict.permission == "granted":
            off_mm, share = off_and_share(verdict, truth, claims)
            assert off_mm < 1_000, seed
            assert share < 0.25, seed


@pytest.mark.parametrize("periods", [2, 3, 4.1, 8])
def test_swings_of_whole_periods_certify_no_false_place(make_world, now_ms, periods):
    """The claims hover; the drone swings as fast as it can turn, so that stretches of its own length average it out."""
    rounds = 160
    for seed in range(8):
        rng, world = random.Random(seed), make_world(seed=seed, anchors=PAPERS, sigma_mm=20, bias_sigma_mm=3)
        bearing = rng.uniform(0, math.tau)
        place = along((0.0, 0.0, 1_500.0), bearing, rng.uniform(6_000, 14_000))
        period_ms = 50 * rounds / periods
        swing_mm = min(ACCELERATION * period_ms * period_ms / 32, rng.uniform(1_200, 4_000))
        phase_ms = rng.uniform(0, period_ms)

        def truth(t, place=place, bearing=bearing, period_ms=period_ms, swing_mm=swing_mm, phase_ms=phase_ms):
            part = 2 * (((t - phase_ms) / period_ms) % 1)
            side = 1 if part < 1 else -1
            return along(place, bearing + math.pi / 2, side * swing_mm * 4 * (part % 1) * (1 - part % 1))

        evidence = world.evidence(truth, lambda t, place=place: place, rounds=rounds)
        session = world.session(world.claim(place, START_MS), max_rounds=500)
        verdict = preview(session, world.commissioning, evidence, now_ms)
        if verdict.permission == "granted":
            claims = [(t, place) for t in range(500, 500 + 50 * rounds, 200)]
            off_mm, share = off_and_share(verdict, truth, claims)
            assert off_mm < 1_000, seed
            assert share < 0.25, seed
