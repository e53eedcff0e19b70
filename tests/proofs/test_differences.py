"""Step 6: what the time stamps of the drone's frames prove, and what they do not."""

from __future__ import annotations

import functools
import math
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kit.proof_world import SQUARE, START_MS, World
from scipy.optimize import least_squares

from wonderland.proofs.claims import ClaimedPath
from wonderland.proofs.differences import MM_PER_TICK, frames_needed, judge_times, stamped
from wonderland.proofs.heights import UNKNOWN_HEIGHT_MM
from wonderland.proofs.hyperbolic import Heard, TimeFix
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.testimony import WitnessBrought
from wonderland.proofs.verdict import decide

NEAR = (3000, 4000, 3000)
FAR = (3000, 14_000, 4000)
SIX = tuple(
    (round(2500 * math.cos(math.pi * k / 3 + 0.4)), round(2500 * math.sin(math.pi * k / 3 + 0.4))) for k in range(6)
)
"""Six anchors: four leave two places that fit their differences exactly, of different heights."""


def verdict_of(world, truth, claimed, *, ranged=None, frames=60, rounds=40, stamps=None, witness=None, **policy):
    """The drone is at ``truth``, signs ``claimed``, and its radio makes the ranges fit ``ranged``."""
    session = world.session(world.claim(claimed, START_MS), **policy)
    evidence = world.evidence(
        lambda t: ranged or truth, lambda t: claimed, rounds=rounds, claimed_rounds=max(rounds, frames) + 20
    )
    if stamps is None:
        stamps = world.stamps(lambda t: truth, frames=frames)
    return decide(
        session,
        world.commissioning,
        replace(evidence, time_stamps=stamps),
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
        witness=witness,
    )


def codes(verdict):
    found = {reason.code for reason in verdict.reasons}
    return found | ({reason.code for reason in verdict.signed.reasons} if verdict.signed else set())


@pytest.fixture
def timed(make_world):
    def make(seed=1, **more):
        clock = {name: more.pop(name) for name in ("timestamp_sigma_mm", "clock_sigma_mm") if name in more}
        world = make_world(seed, **more)
        world.share_a_clock(**clock)
        return world

    return make


@pytest.fixture
def six(timed):
    return functools.partial(timed, anchors=SIX)


# --- what is earned --------------------------------------------------------------------------------------------------


def test_an_honest_drone_earns_assurance_3_and_needs_no_upper_bound(six):
    verdict = verdict_of(six(), NEAR, NEAR, min_assurance=3)
    assert (verdict.outcome, verdict.assurance) == ("verified", 3)
    assert verdict.time_differences.finding == "inside"
    assert verdict.time_differences.agrees
    assert verdict.time_differences.likelihood_ppm >= 990_000
    assert not codes(verdict) & {"upper_bound", "assurance_too_low"}
    assert "time_differences_prove" in codes(verdict)


def test_far_away_time_stamps_prove_too_little_and_the_verdict_says_so(timed):
    world = timed()
    low = verdict_of(world, FAR, FAR, min_assurance=2)
    assert (low.outcome, low.assurance) == ("verified", 2)
    assert {"time_differences_vague", "upper_bound"} <= codes(low)
    assert low.time_differences.finding == "vague"
    high = verdict_of(timed(), FAR, FAR, min_assurance=3)
    assert (high.outcome, high.assurance) == ("inconclusive", 2)
    assert "assurance_too_low" in codes(high)
    assert frames_needed(world.commissioning, Policy(), *FAR) == -1


def test_a_little_too_few_frames_ask_for_more(six):
    place = (2000, 10_500, 3000)
    world = six(seed=3)
    needed = frames_needed(world.commissioning, Policy(), *place)
    assert needed > 15
    verdict = verdict_of(world, place, place, frames=12, rounds=60, min_assurance=3)
    assert (verdict.outcome, verdict.assurance) == ("inconclusive", 2)
    assert verdict.more_rounds > 0
    assert verdict.time_differences.more_frames > 0


