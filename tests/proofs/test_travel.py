"""How much of a bias a drone's way leaves: hovering gains nothing, claims do not matter, never less than is fixed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kit.proof_world import START_MS, World

from wonderland.proofs import travel
from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.errors import RecordError
from wonderland.proofs.estimate import Offset
from wonderland.proofs.likelihood import Matrix2
from wonderland.proofs.prospects import hopeless
from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.reduction import reduce
from wonderland.proofs.rounds import usable
from wonderland.proofs.stopping import more_rounds
from wonderland.proofs.verdict import preview
from wonderland_research.attack_lab.attacks.motion import flown, honest
from wonderland_research.attack_lab.batch import measured, moving, round_times, standing
from wonderland_research.attack_lab.places import FLOWN

PAD = FLOWN.commissioning
FIXED = PAD.bias_fixed_ppm / 1e6
ROUNDS = st.integers(10, 160)


def columns(way_mm, anchors=4, base=20_000):
    """What anchors measure, all in the drone's direction of flight."""
    return [tuple(base + 10 * round(x / 10) for x in way_mm) for _ in range(anchors)]


def left(way_mm):
    (found,) = set(travel.bias_left(columns(way_mm), PAD))
    return found


def exactly(way_mm):
    """What a process with this correlation leaves of a mean over these places."""
    apart = np.abs(np.subtract.outer(way_mm, way_mm))
    return FIXED + (1.0 - FIXED) * np.exp(-apart / PAD.bias_length_mm).mean()


@given(ROUNDS, st.integers(3, 8), st.data())
@settings(max_examples=60, deadline=None)
def test_hovering_gains_nothing(rounds, anchors, data):
    """Whatever the noise, as long as no two ranges differ by more than the allowance."""
    wander = st.lists(st.integers(0, travel.ALLOWANCE_MM), min_size=rounds, max_size=rounds)
    ranges = [tuple(5_000 + x for x in data.draw(wander)) for _ in range(anchors)]
    assert set(travel.bias_left(ranges, PAD)) == {1.0}


@given(ROUNDS, st.floats(0, 1000), st.floats(0, 1000))
@settings(max_examples=100, deadline=None)
def test_farther_leaves_less_and_never_less_than_is_fixed(rounds, step, more):
    near, far = left(np.arange(rounds) * step), left(np.arange(rounds) * (step + more))
    assert FIXED + (1.0 - FIXED) / travel.BLOCKS - 1e-12 <= far <= near + 1e-3  # ranges are whole centimetres
    assert near <= 1.0


@given(st.integers(0, 3), st.lists(st.integers(100, 90_000), min_size=60, max_size=60), st.booleans())
@settings(max_examples=60, deadline=None)
def test_one_anchor_makes_no_motion_and_hides_little(which, odd, moves):
    """All but one have to say so: what one says counts for nothing where the others are alike."""
    ranges = columns(np.arange(60) * (200.0 if moves else 0.0))
    ranges[which] = tuple(odd)
    assert travel.bias_left(ranges, PAD)[which - 1] == (left(np.arange(60) * 200.0) if moves else 1.0)


def test_two_anchors_that_move_make_no_motion():
    ranges = columns(np.zeros(60))
    ranges[0] = ranges[1] = columns(np.arange(60) * 200.0)[0]
    assert set(travel.bias_left(ranges, PAD)) == {1.0}
    assert set(travel.bias_left(columns(np.arange(60) * 200.0, anchors=2), PAD)) == {1.0}
    ranges = columns(np.arange(60) * 200.0, anchors=3)
    assert travel.bias_left(ranges, PAD)[0] < 0.6
    ranges[2] = columns(np.zeros(60))[0]
    assert set(travel.bias_left(ranges, PAD)) == {1.0}


