"""The claimed height against the ranges: what is proved, what refutes, what stays the drone's word."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from wonderland.proofs.estimate import solve
from wonderland.proofs.prospects import height_rounds, hopeless
from wonderland.proofs.records.sessions import Claim
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.reduction import AnchorMean, Reduced
from wonderland.proofs.space import chi2_at_height, solve_in_space
from wonderland_research.attack_lab.attacks import height as lies
from wonderland_research.attack_lab.attacks.common import still
from wonderland_research.attack_lab.batch import claim_times, measured
from wonderland_research.attack_lab.judge import run_batch, verdict_of
from wonderland_research.attack_lab.places import CUBE, FLAT, MASTS, POLICY, SIX, SQUARE, distances

PLACE = np.array([1_000.0, -2_000.0, 4_000.0])
ASIDE = np.array([5_000.0, 3_000.0, 5_000.0])


def codes(verdict):
    return {reason.code for reason in verdict.reasons}


def judged(pad, truth, up=0.0, *, level=2, rounds=40, seed=1, extra=None, **policy):
    """One drone that is at ``truth`` and claims to be ``up`` mm above it."""
    rng = np.random.default_rng(seed)
    truth = np.asarray(truth)[None, :]
    claim = truth + np.array([0.0, 0.0, up])
    batch = lies.still_at(rng, level, pad, claim, truth, None if extra is None else np.asarray(extra)[None, None, :])
    batch.policy = dataclasses.replace(batch.policy, **{"height_required": False, **policy})
    return verdict_of(batch, 0, rounds)


def reduced_of(pad, place, claim, *, sigma_mm=20.0, shared_mm=8.0, seed=2):
    """Virtual ranges with errors as large as is said of them."""
    rng = np.random.default_rng(seed)
    ranges = distances(np.asarray(place), pad.anchors) + rng.normal(0.0, sigma_mm, len(pad.anchors))
    east, north, up = claim
    anchors = tuple(
        AnchorMean(i, *map(float, anchor), float(range_mm), 0.0, 40, 0.75 * sigma_mm**2, 0.25 * sigma_mm**2)
        for i, (anchor, range_mm) in enumerate(zip(pad.anchors, ranges, strict=True))
    )
    return Reduced(anchors, east, north, up, 0, 40, 40.0, 0, 100.0, shared_mm)


@pytest.mark.parametrize("pad", [CUBE, MASTS, SIX, SQUARE], ids=lambda pad: pad.name)
def test_the_place_in_space_is_the_one_of_an_independent_fit(pad):
    """SciPy's least squares on whitened residuals: the same place, and the same covariance, mm by mm."""
    known = reduced_of(pad, ASIDE, (4_000.0, 4_000.0, 3_500.0))
    found = solve_in_space(known, 0.0, 0.0)
    ranges = np.array([anchor.range_mm for anchor in known.anchors])
    covariance = np.diag([a.white + a.floor for a in known.anchors]) + known.installation_sigma_mm**2
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    other = least_squares(lambda x: whiten @ (ranges - distances(x, pad.anchors)), ASIDE)
    assert (known.east + found.east, known.north + found.north, known.up + found.up) == pytest.approx(other.x, abs=0.2)
    expected = np.linalg.inv(other.jac.T @ other.jac)
    got = [found.horizontal.ee, found.horizontal.en, found.horizontal.nn, found.eu, found.nu, found.uu]
    at = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    assert got == pytest.approx([expected[i] for i in at], rel=1e-3, abs=1.0)
    assert found.chi2 == pytest.approx(2.0 * other.cost, rel=1e-4, abs=1e-4)
    # How far the height moves with each range, by moving it.
    for position, gain in enumerate(found.gains):
        moved = list(known.anchors)
        moved[position] = dataclasses.replace(moved[position], range_mm=moved[position].range_mm + 1.0)
        again = solve_in_space(dataclasses.replace(known, anchors=tuple(moved)), found.east, found.north)
        assert again.up - found.up == pytest.approx(gain, rel=0.05, abs=0.02)