@pytest.mark.parametrize("frames", [0, 5, 9])
def test_fewer_than_ten_frames_are_none(timed, frames):
    world = timed()
    stamps = world.stamps(lambda t: NEAR, frames=frames) if frames else None
    session = world.session(world.claim(NEAR, START_MS), min_assurance=3)
    evidence = replace(world.evidence(lambda t: NEAR, lambda t: NEAR), time_stamps=stamps)
    verdict = decide(
        session,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
    )
    assert (verdict.outcome, verdict.assurance) == ("inconclusive", 2)
    assert "no_time_stamps" in codes(verdict)
    assert verdict.more_rounds > 0


@pytest.mark.parametrize("bound_by", ["key", "none"])
def test_frames_that_nothing_ties_to_the_session_prove_nothing(timed, bound_by):
    world = timed()
    stamps = world.stamps(lambda t: NEAR, bound_by=bound_by)
    verdict = verdict_of(world, NEAR, NEAR, stamps=stamps, min_assurance=3)
    assert (verdict.outcome, verdict.assurance) == ("inconclusive", 2)
    assert "time_differences_unbound" in codes(verdict)


def test_a_pad_without_a_commissioned_clock_has_no_level_3(make_world):
    world = make_world(1)
    verdict = verdict_of(world, NEAR, NEAR, min_assurance=3)
    assert (verdict.outcome, verdict.assurance, verdict.more_rounds) == ("inconclusive", 2, -1)


def test_static_sequences_earn_nothing_above_1(timed):
    world = timed()
    session = world.session(world.claim(NEAR, START_MS), min_assurance=1)
    evidence = world.evidence(lambda t: NEAR, lambda t: NEAR)
    evidence = replace(evidence, time_stamps=world.stamps(lambda t: NEAR), radio=replace(evidence.radio, sts="static"))
    verdict = decide(
        session,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
    )
    assert verdict.assurance == 1


# --- who is caught ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", [NEAR, (500, 2500, 2500), (6000, -5000, 5000), FAR])
@pytest.mark.parametrize("lie", [(3000, 0, 0), (-2500, 0, 0), (2100, 2100, 0), (0, 9000, 0), (0, 45_000, 0)])
def test_ranges_that_fit_the_claim_exactly_help_no_liar(timed, place, lie):
    for seed in range(3):
        claimed = place
        truth = tuple(a + b for a, b in zip(place, lie, strict=True))
        verdict = verdict_of(timed(seed), truth, claimed, ranged=claimed, min_assurance=3)
        assert verdict.outcome in {"refuted", "inconclusive"}
        assert verdict.permission == "refused"
        if place != FAR:
            assert verdict.outcome == "refuted", (place, lie)
            assert "time_differences_contradict" in codes(verdict)


def test_the_same_lies_win_at_level_2_without_time_stamps(make_world):
    """What level 3 is for: the same evidence, less the time stamps."""
    world = make_world(1)
    session = world.session(world.claim(NEAR, START_MS))
    evidence = world.evidence(lambda t: NEAR, lambda t: NEAR)
    verdict = decide(
        session,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
    )
    assert (verdict.outcome, verdict.assurance) == ("verified", 2)


def test_far_away_on_the_same_bearing_time_stamps_help_less_and_never_prove_the_lie(timed):
    """3 m along the bearing at 25 m: where they do not catch it, the verdict has assurance 2 and says what it is."""
    outcomes = []
    for seed in range(8):
        truth, claimed = (3000, 25_000, 4000), (3000, 28_000, 4000)
        verdict = verdict_of(timed(seed), truth, claimed, ranged=claimed, frames=100, min_assurance=2)
        outcomes.append((verdict.outcome, verdict.assurance))
        if verdict.outcome == "verified":
            assert verdict.assurance == 2
            assert {"time_differences_vague", "upper_bound"} <= codes(verdict)
    assert ("verified", 3) not in outcomes


def test_ranges_that_refute_and_time_stamps_that_prove_settle_nothing(six):
    """A relay can lengthen an honest drone's ranges; that alone must not put it in the wrong."""
    verdict = verdict_of(six(), NEAR, NEAR, ranged=(6000, 8000, 3000))
    assert verdict.outcome == "inconclusive"
    assert {"time_differences_disagree"} <= codes(verdict)


# --- clocks and anchors ----------------------------------------------------------------------------------------------


