"""Whatever a radio, a drone or a survey comes up with: a reason or a typed error, never a verified lie, never a crash."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from kit.proof_world import START_MS, World

from wonderland.proofs.errors import RecordError
from wonderland.proofs.prospects import hopeless, prospect
from wonderland.proofs.records.pads import BiasPoint
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.sessions import AnchorRanges, ClockReading, Evidence, RangeTable
from wonderland.proofs.records.verdicts import Verdict
from wonderland.proofs.verdict import preview

HERE = (3000.0, 6000.0, 4000.0)
NOW_MS = START_MS + 20_000
COORDINATE = st.integers(-20_000, 20_000) | st.sampled_from([0, 1, -1, 1000])


def judged(world, evidence, claimed=HERE, **claim):
    session = world.session(world.claim(claimed, START_MS, **claim))
    verdict = preview(session, world.commissioning, evidence, NOW_MS)
    assert Verdict.parse(verdict.to_json()) == verdict
    assert verdict.outcome == "verified" or verdict.reasons
    return verdict


def table(world, columns, times=None):
    count = len(columns[0])
    return RangeTable(
        t_ms=tuple(START_MS + 500 + 50 * i for i in range(count)) if times is None else tuple(times),
        anchors=tuple(
            AnchorRanges(anchor_id=anchor.anchor_id, range_mm=tuple(column))
            for anchor, column in zip(world.commissioning.anchors, columns, strict=True)
        ),
    )


@pytest.mark.parametrize("value", [0, -1, 1, 1_000_000, 90_000])
def test_the_same_impossible_range_of_every_anchor(world, value):
    evidence = world.evidence(lambda t: HERE, lambda t: HERE)
    evidence = dataclasses.replace(evidence, ranges=table(world, [[value] * 40] * 4))
    assert judged(world, evidence).outcome != "verified"


@given(
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=3, max_size=16),
    st.tuples(COORDINATE, COORDINATE),
    st.tuples(COORDINATE, COORDINATE),
)
@example([(1, 292), (293, -1), (293, -1), (293, -1)], (405, -1), (-287, 0))  # above the anchors no bell holds
@settings(deadline=None, max_examples=150)
def test_anchors_anywhere_never_verify_a_lie(anchors, truth, lie):
    """Coincident, collinear, on top of the drone: three metres off is never verified."""
    world = World(seed=2, anchors=anchors)
    here, said = (*truth, 4000), (truth[0] + lie[0], truth[1] + lie[1], 4000)
    verdict = judged(world, world.evidence(lambda t: here, lambda t: said, rounds=12, bias_mm=[0] * 16), said)
    if math.hypot(*lie) >= 3000:
        assert verdict.outcome != "verified"
    if math.hypot(*lie) <= 500:
        assert verdict.outcome != "refuted"


@pytest.mark.parametrize(
    "anchors",
    [((0, 0),) * 4, ((0, 0), (0, 0), (3000, 0), (3000, 0)), ((0, 0), (1000, 0), (2000, 0), (3000, 0))],
)
def test_anchors_without_an_area_verify_nothing(make_world, anchors):
    world = make_world(anchors=anchors)
    for claimed in (HERE, (3000.0, -6000.0, 4000.0)):
        verdict = judged(world, world.evidence(lambda t: HERE, lambda t, p=claimed: p), claimed)
        assert verdict.outcome == "inconclusive"


@given(st.data())
@settings(deadline=None, max_examples=100)
def test_any_times_and_ranges(data):
    world = World(seed=3)
    count = data.draw(st.integers(1, 40))
    times = data.draw(st.lists(st.integers(0, 2**43), min_size=count, max_size=count))
    near = st.integers(-1, 1_000_000) | st.integers(5_000, 9_000)
    columns = [data.draw(st.lists(near, min_size=count, max_size=count)) for _ in range(4)]
    evidence = world.evidence(lambda t: HERE, lambda t: HERE)
    judged(world, dataclasses.replace(evidence, ranges=table(world, columns, times)))


@given(st.integers(1, 10_000_000), st.integers(1, 10_000_000), st.integers(-9_000, 9_000), st.integers(-9_000, 9_000))
@settings(deadline=None, max_examples=100)
def test_no_claimed_accuracy_buys_acceptance(accuracy, height_accuracy, east, north):
    world = World(seed=4)
    claimed = (HERE[0] + east, HERE[1] + north, HERE[2])
    evidence = world.evidence(lambda t: HERE, lambda t: claimed, rounds=20)
    vague = {"accuracy_mm": accuracy, "height_accuracy_mm": height_accuracy}
    evidence = dataclasses.replace(evidence, claims=tuple(dataclasses.replace(c, **vague) for c in evidence.claims))
    verdict = judged(world, evidence, claimed, **vague)
    if math.hypot(east, north) >= 2000:
        assert verdict.outcome != "verified"


def test_an_anchor_that_is_silent_throughout_and_one_that_repeats_itself(world):
    evidence = world.evidence(lambda t: HERE, lambda t: HERE)
    columns = [list(anchor.range_mm) for anchor in evidence.ranges.anchors]
    silent = judged(world, dataclasses.replace(evidence, ranges=table(world, [*columns[:3], [-1] * 40])))
    assert {"anchor_silent", "unchecked"} <= {reason.code for reason in silent.reasons}
    assert silent.outcome != "verified"
    # One value again and again is what a stuck node sends; its neighbour's range is what a wrong table gives.
    stuck = judged(world, dataclasses.replace(evidence, ranges=table(world, [*columns[:3], columns[1]])), HERE)
    assert "ranges_inconsistent" in {reason.code for reason in stuck.reasons}


def test_claims_at_one_moment_and_claims_that_never_move(world):
    evidence = world.evidence(lambda t: HERE, lambda t: HERE)
    one = dataclasses.replace(evidence.claims[0], t_ms=START_MS + 1000)
    verdict = judged(world, dataclasses.replace(evidence, claims=(one,) * 50))
    assert verdict.outcome == "verified"
    stranger = world.claim((HERE[0] + 40_000, HERE[1], HERE[2]), one.t_ms)
    verdict = judged(world, dataclasses.replace(evidence, claims=(one, stranger)))
    assert verdict.outcome != "verified"
    assert "claims_jump" in {reason.code for reason in verdict.reasons}


def test_a_bias_table_that_is_unsure_decides_nothing(make_world):
    world = make_world()
    anchors = tuple(
        dataclasses.replace(anchor, bias=(BiasPoint(range_mm=0, bias_mm=0, sigma_mm=5000),))
        for anchor in world.commissioning.anchors
    )
    world.commissioning = dataclasses.replace(world.commissioning, anchors=anchors)
    for claimed in (HERE, (HERE[0] + 5000, HERE[1], HERE[2])):
        verdict = judged(world, world.evidence(lambda t: HERE, lambda t, p=claimed: p), claimed)
        assert (verdict.outcome, verdict.more_rounds) == ("inconclusive", -1)
        assert "cannot_settle" in {reason.code for reason in verdict.reasons}


def test_prospects_before_ranging(make_world):
    near = prospect(make_world().commissioning, Policy(), 3000, 6000, 4000)
    far = prospect(make_world(sigma_mm=50).commissioning, Policy(), 3000, 14_000, 4000)
    hopeless = prospect(make_world(bias_sigma_mm=200).commissioning, Policy(), 3000, 14_000, 4000)
    assert 1 <= near.rounds <= far.rounds
    assert hopeless.rounds == -1
    assert hopeless.one_round.ellipse().s1 > hopeless.floor.ellipse().s1 > 343
    assert prospect(make_world().commissioning, Policy(), 3_000_000, 0, 0) is None
    line = make_world(anchors=((-1500, 0), (0, 0), (1500, 0))).commissioning
    assert prospect(line, Policy(), 3000, 6000, 4000).rounds == -1


def test_a_correlation_found_in_the_rounds_costs_certainty(make_world):
    world = make_world(sigma_mm=40)
    evidence = world.evidence(lambda t: HERE, lambda t: HERE, rounds=40)
    slow = []
    for anchor in evidence.ranges.anchors:
        values = anchor.range_mm
        mean = sum(values) / len(values)
        # The same spread, but each value lasts four rounds.
        slow.append([round(mean + (values[4 * (i // 4)] - mean)) for i in range(len(values))])
    white = judged(world, evidence).covariance
    lasting = judged(world, dataclasses.replace(evidence, ranges=table(world, slow))).covariance
    assert lasting.ee_mm2 + lasting.nn_mm2 > 2 * (white.ee_mm2 + white.nn_mm2)
    world.commissioning = dataclasses.replace(world.commissioning, correlation_ppm=0)
    known = judged(world, evidence).covariance
    assert known.ee_mm2 + known.nn_mm2 <= white.ee_mm2 + white.nn_mm2


def test_a_clock_that_may_be_off_widens_the_ellipse_along_the_flight(world):
    path = lambda t: (3000 + 5 * t, 6000, 4000)  # noqa: E731
    moving = judged(world, world.evidence(path, path), path(0))
    still = judged(world, world.evidence(lambda t: path(1500), lambda t: path(1500)), path(1500))
    assert moving.covariance.ee_mm2 - still.covariance.ee_mm2 > 200**2
    slow = lambda t: (3000 + 3 * t, 6000, 4000)  # noqa: E731
    late = lambda t: slow(t - 50)  # noqa: E731
    assert judged(world, world.evidence(slow, late), late(0)).outcome == "verified"
    fast_and_late = lambda t: path(t - 50)  # noqa: E731
    assert judged(world, world.evidence(path, fast_and_late), fast_and_late(0)).outcome != "refuted"


def _with_ranges(world, evidence, change):
    columns = [list(anchor.range_mm) for anchor in evidence.ranges.anchors]
    change(columns)
    return dataclasses.replace(evidence, ranges=table(world, columns))


def _set(columns, index, values):
    columns[index][:] = values


def _renamed(evidence):
    anchors = tuple(dataclasses.replace(anchor, anchor_id=f"B{i}") for i, anchor in enumerate(evidence.ranges.anchors))
    return dataclasses.replace(evidence, ranges=dataclasses.replace(evidence.ranges, anchors=anchors))


def _backwards(world, evidence):
    columns = [list(anchor.range_mm) for anchor in evidence.ranges.anchors]
    return dataclasses.replace(evidence, ranges=table(world, columns, reversed(evidence.ranges.t_ms)))


def _claims(evidence, **fields):
    return dataclasses.replace(
        evidence, claims=tuple(dataclasses.replace(claim, **fields) for claim in evidence.claims)
    )


BAD: dict = {
    "ranges of zero": (lambda w, e: _with_ranges(w, e, lambda c: [_set(c, i, [0] * 40) for i in range(4)]), "too_few"),
    "no ranges": (lambda w, e: _with_ranges(w, e, lambda c: [_set(c, i, [-1] * 40) for i in range(4)]), "too_few"),
    "huge ranges": (
        lambda w, e: _with_ranges(w, e, lambda c: [_set(c, i, [1_000_000] * 40) for i in range(4)]),
        "too_few",
    ),
    "one range of all anchors": (
        lambda w, e: _with_ranges(w, e, lambda c: [_set(c, i, [7_000] * 40) for i in range(4)]),
        "",
    ),
    "one anchor silent": (lambda w, e: _with_ranges(w, e, lambda c: _set(c, 3, [-1] * 40)), "anchor_silent"),
    "other anchors": (lambda w, e: _renamed(e), "anchors_unknown"),
    "rounds that run backwards": (_backwards, "time_goes_back"),
    "claims that run backwards": (lambda w, e: dataclasses.replace(e, claims=e.claims[::-1]), "claims_go_back"),
    "a claim from the other side of the planet": (
        lambda w, e: _claims(e, lat_e7=-604_518_000, lon_e7=-1_577_334_000),
        "claim_far_away",
    ),
    "a claim good to a kilometre": (lambda w, e: _claims(e, accuracy_mm=1_000_000), "claim_vague"),
    "a height good to a kilometre": (lambda w, e: _claims(e, height_accuracy_mm=1_000_000), "claim_height_vague"),
    "rounds of yesterday": (
        lambda w, e: dataclasses.replace(
            e, ranges=table(w, [a.range_mm for a in e.ranges.anchors], [t - 86_400_000 for t in e.ranges.t_ms])
        ),
        "rounds_not_fresh",
    ),
    "nothing at all": (
        lambda w, e: dataclasses.replace(e, ranges=RangeTable(t_ms=(), anchors=()), claims=()),
        "too_few_rounds",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_evidence_is_a_reason_and_verifies_nothing(world, name):
    change, reason = BAD[name]
    verdict = judged(world, change(world, world.evidence(lambda t: HERE, lambda t: HERE)))
    found = {each.code for each in verdict.reasons}
    assert any(code.startswith(reason) for code in found), found
    assert verdict.outcome != "verified"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("range_mm", 1_000_001),
        ("range_mm", -2),
        ("range_mm", 7.5),
        ("range_mm", "NaN"),
        ("range_mm", None),
        ("range_mm", True),
        ("anchor_id", "A0"),
        ("anchor_id", ""),
        ("t_ms", -1),
        ("accuracy_mm", 0),
        ("height_accuracy_mm", 0),
        ("lat_e7", 900_000_001),
        ("ticks", -2),
        ("ticks", 2**24 + 1),
        ("gap_ms", -1),
        ("bound_by", "hope"),
        ("uav_ms", -1),
    ],
)
def test_bad_records_are_refused_by_name(world, field, value):
    """What is no evidence at all never comes as far as a verdict."""
    world.share_a_clock()
    evidence = dataclasses.replace(
        world.evidence(lambda t: HERE, lambda t: HERE),
        time_stamps=world.stamps(lambda t: HERE),
        clock=(ClockReading(uav_ms=1, heard_ms=2, asked_ms=1),),
    )
    document = evidence.to_json()
    Evidence.parse(document)
    places = {
        "range_mm": (document["ranges"]["anchors"][1]["range_mm"], 3),
        "anchor_id": (document["ranges"]["anchors"][1], "anchor_id"),
        "t_ms": (document["ranges"]["t_ms"], 0),
        "accuracy_mm": (document["claims"][2], "accuracy_mm"),
        "height_accuracy_mm": (document["claims"][2], "height_accuracy_mm"),
        "lat_e7": (document["claims"][2], "lat_e7"),
        "ticks": (document["time_stamps"]["anchors"][1]["ticks"], 3),
        "gap_ms": (document["time_stamps"]["gap_ms"], 3),
        "bound_by": (document["time_stamps"], "bound_by"),
        "uav_ms": (document["clock"][0], "uav_ms"),
    }
    where, key = places[field]
    where[key] = value
    with pytest.raises(RecordError, match="anchor" if field == "anchor_id" and value else field):
        Evidence.parse(document)


def test_what_can_never_be_settled_is_told_before_ranging(make_world):
    world = make_world()
    near, far = world.claim(HERE, START_MS), world.claim((3000, 14_000, 4000), START_MS)
    assert hopeless(world.commissioning, Policy(), near) == ""
    assert "biases" in hopeless(make_world(bias_sigma_mm=200).commissioning, Policy(), far)
    assert "reach" in hopeless(world.commissioning, Policy(), world.claim((150_000, 0, 4000), START_MS))
    elsewhere = dataclasses.replace(near, lat_e7=-near.lat_e7)
    assert "nowhere near" in hopeless(world.commissioning, Policy(), elsewhere)
    assert "share no" in hopeless(world.commissioning, Policy(min_assurance=3), near)
    world.share_a_clock()
    # Four anchors have a second place that fits, at another height; with five that is gone.
    assert "time stamps prove too little" in hopeless(world.commissioning, Policy(min_assurance=3), near)
    five = make_world(anchors=((3000, 0), (927, 2853), (-2427, 1763), (-2427, -1763), (927, -2853)))
    five.share_a_clock()
    assert hopeless(five.commissioning, Policy(min_assurance=3), near) == ""
    assert hopeless(five.commissioning, Policy(min_assurance=2), far) == ""
    assert "time stamps prove too little" in hopeless(five.commissioning, Policy(min_assurance=3), far)


@pytest.mark.parametrize("count", [4, 5, 6, 8, 12, 16])
def test_within_r_of_the_pad_wherever_it_is(count):
    """Whatever the number of anchors: two-way ranging proves a distance, not a place, also among them (heights)."""
    corners = [
        (round(6000 * math.cos(2 * math.pi * i / count)), round(6000 * math.sin(2 * math.pi * i / count)))
        for i in range(count)
    ]
    for place in ((500.0, -800.0, 3000.0), (7000.0, 6000.0, 3000.0)):
        world = World(seed=count, anchors=corners)
        evidence = world.evidence(lambda t, p=place: p, lambda t, p=place: p, bias_mm=[0] * count)
        verdict = judged(world, evidence, place)
        assert verdict.outcome == "verified"
        said = {reason.code: reason.facts for reason in verdict.reasons}
        assert "height_proved" in said
        assert verdict.within_mm >= math.hypot(*place)
        assert verdict.within_mm <= math.hypot(*place) + 2 * 6000 + 500
        assert said["upper_bound"] == {"within_mm": verdict.within_mm}