def test_its_error_is_as_large_as_it_says():
    """A thousand drones at three pads: 68 % within one standard deviation, each height unbiased."""
    for pad in (CUBE, MASTS, SQUARE):
        z = []
        for seed in range(300):
            known = reduced_of(pad, ASIDE, tuple(ASIDE), seed=seed, shared_mm=0.0)
            found = solve_in_space(known, 0.0, 0.0)
            z.append(found.up / math.sqrt(found.uu))
        assert np.std(z) == pytest.approx(1.0, abs=0.12)
        assert np.mean(z) == pytest.approx(0.0, abs=0.2)


def test_the_two_places_that_a_plane_of_anchors_leaves_are_both_found():
    """One metre above a flat pad, one metre below it: the ranges are the same, and nothing is proved."""
    known = reduced_of(FLAT, (2_000.0, 1_000.0, 1_250.0), (2_000.0, 1_000.0, 1_250.0), sigma_mm=5.0)
    found = solve_in_space(known, 0.0, 0.0)
    assert known.up + found.up == pytest.approx(1_250.0, abs=100.0)
    (other,) = found.others
    assert known.up + other == pytest.approx(-750.0, abs=100.0)
    verdict = judged(FLAT, (2_000.0, 1_000.0, 1_250.0))
    assert verdict.height.outcome == "claimed"
    assert verdict.height.lowest_mm < -700 < 1_200 < verdict.height.highest_mm
    # From five metres up the mirror image is far below the ground, where nobody is.
    assert judged(FLAT, (2_000.0, 1_000.0, 5_000.0)).height.outcome == "proved"