def test_a_clock_that_is_off_is_noticed_and_earns_nothing(timed):
    verdict = verdict_of(timed(), NEAR, NEAR, stamps=timed().stamps(lambda t: NEAR, clock_mm=(0, 400, 0, 0)))
    assert verdict.time_differences.finding == "inconsistent"
    assert verdict.assurance == 2
    assert "time_differences_inconsistent" in codes(verdict)
    assert verdict.outcome == "verified", "what two-way ranging can bear still stands"


@pytest.mark.parametrize("bad", range(4))
@pytest.mark.parametrize("off_mm", [-700, 300, 5_000])
def test_the_clock_that_is_off_is_named_by_what_the_ranges_know(timed, bad, off_mm):
    errors = tuple(off_mm if index == bad else 0 for index in range(4))
    verdict = verdict_of(timed(), NEAR, NEAR, stamps=timed().stamps(lambda t: NEAR, clock_mm=errors))
    said = {reason.code: reason.facts for reason in verdict.reasons}
    assert said["clock_suspected"] == {"stamps_of": "pad", "anchor_ids": f"A{bad}", "anchors": 1}


def test_four_clocks_alone_cannot_name_the_bad_one(timed):
    """With ranges that are elsewhere (a lie, too) no anchor is accused."""
    verdict = verdict_of(
        timed(), NEAR, NEAR, ranged=(30_000, 8000, 3000), stamps=timed().stamps(lambda t: NEAR, clock_mm=(0, 400, 0, 0))
    )
    assert "time_differences_inconsistent" in codes(verdict)
    assert "clock_suspected" not in codes(verdict)


def test_two_clocks_that_are_off_are_not_blamed_on_one(timed):
    stamps = timed().stamps(lambda t: NEAR, clock_mm=(900, -900, 0, 0))
    verdict = verdict_of(timed(), NEAR, NEAR, stamps=stamps)
    assert "time_differences_inconsistent" in codes(verdict)
    assert "clock_suspected" not in codes(verdict)


def test_commissioned_offsets_are_taken_out(six):
    world = six()
    offsets = (250, -400, 120, 0, -75, 310)
    anchors = tuple(
        replace(anchor, clock_offset_mm=offset)
        for anchor, offset in zip(world.commissioning.anchors, offsets, strict=True)
    )
    world.commissioning = replace(world.commissioning, anchors=anchors)
    stamps = world.stamps(lambda t: NEAR, clock_mm=offsets)
    verdict = verdict_of(world, NEAR, NEAR, stamps=stamps, min_assurance=3)
    assert (verdict.outcome, verdict.assurance) == ("verified", 3)


def test_an_anchor_that_is_deaf_to_some_frames_costs_those_frames(six):
    world = six()
    stamps = world.stamps(lambda t: NEAR, frames=60, deaf=[(1, number) for number in range(0, 40, 2)])
    verdict = verdict_of(world, NEAR, NEAR, stamps=stamps, min_assurance=3)
    assert verdict.time_differences.frames == 40
    assert verdict.outcome == "verified"


def test_an_anchor_that_is_mostly_deaf_is_left_out_and_four_are_needed(timed, six):
    deaf = [(1, number) for number in range(50)]
    world = timed()
    four = verdict_of(world, NEAR, NEAR, stamps=world.stamps(lambda t: NEAR, deaf=deaf), min_assurance=3)
    assert "no_time_stamps" in codes(four)
    world = six()
    five = verdict_of(world, NEAR, NEAR, stamps=world.stamps(lambda t: NEAR, deaf=deaf), min_assurance=3)
    assert (five.outcome, five.time_differences.frames) == ("verified", 60)


def test_bursts_cost_their_frames_only(six):
    world = six()
    stamps = world.stamps(lambda t: NEAR)
    column = list(stamps.anchors[2].ticks)
    column[7] += 2_000
    column[30] += 50_000
    anchors = (*stamps.anchors[:2], replace(stamps.anchors[2], ticks=tuple(column)), stamps.anchors[3])
    verdict = verdict_of(world, NEAR, NEAR, stamps=replace(stamps, anchors=anchors), min_assurance=3)
    assert (verdict.outcome, verdict.time_differences.frames) == ("verified", 58)


def test_anchors_in_a_line_have_a_mirror_image_and_prove_nothing(timed):
    world = timed(anchors=((-1500, 0), (-500, 5), (500, -5), (1500, 0)))
    verdict = verdict_of(world, NEAR, NEAR, min_assurance=3)
    assert verdict.assurance == 2


