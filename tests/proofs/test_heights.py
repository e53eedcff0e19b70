"""Step 6, whatever the height: a false height helps nobody, and the margin is the one that a search finds."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from kit.proof_world import SQUARE, START_MS, World
from scipy.optimize import least_squares, minimize

from wonderland.proofs.differences import frames_needed
from wonderland.proofs.heights import LOWEST_MM, Heights
from wonderland.proofs.hyperbolic import Heard
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import preview

RADIUS_MM = 1_000.0


def places(world):
    return np.array([(a.east_mm, a.north_mm, a.up_mm) for a in world.commissioning.anchors], dtype=float)


def ring(count, radius):
    angles = [2 * math.pi * k / count + 0.4 for k in range(count)]
    return tuple((round(radius * math.cos(angle)), round(radius * math.sin(angle))) for angle in angles)


def timed(seed=1, **more):
    world = World(seed=seed, **more)
    world.share_a_clock()
    return world


def heard(world, place, frames):
    """Stamps as they are on average."""
    white = float(world.commissioning.timestamp_sigma_mm**2) / frames
    return tuple(
        Heard(
            index, float(a.east_mm), float(a.north_mm), float(a.up_mm),
            math.dist(place, (a.east_mm, a.north_mm, a.up_mm)), white, float(a.clock_sigma_mm**2 + a.survey_sigma_mm**2),
        )
        for index, a in enumerate(world.commissioning.anchors)
    )  # fmt: skip


def searched(stamps, claim):
    """The margin by a search from many starts, in three dimensions."""
    anchors = np.array([(one.east, one.north, one.up) for one in stamps])
    lengths = np.array([one.length for one in stamps])
    lowest = anchors[:, 2].min() - LOWEST_MM
    variance = stamps[0].white + stamps[0].floor

    def outside(guess):
        reach = RADIUS_MM + guess[0] ** 2
        up = lowest + (guess[2] * 100.0) ** 2
        place = (claim[0] + reach * math.cos(guess[1]), claim[1] + reach * math.sin(guess[1]), up)
        away = lengths - np.linalg.norm(anchors - place, axis=1)
        return float(((away - away.mean()) ** 2).sum()) / variance

    rng = random.Random(7)
    found = []
    for _ in range(40):
        start = (rng.uniform(0.0, 90.0), rng.uniform(0.0, 6.3), math.sqrt(rng.uniform(0.0, 20_000.0)) / 10.0)
        found.append(minimize(outside, start, method="Nelder-Mead", options={"maxiter": 900}).fun)
    return math.sqrt(max(min(found), 0.0))


@pytest.mark.parametrize("anchors", [SQUARE, ring(4, 6_000.0), ring(5, 2_500.0), ring(6, 4_000.0)])
@pytest.mark.parametrize("place", [(0.0, 500.0, 3_000.0), (3_000.0, -2_500.0, 4_000.0), (-4_000.0, -4_500.0, 6_000.0)])
def test_the_margin_is_the_one_that_a_search_finds(anchors, place):
    stamps = heard(timed(anchors=anchors), place, 100)
    margin = Heights(stamps, place[0], place[1], RADIUS_MM).margin(place[2]).sigmas
    found = searched(stamps, place)
    assert margin <= 1.05 * found + 0.15
    # The search may end too early; it may not end far above.
    assert min(margin, 8.0) >= 0.6 * min(found, 8.0) - 0.3


def test_four_anchors_leave_a_second_place_and_a_fifth_takes_it_away():
    place = (3_000.0, 4_000.0, 3_000.0)
    assert Heights(heard(timed(), place, 100), place[0], place[1], RADIUS_MM).margin(place[2]).sigmas < 0.1
    assert frames_needed(timed().commissioning, Policy(), *place) == -1
    five = timed(anchors=ring(5, 2_500.0))
    assert Heights(heard(five, place, 100), place[0], place[1], RADIUS_MM).margin(place[2]).sigmas > 3.5
    assert 0 < frames_needed(five.commissioning, Policy(), *place) <= 160


def delayed(anchors, truth, lie_mm):
    """One delay of all answers, and the claim that fits it best: where, how high."""

    def claim_of(delay):
        ranges = np.linalg.norm(anchors - truth, axis=1) + delay
        start = truth * (1.0 + delay / np.linalg.norm(truth))
        return least_squares(lambda guess: np.linalg.norm(anchors - guess, axis=1) - ranges, start).x

    low, high = 0.0, 40_000.0
    for _ in range(25):
        middle = 0.5 * (low + high)
        if math.dist(truth[:2], claim_of(middle)[:2]) < lie_mm:
            low = middle
        else:
            high = middle
    return high, claim_of(high)


@pytest.mark.parametrize("seed", range(12))
def test_one_delay_and_a_false_height_win_nothing(seed):
    rng = random.Random(seed)
    world = timed(seed, sigma_mm=30)
    anchors = places(world)
    bearing, away = rng.uniform(0.0, 6.3), rng.uniform(3_000.0, 12_000.0)
    truth = np.array((away * math.cos(bearing), away * math.sin(bearing), rng.uniform(2_000.0, 7_000.0)))
    delay, claim = delayed(anchors, truth, rng.uniform(3_050.0, 4_000.0))
    assert math.dist(truth[:2], claim[:2]) > 2_900.0, "no delay fits a lie of three buffers there: choose another seed"
    claimed = tuple(round(float(value)) for value in claim)
    evidence = world.evidence(lambda t: tuple(truth), lambda t: claimed, rounds=160, bias_mm=[delay] * 4)
    stamps = world.stamps(lambda t: tuple(truth), frames=160)
    for rounds in LOOKS:
        table = evidence.ranges
        cut = tuple(replace(each, range_mm=each.range_mm[:rounds]) for each in table.anchors)
        ticks = tuple(replace(each, ticks=each.ticks[:rounds]) for each in stamps.anchors)
        seen = replace(
            evidence,
            ranges=replace(table, t_ms=table.t_ms[:rounds], anchors=cut),
            claims=tuple(each for each in evidence.claims if each.t_ms <= table.t_ms[rounds - 1] + 100),
            time_stamps=replace(stamps, gap_ms=stamps.gap_ms[:rounds], anchors=ticks),
        )
        session = world.session(world.claim(claimed, START_MS), min_assurance=3)
        assert preview(session, world.commissioning, seen, START_MS + 20_000).outcome != "verified"
