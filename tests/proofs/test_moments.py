"""Every claimed moment counts: lies that balance their mean, glitches, and what honest flights look like beside them."""

from __future__ import annotations

import dataclasses
import math
import random

import numpy as np
import pytest
from kit.proof_world import START_MS

from wonderland.proofs.records.sessions import Evidence
from wonderland.proofs.verdict import preview
from wonderland_research.attack_lab import ATTACKS
from wonderland_research.attack_lab.judge import run_batch, verdict_of

HERE = (3000.0, 6000.0, 4000.0)
PAPERS = ((-171, -279), (-171, 279), (171, 279), (171, -279))
FAR = (12_000.0, 4_000.0, 1_000.0)
EAST = 7_500.0


def beside(place, off):
    """A claim at ``place`` and ``off(t)`` mm to the east of it."""
    return lambda t: (place[0] + off(t), place[1], place[2])


def to_and_fro(t):
    """2.5 m to the one side and to the other, across the line of sight of ``FAR``."""
    across = 2_500.0 if (t // 200) % 2 else -2_500.0
    return FAR[0] - 0.316 * across, FAR[1] + 0.949 * across, FAR[2]


def judged(world, truth, claimed, now_ms, rounds=40, asked=None):
    evidence = world.evidence(truth, claimed, rounds=rounds)
    session = world.session(world.claim((asked or claimed)(0), START_MS))
    return preview(session, world.commissioning, evidence, now_ms)


def codes(verdict):
    reasons = [*verdict.reasons, *(verdict.signed.reasons if verdict.signed else ())]
    return {reason.code for reason in reasons}


def some(share, seed=3):
    """True for this share of the claims, which come every 200 ms, chosen at random."""
    rng = random.Random(seed)
    chosen = [rng.random() < share for _ in range(200)]
    return lambda t: chosen[int(t // 200) % 200]


LIES = {
    "the issue's: 8 of 20": lambda t: EAST if some(0.4)(t) else 0.0,
    "most of them": lambda t: EAST if some(0.7)(t) else 0.0,
    "both sides": lambda t: EAST * (1 if (t // 200) % 3 == 0 else -1 if (t // 200) % 3 == 1 else 0),
    "every other one": lambda t: EAST * (1 if (t // 200) % 2 else -1),
    "at the beginning": lambda t: EAST if t < 1_300 else 0.0,
    "in the middle": lambda t: EAST if 1_200 < t < 2_000 else 0.0,
    "at the end": lambda t: EAST if t > 1_700 else 0.0,
    "to and fro, slowly": lambda t: EAST * ((t - 500) % 1_000 / 500 - 1),
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("speed", [0.0, 4.0])
def test_truth_at_some_moments_buys_nothing_for_lies_at_others(world, now_ms, lie, speed):
    truth = beside(HERE, lambda t: speed * (t - 1_500))
    claimed = beside(HERE, lambda t: speed * (t - 1_500) + LIES[lie](t))
    for rounds in (10, 20, 40):
        verdict = judged(world, truth, claimed, now_ms, rounds=rounds)
        times = range(500, 500 + 50 * rounds, 50)
        lying = sum(abs(LIES[lie](t)) >= 2_000 for t in times) / rounds
        if verdict.outcome == "verified":
            assert lying < 0.25, rounds
            here = truth(verdict.estimate_ms - START_MS)
            assert abs(verdict.estimate.east_mm - here[0]) < 1_000


@pytest.mark.parametrize("claims_at", ["between", "before", "after"])
def test_claims_that_no_round_sees_are_not_taken_on_trust(world, now_ms, claims_at):
    """True at the rounds and 7.5 m off between them: the claims come when no frame does."""
    evidence = world.evidence(beside(HERE, lambda t: 0.0), beside(HERE, lambda t: 0.0), rounds=20)
    first, last = evidence.ranges.t_ms[0], evidence.ranges.t_ms[-1]
    lies = {
        "between": [t_ms + part for t_ms in evidence.ranges.t_ms[:-1] for part in (25,)],
        "before": [first - 10 * number for number in range(20, 5, -1)],
        "after": [last + 10 * number for number in range(5, 20)],
    }[claims_at]
    said = [(t_ms, HERE) for t_ms in evidence.ranges.t_ms]
    said += [(t_ms, (HERE[0] + EAST, HERE[1], HERE[2])) for t_ms in lies]
    fields = {**evidence.to_json(), "claims": [world.claim(place, t_ms).to_json() for t_ms, place in sorted(said)]}
    verdict = preview(world.session(world.claim(HERE, START_MS)), world.commissioning, Evidence.parse(fields), now_ms)
    assert verdict.outcome == "inconclusive"
    assert codes(verdict) & {"claims_unseen", "claims_torn", "claims_waver"}


def test_at_the_papers_pad_lies_hide_in_the_noise_and_are_not_verified(make_world, now_ms):
    """No range is a burst there: 2.5 m across the line of sight change each range by centimetres."""
    for seed in range(12):
        world = make_world(seed=seed, anchors=PAPERS, sigma_mm=30, bias_sigma_mm=2)
        assert judged(world, lambda t: FAR, to_and_fro, now_ms, rounds=160).outcome != "verified"
        assert judged(world, lambda t: FAR, lambda t: FAR, now_ms, rounds=160).outcome == "verified"


@pytest.mark.parametrize("start_ms", [400, 900, 1_500, 2_100])
@pytest.mark.parametrize("off_mm", [2_000.0, 4_000.0, 12_000.0])
def test_a_glitch_of_the_receiver_convicts_nobody_and_moves_no_place(world, now_ms, start_ms, off_mm):
    truth = beside(HERE, lambda t: 0.0)
    claimed = beside(HERE, lambda t: off_mm if start_ms <= t < start_ms + 400 else 0.0)
    for rounds in (10, 14, 20, 29, 40, 60):
        verdict = judged(world, truth, claimed, now_ms, rounds=rounds)
        assert verdict.outcome != "refuted", rounds
        if verdict.outcome == "verified":
            assert abs(verdict.estimate.east_mm - HERE[0]) < 200, rounds


def test_a_claim_that_jumped_and_stays_off_is_refuted(world, now_ms):
    claimed = beside(HERE, lambda t: 4_000.0 if t > 700 else 0.0)
    assert judged(world, beside(HERE, lambda t: 0.0), claimed, now_ms, rounds=60).outcome == "refuted"


@pytest.mark.parametrize("flight", ["straight", "turning", "braking"])
def test_honest_flights_are_verified_as_soon_as_one_that_hovers(world, now_ms, flight):
    path = {
        "straight": lambda t: (HERE[0] + 4.0 * (t - 900), HERE[1], HERE[2]),
        "turning": lambda t: (HERE[0] + 3.0 * (t - 900), HERE[1] + 0.002 * (t - 900) ** 2, HERE[2]),
        "braking": lambda t: (HERE[0] + 4.0 * (t - 900) - 0.002 * (t - 900) ** 2, HERE[1], HERE[2]),
    }[flight]
    verdict = judged(world, path, path, now_ms, rounds=14)
    assert verdict.outcome == "verified"
    assert not codes(verdict) & {"claims_torn", "claims_unseen", "claims_waver"}


def test_where_the_drone_asked_from_is_said_to_be_unjudged(world, now_ms):
    """Asked at the pad's middle, ranged ten metres away: what is verified is the second."""
    truth = beside((8_000.0, 6_000.0, 4_000.0), lambda t: 0.0)
    verdict = judged(world, truth, truth, now_ms, asked=lambda t: (0.0, 0.0, 4_000.0))
    assert verdict.outcome == "verified"
    assert "request_unjudged" in codes(verdict)
    assert abs(verdict.signed.claim.east_mm - 8_000) < 20
    near = judged(world, truth, truth, now_ms)
    assert "request_unjudged" not in codes(near)


def test_the_requests_claim_takes_no_part_in_the_place(world, now_ms):
    truth = beside(HERE, lambda t: 0.0)
    verdict = judged(world, truth, truth, now_ms, rounds=10, asked=lambda t: (HERE[0] + 30_000, HERE[1], HERE[2]))
    assert abs(verdict.signed.claim.east_mm - HERE[0]) < 20
    assert abs(verdict.estimate.east_mm - HERE[0]) < 100


def test_one_anchors_bursts_tear_no_round(world, now_ms):
    evidence = world.evidence(beside(HERE, lambda t: 0.0), beside(HERE, lambda t: 0.0), rounds=40)
    fields = evidence.to_json()
    ranges = fields["ranges"]["anchors"][2]["range_mm"]
    ranges[::3] = [value + 2_000 for value in ranges[::3]]
    verdict = preview(world.session(world.claim(HERE, START_MS)), world.commissioning, Evidence.parse(fields), now_ms)
    assert verdict.outcome == "verified"
    assert "bursts" in codes(verdict)
    assert "claims_torn" not in codes(verdict)


@pytest.mark.parametrize("seed", range(4))
def test_rounds_before_the_first_claim_of_the_session_are_judged_by_the_flight_there(make_world, now_ms, seed):
    """The first claims were lost on the air; held at the first that came, a drone in flight would be blamed."""
    world = make_world(seed=seed)
    flown = lambda t: (HERE[0] + 3.0 * (t - 900), HERE[1], HERE[2])  # noqa: E731
    evidence = world.evidence(flown, flown, rounds=24)
    late = dataclasses.replace(evidence, claims=tuple(one for one in evidence.claims if one.t_ms > START_MS + 1_200))
    verdict = preview(world.session(world.claim(flown(0), START_MS)), world.commissioning, late, now_ms)
    assert verdict.outcome == "verified"
    assert abs(verdict.estimate.east_mm - flown(verdict.estimate_ms - START_MS)[0]) < 150


@pytest.mark.parametrize(("chunk", "row", "rounds"), [(22, 44, 42), (89, 63, 12)])
def test_a_drone_that_passes_the_pad_is_seen_from_all_sides(chunk, row, rounds):
    """Two of 100,000 tries once won: directions to the mean place say nothing of a drone that flies over a small pad."""
    attack = ATTACKS["mixed-claims-small-pad"]
    rng = np.random.default_rng((1, int.from_bytes(attack.name.encode(), "big"), 0, chunk))
    batch = attack.variants[0].make(rng, 1_000)
    assert verdict_of(batch, row, rounds).permission == "refused"


def mirrored_session(world, rounds, *, silent, lies=lambda t: t // 150 % 2 == 1, heard=3):
    """Truth and mirror image in turn, three rounds each; anchors A1 and A2 cannot tell one from the other."""
    anchors = world.commissioning.anchors
    one, other = anchors[0], anchors[1]
    east, north = other.east_mm - one.east_mm, other.north_mm - one.north_mm
    length = math.hypot(east, north)
    unit = (-north / length, east / length)
    truth = (one.east_mm + 2_000 * unit[0] + 500, one.north_mm + 2_000 * unit[1] + 500, 4_000)
    over = (truth[0] - one.east_mm) * unit[0] + (truth[1] - one.north_mm) * unit[1]
    image = (truth[0] - 2 * over * unit[0], truth[1] - 2 * over * unit[1], truth[2])
    evidence = world.evidence(lambda t: truth, lambda t: image if lies(t) else truth, rounds=rounds)
    fields = evidence.to_json()
    times = fields["ranges"]["t_ms"]
    if silent:
        for column in fields["ranges"]["anchors"][heard:]:
            column["range_mm"] = [
                -1 if lies(t - START_MS) else v for t, v in zip(times, column["range_mm"], strict=True)
            ]
    return truth, Evidence.parse(fields)


@pytest.mark.parametrize("rounds", [20, 60, 160])
def test_the_mirror_image_behind_two_anchors_certifies_nothing_while_the_others_are_silent(world, now_ms, rounds):
    truth, evidence = mirrored_session(world, rounds, silent=True)
    verdict = preview(world.session(world.claim(truth, START_MS)), world.commissioning, evidence, now_ms)
    assert verdict.permission == "refused"
    assert codes(verdict) & {"rounds_vague", "claims_unseen", "rounds_missing", "claims_torn"}


@pytest.mark.parametrize("heard", [2, 3])
@pytest.mark.parametrize(
    "lies",
    [lambda t: t < 500 + 50 * 25, lambda t: t < 500 + 50 * 37, lambda t: t >= 500 + 50 * 43],
    ids=["a third, first", "nearly half, first", "nearly half, last"],
)
def test_claims_during_rounds_that_do_not_count_are_judged_all_the_same(world, now_ms, lies, heard):
    """All lies in a row, at the session's beginning or end, where too few are heard to contradict them."""
    truth, evidence = mirrored_session(world, 80, silent=True, lies=lies, heard=heard)
    verdict = preview(world.session(world.claim(truth, START_MS)), world.commissioning, evidence, now_ms)
    assert verdict.outcome != "refuted"
    assert verdict.permission == "refused"
    assert codes(verdict) & {"claims_unseen", "claims_torn"}


@pytest.mark.parametrize("name", [name for name in ATTACKS if name.startswith("mirrored-")])
def test_mirrored_claims_win_nothing_in_the_lab(name):
    """A stranger won 158 of 200 with the first, 78 of 100 with the second."""
    for number, variant in enumerate(ATTACKS[name].variants):
        batch = variant.make(np.random.default_rng(number), 40)
        assert run_batch(batch, sample=0).won == 0


def test_the_place_is_that_of_one_moment(world, now_ms):
    """A drone that circles: the middle of its way is no place where it was."""
    flown = lambda t: (5_000 + 4_000 * math.cos(t / 1_000), 5_000 + 4_000 * math.sin(t / 1_000), 4_000)  # noqa: E731
    verdict = judged(world, flown, flown, now_ms, rounds=120)
    assert verdict.outcome == "verified"
    at = flown(verdict.estimate_ms - START_MS)
    assert math.hypot(verdict.estimate.east_mm - at[0], verdict.estimate.north_mm - at[1]) < 200
    assert math.hypot(verdict.signed.claim.east_mm - at[0], verdict.signed.claim.north_mm - at[1]) < 200


def test_rounds_that_repeat_one_another_count_as_few(world, now_ms):
    evidence = world.evidence(beside(HERE, lambda t: 0.0), beside(HERE, lambda t: 0.0), rounds=60)
    fields = evidence.to_json()
    for column in fields["ranges"]["anchors"]:
        column["range_mm"] = [column["range_mm"][0]] * 60
    session = world.session(world.claim(HERE, START_MS))
    stuck = preview(session, world.commissioning, Evidence.parse(fields), now_ms)
    moving = preview(session, world.commissioning, evidence, now_ms)
    assert stuck.covariance.nn_mm2 > 1.5 * moving.covariance.nn_mm2


@pytest.mark.parametrize("raised", ["between", "after"])
def test_claims_of_another_height_are_seen(world, now_ms, raised):
    evidence = world.evidence(beside(HERE, lambda t: 0.0), beside(HERE, lambda t: 0.0), rounds=40)
    times = evidence.ranges.t_ms
    chosen = [t + 25 for t in times[:-1]] if raised == "between" else [times[-1] + 100 + 5 * k for k in range(60)]
    high = [world.claim((HERE[0], HERE[1], HERE[2] + 40_000), t) for t in chosen]
    claims = sorted([*evidence.claims, *high], key=lambda claim: claim.t_ms)
    evidence = dataclasses.replace(evidence, claims=tuple(claims))
    verdict = preview(world.session(world.claim(HERE, START_MS)), world.commissioning, evidence, now_ms)
    assert verdict.permission == "refused"
    assert "claims_unseen" in codes(verdict)


def test_claims_of_other_times_are_said_to_be_unjudged(world, now_ms):
    evidence = world.evidence(beside(HERE, lambda t: 0.0), beside(HERE, lambda t: 0.0), rounds=40)
    late = [
        world.claim((HERE[0] + 60_000, HERE[1], HERE[2]), evidence.ranges.t_ms[-1] + 600 + 20 * k) for k in range(9)
    ]
    evidence = dataclasses.replace(evidence, claims=(*evidence.claims, *late))
    verdict = preview(world.session(world.claim(HERE, START_MS)), world.commissioning, evidence, now_ms)
    assert "claims_unjudged" in codes(verdict)


@pytest.mark.parametrize("lasts_ms", [300, 600, 900, 1_200])
def test_a_glitch_that_begins_while_it_is_ranged_refutes_no_honest_drone(world, now_ms, lasts_ms):
    for flight in (0.0, 3.0):
        flown = lambda t, v=flight: (HERE[0] + v * (t - 900), HERE[1], HERE[2])  # noqa: E731
        glitch = lambda t, f=flown: (f(t)[0], f(t)[1] + (5_000 if 900 <= t < 900 + lasts_ms else 0), f(t)[2])  # noqa: E731
        for rounds in (10, 14, 20, 24, 30):
            assert judged(world, flown, glitch, now_ms, rounds=rounds).outcome != "refuted"


@pytest.mark.parametrize("rounds", [37, 45, 57])
def test_the_place_is_never_taken_beside_a_torn_round(make_world, now_ms, rounds):
    """There the claim is on its way to a lie, or back: too small for a burst, and yet more than a buffer off."""
    middle = 500 + 25 * (rounds - 1)
    granted = 0
    for seed in range(12):
        world = make_world(seed=seed, anchors=PAPERS, sigma_mm=20, bias_sigma_mm=2)
        claimed = lambda t: (  # noqa: E731
            (FAR[0] - 885.0, FAR[1] + 2_657.0, FAR[2]) if abs(t - middle) < 150 else FAR
        )
        verdict = judged(world, lambda t: FAR, claimed, now_ms, rounds=rounds)
        granted += verdict.permission == "granted"
        assert math.hypot(verdict.signed.claim.east_mm - FAR[0], verdict.signed.claim.north_mm - FAR[1]) < 500
        assert math.hypot(verdict.estimate.east_mm - FAR[0], verdict.estimate.north_mm - FAR[1]) < 600
    assert granted, "a glitch as short as that costs no honest drone its permission"