def test_a_moving_drone_is_judged_along_its_path(six):
    world = six()
    claimed = lambda t: (-4000 + 2.0 * t, 4000, 3000)  # noqa: E731 - 2 m/s
    session = world.session(world.claim((-4000, 4000, 3000), START_MS), min_assurance=3)
    evidence = replace(world.evidence(claimed, claimed, rounds=60), time_stamps=world.stamps(claimed, frames=60))
    verdict = decide(
        session,
        world.commissioning,
        evidence,
        confirmed=True,
        signature_valid=True,
        authorisation=(),
        now_ms=START_MS + 20_000,
        evidence_sha256="0" * 64,
    )
    assert (verdict.outcome, verdict.assurance) == ("verified", 3)


# --- the witness -----------------------------------------------------------------------------------------------------

BESIDE = ((8000, 1500), (5000, 1500), (5000, -1500), (8000, -1500))


@pytest.mark.parametrize(
    ("seen", "outcome", "assurance", "code"),
    [
        (NEAR, "verified", 4, "witness_prove"),
        ((NEAR[0], NEAR[1] + 4000, NEAR[2]), "inconclusive", 3, "witness_contradicts"),
    ],
)
def test_pad_and_witness_each_have_to_prove_it(six, seen, outcome, assurance, code):
    other = six(2, anchors=BESIDE)
    witness = WitnessBrought(other.testimony(lambda t: seen), other.commissioning)
    verdict = verdict_of(six(), NEAR, NEAR, witness=witness, min_assurance=4)
    assert (verdict.outcome, verdict.assurance) == (outcome, assurance)
    assert code in codes(verdict)


def test_a_lying_pad_alone_cannot_bring_about_assurance_4(timed):
    """Everything that the pad brings fits the claim; the witness saw the drone elsewhere, or nothing."""
    claimed, truth = NEAR, (NEAR[0] - 4000, NEAR[1], NEAR[2])
    other = timed(2, anchors=BESIDE)
    for witness in (None, WitnessBrought(other.testimony(lambda t: truth), other.commissioning)):
        verdict = verdict_of(timed(), claimed, claimed, witness=witness, min_assurance=4)
        assert verdict.permission == "refused"


def test_frames_of_another_time_count_neither_for_the_pad_nor_for_the_witness(six):
    old = six().stamps(lambda t: NEAR)
    verdict = verdict_of(six(), NEAR, NEAR, stamps=replace(old, start_ms=old.start_ms - 3_600_000))
    assert verdict.outcome != "verified"
    assert "frames_not_fresh" in codes(verdict)
    other = six(2, anchors=BESIDE)
    testimony = other.testimony(lambda t: NEAR)
    stale = replace(testimony.time_stamps, start_ms=testimony.time_stamps.start_ms - 3_600_000)
    witness = WitnessBrought(replace(testimony, time_stamps=stale), other.commissioning)
    verdict = verdict_of(six(), NEAR, NEAR, witness=witness, min_assurance=4)
    assert verdict.assurance == 3
    assert verdict.outcome != "verified"


# --- the numbers -----------------------------------------------------------------------------------------------------


def test_the_fix_is_the_least_squares_one(timed):
    """Against SciPy's own minimum of the same χ²."""
    rng = random.Random(4)
    for _ in range(20):
        place = (rng.uniform(-7000, 7000), rng.uniform(-7000, 7000), rng.uniform(1500, 6000))
        heard = [
            Heard(i, float(e), float(n), 1200.0 if i == 0 else 200.0, 0.0, 9.0, 34.0) for i, (e, n) in enumerate(SQUARE)
        ]
        heard = [
            replace(one, length=math.dist(place, (one.east, one.north, one.up)) + rng.gauss(0, 6) + 12_345)
            for one in heard
        ]
        fix = TimeFix(heard, place[2], 50.0)

        def residuals(x, heard=heard, up=place[2]):
            # east, north, error of the height, moment of sending
            out = [
                (one.length - x[3] - math.dist((x[0], x[1], up + x[2]), (one.east, one.north, one.up))) / math.sqrt(43)
                for one in heard
            ]
            return [*out, x[2] / 50.0]

        found = fix.best(place[0] + 300, place[1] - 200, 1e9)
        truth = least_squares(
            residuals, (place[0], place[1], 0.0, 12_345.0), x_scale=(1000, 1000, 50, 1000), xtol=1e-14
        )
        if math.dist(truth.x[:2], place[:2]) > 1500:
            continue  # a valley along the bearing: there is no one answer
        assert math.dist((found.east, found.north), truth.x[:2]) < 30
        assert found.chi2 == pytest.approx(2 * truth.cost, abs=0.05)