def test_no_flight_is_believed_to_average_out_more_than_it_does():
    """To and fro, dwelling at one place between hops, at random; hops as fast as 15 m/s."""
    rng = np.random.default_rng(3)
    t = np.arange(160)
    for _ in range(200):
        to_and_fro = rng.uniform(300, 8_000) * np.abs((t / rng.uniform(6, 160) + rng.random()) % 1 * 2 - 1)
        walk = np.cumsum(rng.normal(0.0, rng.uniform(50, 500), 160))
        goals = np.where(rng.random(12) < 0.4, 0.0, rng.uniform(-6_000, 6_000, 12))[t * 12 // 160]
        hops, fastest = np.zeros(160), rng.uniform(100, 750)
        for number in range(1, 160):
            step = goals[number] - hops[number - 1]
            hops[number] = hops[number - 1] + np.clip(step, -fastest, fastest)
        for way in (to_and_fro, walk, hops):
            assert left(way) > 0.97 * exactly(way)


def test_an_anchor_that_was_silent_for_a_block_keeps_its_bias():
    ranges = columns(np.arange(60) * 200.0)
    ranges[2] = (NO_RANGE,) * 6 + ranges[2][6:]
    shares = travel.bias_left(ranges, PAD)
    assert shares[2] == 1.0
    assert shares[0] == shares[1] == shares[3] < 0.6
    ranges[1] = (NO_RANGE,) * 60
    assert set(travel.bias_left(ranges, PAD)) == {1.0}, "two anchors show no motion"


@pytest.mark.parametrize("rounds", [0, 1, 9])
def test_too_few_rounds_show_no_motion(rounds):
    assert set(travel.bias_left(columns(np.arange(rounds) * 5000.0), PAD)) == {1.0}
    assert travel.bias_left([], PAD) == ()


def test_without_the_fields_all_is_as_ever():
    plain = dataclasses.replace(PAD, bias_length_mm=None, bias_fixed_ppm=None)
    assert set(travel.bias_left(columns(np.arange(160) * 100.0), plain)) == {1.0}
    assert travel.hope(1.0, 10, plain) == 1.0
    with pytest.raises(RecordError, match="bias_fixed_ppm"):
        Commissioning.decode(dataclasses.replace(PAD, bias_fixed_ppm=None).encode())
    assert Commissioning.decode(PAD.encode()) == PAD


def floors(batch, index=0, rounds=160):
    evidence = batch.evidence(index, rounds)
    kept = usable(evidence.ranges, [anchor.anchor_id for anchor in batch.commissioning.anchors], 100_000)
    path = ClaimedPath(batch.commissioning.frame, (batch.session(index).claim, *evidence.claims))
    return reduce(kept, batch.commissioning, path)


def test_a_flown_way_shrinks_the_floor_and_a_claimed_one_does_not():
    rng = np.random.default_rng(4)
    outwards = np.array([[2.0, 0.0, 0.0]])
    batch = honest(2, False, rng, 1)
    there = np.array([[3_000.0, 0.0, 4_000.0]])
    hovers = np.repeat(there[:, None, :], 160, axis=1)
    flies = hovers + outwards[:, None, :] * round_times()[None, :, None]
    quiet = np.zeros((1, 1, 4))
    cases = {}
    for name, truth in (("flies", flies), ("hovers", hovers)):
        for said, claims in (("moving", moving(there, outwards)), ("standing", standing(there))):
            batch.range_mm, batch.claims = measured(rng, FLOWN, truth, noise=20.0, bias=quiet), claims
            cases[name, said] = floors(batch)
    assert cases["flies", "moving"].bias_left < 0.65
    assert cases["hovers", "standing"].bias_left == 1.0
    assert cases["hovers", "moving"].bias_left == 1.0
    whole = [anchor.floor for anchor in cases["hovers", "standing"].anchors]
    shrunk = [anchor.floor for anchor in cases["flies", "moving"].anchors]
    assert all(less < 0.66 * more for less, more in zip(shrunk, whole, strict=True))


def test_what_is_in_no_mean_is_no_way():
    """It flies on, and claims to have stayed: only the rounds about the claim are in the means, and only they count."""
    rng = np.random.default_rng(5)
    there = np.array([[4_000.0, 0.0, 4_000.0]])
    truth = np.repeat(there[:, None, :], 160, axis=1)
    truth[0, 100:, 0] += np.arange(60) * 200.0
    batch = honest(2, False, rng, 1)
    batch.claims = standing(there)
    batch.range_mm = measured(rng, FLOWN, truth, noise=20.0, bias=np.zeros((1, 1, 4)))
    assert floors(batch).bias_left == 1.0


def test_hope_is_for_those_who_move():
    assert travel.hope(1.0, travel.PATIENCE_ROUNDS, PAD) == 1.0
    assert travel.hope(1.0, 10, PAD) == FIXED
    assert travel.hope(0.5, 160, PAD) == pytest.approx(FIXED / 0.5)


def test_a_pad_goes_on_where_a_way_may_settle_it():
    floor = Matrix2(450.0**2, 0.0, 100.0)
    offset = Offset(0.0, 0.0, floor + Matrix2(10_000.0, 0.0, 100.0), floor, 0.0, 0.0, 2)
    assert more_rounds(offset, 10, Policy()) == -1
    assert more_rounds(offset, 10, Policy(), hope=0.25) > 0
    assert more_rounds(offset, 10, Policy(), hope=0.9) == -1


def test_prospects_count_on_what_is_fixed():
    world = World(bias_sigma_mm=150)
    claim = world.claim((3_000, 14_000, 4_000), START_MS)
    assert "biases" in hopeless(world.commissioning, Policy(), claim)
    moving = dataclasses.replace(world.commissioning, bias_length_mm=2_000, bias_fixed_ppm=100_000)
    assert hopeless(moving, Policy(), claim) == ""


def test_lies_in_flight_win_nothing_and_honest_flights_gain():
    lies = flown(2, np.random.default_rng(6), 60)
    true = honest(2, True, np.random.default_rng(6), 60)
    counts = {"lies": 0, "now": 0, "before": 0}
    for index in range(60):
        for name, batch, pad in (
            ("lies", lies, PAD),
            ("now", true, PAD),
            ("before", true, dataclasses.replace(PAD, bias_length_mm=None, bias_fixed_ppm=None)),
        ):
            evidence = batch.evidence(index, 160)
            verdict = preview(batch.session(index), pad, evidence, evidence.ranges.t_ms[-1])
            counts[name] += verdict.outcome == "verified"
            assert name == "lies" or verdict.outcome != "refuted"
    assert counts["lies"] == 0
    assert counts["now"] > counts["before"]
