"""How a session's likelihood went: the last point is the verdict, those before it are what was known by then."""

from __future__ import annotations

import math
import statistics
from dataclasses import replace

import pytest
from kit.proof_world import START_MS, World

from wonderland.proofs.records.sessions import NO_RANGE
from wonderland.proofs.records.verdicts import BroadcastFinding
from wonderland.proofs.verdict import decide
from wonderland_backend.sessions.course import course_of
from wonderland_backend.sessions.residuals import residuals

THERE = (3_000, 4_000, 3_000)


def decided(truth, claimed, rounds=60, **more):
    """A session with its commissioning, evidence and verdict."""
    world = World(seed=5)
    world.share_a_clock()
    session = world.session(world.claim(claimed, START_MS), min_assurance=2)
    evidence = world.evidence(lambda t: truth, lambda t: claimed, rounds=rounds, uav_signature="A" * 86, **more)
    evidence = replace(evidence, time_stamps=world.stamps(lambda t: truth, frames=40))
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
    return session, world.commissioning, evidence, verdict


@pytest.mark.parametrize(
    ("claimed", "outcome"), [(THERE, "verified"), ((6_000, 4_000, 3_000), "refuted"), ((4_000, 4_000, 3_000), None)]
)
def test_it_ends_in_the_verdict_and_begins_in_doubt(claimed, outcome):
    session, commissioning, evidence, verdict = decided(THERE, claimed)
    points = course_of(session, commissioning, evidence, verdict)
    rounds = [point["rounds"] for point in points]
    assert (rounds[0], rounds[-1]) == (1, 60)
    assert rounds == sorted(set(rounds))
    assert points[-1]["outcome"] == verdict.outcome
    assert points[-1]["signed"]["likelihood_ppm"] == verdict.signed.likelihood_ppm
    assert all(point["outcome"] == "inconclusive" for point in points[:3]), "a few rounds decide nothing"
    if outcome is not None:
        assert verdict.outcome == outcome
        settled = [point["outcome"] for point in points]
        assert settled[settled.index(outcome) :] == [outcome] * (len(settled) - settled.index(outcome))


def test_what_came_later_changes_nothing_that_was_known_before():
    session, commissioning, evidence, verdict = decided(THERE, THERE)
    table = evidence.ranges
    anchors = tuple(replace(each, range_mm=each.range_mm[:30]) for each in table.anchors)
    shorter = replace(evidence, ranges=replace(table, t_ms=table.t_ms[:30], anchors=anchors))
    early = course_of(session, commissioning, shorter, verdict)[:-1]
    assert early[-1]["rounds"] == 29
    assert course_of(session, commissioning, evidence, verdict)[: len(early)] == early


@pytest.mark.parametrize(
    ("outcome", "told"), [("own_contradicted", True), ("supported", True), ("contradicted", False)]
)
def test_what_somebody_else_may_have_sent_has_no_course(outcome, told):
    session, _, evidence, verdict = decided(THERE, THERE)
    heard = BroadcastFinding(
        outcome=outcome, messages=2, attributed=0, supported=True, error_mm=36_000, likelihood_ppm=0, tolerance_mm=2_000
    )
    (point,) = course_of(session, None, evidence, replace(verdict, broadcast=heard))
    assert ("broadcast" in point) == told


def test_a_session_without_a_range_has_no_course():
    session, commissioning, evidence, verdict = decided(THERE, THERE, rounds=0)
    assert course_of(session, commissioning, evidence, verdict) == []


@pytest.mark.parametrize("claimed", [THERE, (6_000, 4_000, 3_000)])
def test_residuals_show_a_lie_against_the_claim_and_none_against_the_estimate(claimed):
    session, commissioning, evidence, verdict = decided(THERE, claimed)
    rows = residuals(session, commissioning, evidence, verdict)
    assert [row["anchor_id"] for row in rows] == ["A0", "A1", "A2", "A3"]
    for row, anchor in zip(rows, commissioning.anchors, strict=True):
        assert row["t_ms"] == list(evidence.ranges.t_ms)
        place = (anchor.east_mm, anchor.north_mm, anchor.up_mm)
        lie_mm = math.dist(THERE, place) - math.dist(claimed, place)
        assert statistics.mean(row["claim_mm"]) == pytest.approx(lie_mm, abs=20)
        assert statistics.mean(row["estimate_mm"]) == pytest.approx(0, abs=20)
        assert statistics.stdev(row["estimate_mm"]) < 1.5 * row["sigma_mm"] < 60


def test_a_range_that_is_missing_or_obstructed_has_no_residual():
    session, commissioning, evidence, verdict = decided(THERE, THERE)
    first, *others = evidence.ranges.anchors
    holed = replace(first, range_mm=(NO_RANGE, *first.range_mm[1:]), nlos=(7,))
    with_holes = replace(evidence, ranges=replace(evidence.ranges, anchors=(holed, *others)))
    (row, *whole) = residuals(session, commissioning, with_holes, verdict)
    times = evidence.ranges.t_ms
    assert row["t_ms"] == [t_ms for t_ms in times if t_ms not in (times[0], times[7])]
    assert len(row["claim_mm"]) == len(row["estimate_mm"]) == len(times) - 2
    assert all(len(each["claim_mm"]) == len(times) for each in whole)


async def test_only_decided_sessions_have_one(running, number):
    assert (await running.get(f"/sessions/{number('nobody')}/course")).status_code == 404
    listed = await running.json("/sessions")
    (open_session,) = [each for each in listed["items"] if each["state"] == "requested"]
    assert (await running.get(f"/sessions/{open_session['session_id']}/course")).status_code == 404
    # These sessions name a survey that their pad never had; nothing is recomputed on another one.
    decided_id = next(each["session_id"] for each in listed["items"] if each["state"] == "completed")
    course = await running.json(f"/sessions/{decided_id}/course")
    assert (course["verify_ppm"], course["refute_ppm"]) == (990_000, 10_000)
    assert [point["outcome"] for point in course["points"]] == ["verified"]
    assert course["residuals"] == []