def test_the_stated_covariance_is_the_observed_one(six):
    place, errors = (2500.0, 3500.0, 3000.0), []
    world = six(5, timestamp_sigma_mm=30, clock_sigma_mm=0)
    world.commissioning = replace(
        world.commissioning,
        anchors=tuple(replace(anchor, survey_sigma_mm=0) for anchor in world.commissioning.anchors),
    )
    path = ClaimedPath(world.commissioning.frame, world.evidence(lambda t: place, lambda t: place).claims)
    for _ in range(300):
        means = stamped(world.stamps(lambda t: place, frames=20), world.commissioning, path)
        found = judge_times(means, Policy(), None, 0.0)
        best = means.fix.with_height_sigma(UNKNOWN_HEIGHT_MM).descend(means.east, means.north)
        matrix = found.covariance
        determinant = matrix.ee * matrix.nn - matrix.en * matrix.en
        e, n = best.east - place[0], best.north - place[1]
        errors.append((matrix.nn * e * e - 2 * matrix.en * e * n + matrix.ee * n * n) / determinant)
    # χ² of two degrees of freedom: mean 2; correlated samples are believed a little less, so that it is below.
    assert 1.3 < sum(errors) / len(errors) < 2.2


def test_a_drone_on_the_edge_is_hardly_ever_proved_inside_or_outside_at_any_look(timed):
    """A small sample of what ``tests/bench/test_time_differences.py`` counts."""
    inside = outside = 0
    tries = 60
    for seed in range(tries):
        world = timed(seed, clock_sigma_mm=5)
        clock = [world.rng.gauss(0, 5) for _ in world.commissioning.anchors]
        truth = (NEAR[0] + 1000, NEAR[1], NEAR[2])
        stamps = world.stamps(lambda t, truth=truth: truth, frames=80, clock_mm=clock)
        path = ClaimedPath(world.commissioning.frame, world.evidence(lambda t: NEAR, lambda t: NEAR).claims)
        findings = set()
        for frames in (10, 14, 20, 29, 42, 60, 80):
            part = replace(
                stamps,
                gap_ms=stamps.gap_ms[:frames],
                anchors=tuple(replace(a, ticks=a.ticks[:frames]) for a in stamps.anchors),
            )
            means = stamped(part, world.commissioning, path)
            findings.add(judge_times(means, Policy(refute_ppm=5_000), None, 0.0).finding)
        inside += "inside" in findings
        outside += "outside" in findings
    assert inside <= 3
    assert outside <= 3


@settings(max_examples=40, deadline=None)
@given(
    data=st.data(),
    east=st.integers(-30_000, 30_000),
    north=st.integers(-30_000, 30_000),
    up=st.integers(0, 20_000),
)
def test_any_time_stamps_give_a_verdict_and_none_that_is_random_a_permission(data, east, north, up):
    world = World(1)
    world.share_a_clock()
    claimed = (east, north, up)
    frames = data.draw(st.integers(10, 20))
    ticks = st.lists(st.integers(-1, 2**24), min_size=frames, max_size=frames)
    stamps = world.stamps(lambda t: claimed, frames=frames)
    anchors = tuple(replace(anchor, ticks=tuple(data.draw(ticks))) for anchor in stamps.anchors)
    verdict = verdict_of(world, claimed, claimed, stamps=replace(stamps, anchors=anchors), min_assurance=3)
    assert verdict.permission == "refused"
    assert type(verdict).parse(verdict.to_json()) == verdict


def test_a_tick_is_what_the_standard_says():
    assert pytest.approx(299_792_458_000 / (128 * 499.2e6)) == MM_PER_TICK
    assert 4.69 < MM_PER_TICK < 4.70
