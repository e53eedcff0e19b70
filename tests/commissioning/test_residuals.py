"""A pad learns from verified sessions whether it still measures as it was commissioned."""

from __future__ import annotations

import dataclasses
import json
import math
import random

import pytest
from kit.proof_world import START_MS, World

from wonderland.proofs.verdict import preview
from wonderland_edge_agent.drift import BaselineError
from wonderland_edge_agent.drift.keeper import DriftKeeper
from wonderland_edge_agent.drift.residuals import ResidualWatch, stated_mm

SHA = "a" * 64
BIAS_MM = 8


def session(number, drift_mm=(0, 0, 0, 0), *, lie_mm=0.0, added_mm=None):
    """A verdict on a drone at a place of its own, at a pad whose anchors are biased as stated, and drifted."""
    rng = random.Random(number)
    world = World(seed=number, bias_sigma_mm=BIAS_MM)
    angle, away = rng.uniform(0, math.tau), rng.uniform(3_000, 8_000)
    place = (away * math.cos(angle), away * math.sin(angle), 3_000.0)
    claimed = (place[0] + lie_mm, place[1], place[2])
    bias = [rng.gauss(0, math.hypot(BIAS_MM, 3)) + drift for drift in drift_mm]
    evidence = world.evidence(lambda t: place, lambda t: claimed, rounds=20, bias_mm=bias)
    evidence = dataclasses.replace(evidence, drift_sigma_mm=added_mm)
    verdict = preview(world.session(world.claim(claimed, START_MS)), world.commissioning, evidence, START_MS + 20_000)
    return verdict, world.commissioning


def test_a_pad_that_measures_as_commissioned_raises_no_alarm():
    watch = ResidualWatch()
    counted = 0
    for number in range(300):
        verdict, commissioning = session(number)
        counted += watch.take_verdict(verdict, commissioning, 0)
        assert watch.extra_sigma_mm(commissioning) == 0
    assert counted > 280


def sessions_until_noticed(drift_mm, most):
    watch = ResidualWatch()
    for number in range(most):
        verdict, commissioning = session(1_000 + number, drift_mm)
        watch.take_verdict(verdict, commissioning, 0)
        if watch.alarmed:
            return number + 1, watch.extra_sigma_mm(commissioning)
    pytest.fail(f"not noticed in {most} sessions")


@pytest.mark.parametrize("anchor", range(4))
@pytest.mark.parametrize(("off_mm", "most"), [(50, 40), (100, 15), (300, 10)])
def test_an_anchor_whose_ranges_drift_is_noticed(anchor, off_mm, most):
    drift = tuple(off_mm if index == anchor else 0 for index in range(4))
    sessions, extra_mm = sessions_until_noticed(drift, most)
    assert sessions >= 3, "no single session tells"
    assert 8 <= extra_mm <= 60


def test_what_was_added_is_not_mistaken_for_a_recovery():
    watch = ResidualWatch()
    added = 0
    for number in range(60):
        verdict, commissioning = session(2_000 + number, (100, 0, 0, 0), added_mm=added or None)
        watch.take_verdict(verdict, commissioning, added)
        added = watch.extra_sigma_mm(commissioning)
    assert watch.alarmed
    assert 8 <= added <= 60


def test_good_sessions_end_an_alarm():
    watch = ResidualWatch(evidence=12.0, chi2=60.0, freedom=12, since_ms=1)
    for number in range(60):
        added = watch.extra_sigma_mm(World(bias_sigma_mm=BIAS_MM).commissioning)
        verdict, commissioning = session(3_000 + number, added_mm=added or None)
        watch.take_verdict(verdict, commissioning, added)
    assert not watch.alarmed


def test_only_verified_sessions_count():
    watch = ResidualWatch()
    for number in range(20):
        verdict, commissioning = session(number, (0, 0, 0, 0), lie_mm=4_000.0)
        assert verdict.outcome == "refuted"
        assert not watch.take_verdict(verdict, commissioning, 0)
    assert watch == ResidualWatch()


def test_it_survives_a_restart_and_belongs_to_its_commissioning(tmp_path):
    path = tmp_path / "residuals.json"
    watch = ResidualWatch(evidence=3.5, chi2=40.0, freedom=10, since_ms=START_MS)
    watch.save(path, SHA)
    assert ResidualWatch.load(path, SHA) == watch
    assert ResidualWatch.load(path, "b" * 64) == ResidualWatch()
    assert ResidualWatch.load(tmp_path / "none", SHA) == ResidualWatch()


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{", '{"commissioning_sha256": "%s"}' % SHA]  # noqa: UP031 - braces
    + [
        json.dumps({"commissioning_sha256": SHA, "evidence": 1, "chi2": 1, "freedom": 1, "since_ms": 0, **wrong})
        for wrong in ({"evidence": "x"}, {"chi2": -1}, {"freedom": [1]}, {"evidence": float("nan")})
    ],
)
def test_files_that_are_none_are_refused(tmp_path, text):
    path = tmp_path / "residuals.json"
    path.write_text(text)
    with pytest.raises(BaselineError):
        ResidualWatch.load(path, SHA)


class NoRadios:
    async def measure_between(self, macs, rounds, channel):
        return {}


def test_the_keeper_says_so_in_evidence_and_health(tmp_path):
    keeper = DriftKeeper(NoRadios(), tmp_path / "anchors.json", lambda: START_MS, 600)
    commissioning = World(bias_sigma_mm=BIAS_MM).commissioning
    keeper.load(SHA, commissioning)
    assert keeper.state is None
    for number in range(30):
        added = keeper.extra_sigma_mm(SHA)
        verdict, _ = session(1_000 + number, (100, 0, 0, 0), added_mm=added)
        keeper.decided(verdict, SHA, commissioning, added)
    extra = keeper.extra_sigma_mm(SHA)
    assert 8 <= extra <= 60
    assert keeper.state.health().state == "drifting"
    assert keeper.state.health().extra_sigma_mm == extra
    assert not keeper.moved(SHA)
    again = DriftKeeper(NoRadios(), tmp_path / "anchors.json", lambda: START_MS, 600)
    again.load(SHA, commissioning)
    assert again.extra_sigma_mm(SHA) == extra
    assert again.extra_sigma_mm("b" * 64) is None
    # Commissioned anew, it learns anew.
    again.load("b" * 64, commissioning)
    assert again.extra_sigma_mm("b" * 64) is None


def test_what_a_commissioning_states_is_bias_and_survey_together():
    assert stated_mm(World(bias_sigma_mm=4).commissioning) == pytest.approx(5.0)