def test_what_another_height_costs_is_asked_of_the_ranges():
    """χ² at a height is that of the best place there; a bell about the estimate would be far off near the plane."""
    known = reduced_of(FLAT, (2_000.0, 1_000.0, 500.0), (2_000.0, 1_000.0, 500.0), sigma_mm=30.0)
    found = solve_in_space(known, 0.0, 0.0)
    for up in (-200.0, 0.0, 300.0):
        flat = dataclasses.replace(known, up=known.up + up, height_sigma_mm=0.0)
        assert chi2_at_height(known, found, up) == pytest.approx(solve(flat).chi2, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize("pad", [CUBE, MASTS, SIX], ids=lambda pad: pad.name)
def test_an_honest_height_is_proved_and_recorded(pad):
    verdict = judged(pad, PLACE)
    assert (verdict.outcome, verdict.height.outcome) == ("verified", "proved")
    assert "height_proved" in codes(verdict)
    assert "height_claimed" not in codes(verdict)
    assert verdict.height.claimed_mm == 4_000
    assert verdict.height.lowest_mm < 4_000 < verdict.height.highest_mm
    assert verdict.height.measured_mm == verdict.estimate.up_mm == pytest.approx(4_000, abs=200)
    assert verdict.height.uu_mm2 > 0
    assert Verdict.parse(verdict.to_json()) == verdict


@pytest.mark.parametrize("up", [-5_000.0, -3_000.0, -2_000.0, 2_000.0, 3_000.0, 5_000.0])
@pytest.mark.parametrize("pad", [CUBE, MASTS], ids=lambda pad: pad.name)
def test_a_false_height_is_refuted_and_the_true_place_measured(pad, up):
    verdict = judged(pad, (1_000.0, -2_000.0, 6_000.0), up)
    assert (verdict.outcome, verdict.permission) == ("refuted", "refused")
    assert verdict.height.outcome == "contradicted"
    assert "height_contradicts" in codes(verdict)
    found = (verdict.estimate.east_mm, verdict.estimate.north_mm, verdict.estimate.up_mm)
    assert math.dist(found, (1_000.0, -2_000.0, 6_000.0)) < 250
    off_mm = next(r.facts["off_mm"] for r in verdict.reasons if r.code == "height_contradicts")
    assert (off_mm < 0) == (up > 0)


def test_four_anchors_convict_nobody_and_permit_no_height_that_they_measure_otherwise():
    for up in (2_000.0, -2_000.0):
        verdict = judged(SQUARE, (3_000.0, 2_000.0, 5_000.0), up, rounds=160)
        assert verdict.outcome == "inconclusive"
        assert verdict.height.outcome == "claimed"


def test_whoever_states_that_its_height_is_bad_is_not_convicted_by_it():
    """4 m off and stated to be good to 3 m (95 %): no lie. The same stated to be good to half a metre is one."""
    truth = np.array([[1_000.0, -2_000.0, 4_000.0]])
    for stated_mm, outcome in ((3_000, "claimed"), (500, "contradicted")):
        batch = still(np.random.default_rng(1), 2, truth + np.array([0, 0, 4_000.0]), truth, pad=CUBE)
        batch.height_accuracy_mm = stated_mm
        verdict = verdict_of(batch, 0, 40)
        assert verdict.height.outcome == outcome
        assert (verdict.outcome == "refuted") == (outcome == "contradicted")
        assert verdict.height.tolerance_mm == max(1_000, 2 * stated_mm)


def test_a_policy_can_demand_a_proven_height():
    """What would be verified with the height as the drone's word is not, and more rounds are asked for where they help."""
    near_plane = (6_000.0, 4_000.0, 1_000.0)
    told = judged(FLAT, near_plane, height_buffer_mm=300)
    assert (told.outcome, "height_open" in codes(told)) == ("verified", True)
    verdict = judged(FLAT, near_plane, height_buffer_mm=300, height_required=True)
    assert (verdict.outcome, verdict.permission) == ("inconclusive", "refused")
    assert "height_not_proved" in codes(verdict)
    assert verdict.more_rounds == -1


def test_three_anchors_tell_no_height():
    three = dataclasses.replace(SQUARE, anchors=SQUARE.anchors[:3])
    verdict = judged(three, (3_000.0, 2_000.0, 5_000.0))
    assert verdict.height is None
    assert verdict.estimate.up_mm == 5_000


@pytest.mark.parametrize("size_mm", [-3_000.0, -800.0, 800.0, 3_000.0])
@pytest.mark.parametrize("bad", range(6))
def test_no_single_anchor_convicts_an_honest_drone_by_its_height(bad, size_mm):
    extra = [0.0] * 6
    extra[bad] = size_mm
    for pad in (MASTS, SIX):
        verdict = judged(pad, (2_000.0, -3_000.0, 5_000.0), extra=extra)
        assert verdict.outcome != "refuted"
        assert verdict.height is None or verdict.height.outcome != "contradicted"


def test_a_bad_anchor_is_left_out_and_the_height_is_proved_without_it():
    verdict = judged(CUBE, PLACE, extra=[0, 0, 3_000.0, 0, 0, 0, 0, 0])
    assert (verdict.outcome, verdict.height.outcome) == ("verified", "proved")
    assert "anchor_suspected" in codes(verdict)


def test_heights_that_waver_about_the_true_one_prove_nothing_and_convict_nobody():
    """Every other claim 5 m up, the others 5 m down: the mean is right, and no claim is."""
    rng = np.random.default_rng(3)
    truth = np.array([[1_000.0, -2_000.0, 6_000.0]])
    batch = lies.still_at(rng, 2, MASTS, truth, truth)
    for period, after in ((2, (40, 80, 160)), (4, (80, 160)), (8, (160,))):  # rounds that see both
        batch.claims = np.repeat(np.rint(truth)[:, None, :], batch.claims.shape[1], axis=1).astype(np.int64)
        batch.claims[:, :, 2] += np.where(np.arange(batch.claims.shape[1]) % period < period // 2, 5_000, -5_000)
        for rounds in after:
            verdict = verdict_of(batch, 0, rounds)
            assert verdict.outcome == "inconclusive", (period, rounds, verdict.reasons)
            assert verdict.height is None or verdict.height.outcome == "claimed"


def test_a_climb_that_the_ranges_follow_is_proved_and_one_that_they_do_not_is_not():
    rng = np.random.default_rng(4)
    batch = lies.mixed(2, MASTS, rng, 1)
    times = batch.t_ms.astype(float)
    truth = np.column_stack(
        [np.full(len(times), 1_000.0), np.full(len(times), 0.0), 8_000.0 - 0.6 * (times - times[0])]
    )
    told = claim_times(batch.claim_ms).astype(float)
    batch.truth_mm = truth[None]
    batch.range_mm = measured(rng, MASTS, truth[None])
    followed = np.column_stack(
        [np.full(len(told), 1_000.0), np.full(len(told), 0.0), 8_000.0 - 0.6 * (told - times[0])]
    )
    batch.claims = np.rint(followed)[None].astype(np.int64)
    assert verdict_of(batch, 0, 160).height.outcome == "proved"
    still_there = followed.copy()
    still_there[:, 2] = followed[:, 2][(told >= times[0]) & (told <= times[-1])].mean()
    batch.claims = np.rint(still_there)[None].astype(np.int64)
    verdict = verdict_of(batch, 0, 160)
    assert verdict.outcome == "inconclusive"
    assert verdict.height is None or verdict.height.outcome == "claimed"


def test_from_level_3_on_no_height_rests_on_the_drones_clock():
    """A delay of all answers moves a height at anchors that stand below; time stamps do not follow it."""
    honest = judged(MASTS, (1_000.0, 1_000.0, 4_000.0), level=3)
    assert honest.height.outcome == "proved"
    # Over the middle of a flat pad one delay is as good as a height, exactly: the ranges are those of 7 m.
    claim, truth = np.array([[0.0, 0.0, 7_000.0]]), np.array([[0.0, 0.0, 5_000.0]])
    pad = dataclasses.replace(FLAT, anchors=np.vstack([FLAT.anchors, [[0.0, 2_500.0, 250.0], [2_500.0, 0.0, 250.0]]]))
    extra = (distances(claim, pad.anchors) - distances(truth, pad.anchors))[:, None, :].mean(axis=2, keepdims=True)
    believed = lies.still_at(np.random.default_rng(1), 2, pad, claim, truth, np.repeat(extra, 6, axis=2))
    verdict = verdict_of(believed, 0, 160)
    assert (verdict.height.outcome, "upper_bound" in codes(verdict)) == ("proved", True)
    asked = lies.still_at(np.random.default_rng(1), 3, pad, claim, truth, np.repeat(extra, 6, axis=2))
    for rounds in (10, 40, 160):
        assert verdict_of(asked, 0, rounds).permission == "refused"


def test_the_lab_proves_no_false_height():
    for make in (lies.lie, lies.mixed):
        for pad in (MASTS, SQUARE):
            tally = run_batch(make(2, pad, np.random.default_rng(8), 60), sample=0)
            assert tally.won == 0
    honest = run_batch(lies.honest(2, np.random.default_rng(9), 60), sample=0)
    assert (honest.refuted, honest.won) == (0, 0)


def test_what_a_pad_tells_of_heights_is_known_before_it_ranges():
    """Where it says never a policy that demands it asks for nothing; where it says so many rounds they do."""
    policy = dataclasses.replace(POLICY, height_required=True)
    place = (2_000.0, 1_000.0, 5_000.0)
    rounds = height_rounds(MASTS.commissioning, policy, *place)
    assert 1 <= rounds <= 10
    assert judged(MASTS, place, height_required=True, rounds=40).permission == "granted"
    far = (0.0, 30_000.0, 3_000.0)
    assert height_rounds(FLAT.commissioning, policy, *far) == -1
    asked = Claim(
        lat_e7=30_000, lon_e7=0, height_mm=3_000, accuracy_mm=100, height_accuracy_mm=200, t_ms=1_800_000_000_000
    )
    wide = dataclasses.replace(policy, buffer_mm=20_000)
    assert "proven height" in hopeless(FLAT.commissioning, wide, asked)
    assert hopeless(FLAT.commissioning, dataclasses.replace(wide, height_required=False), asked) == ""
