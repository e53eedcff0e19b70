"""A commissioning that serves worse than none is not used, and the operator is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wonderland_edge_agent.commissioning.choice import Judged, _better, fit_best
from wonderland_edge_agent.commissioning.fit import fit_runs
from wonderland_edge_agent.commissioning.survey_files import NOWHERE


def judged(basis, verified, windows=40, *, refuted=0, lies_verified=0):
    rest = windows - verified - refuted
    return Judged(
        basis, ("verified",) * verified + ("refuted",) * refuted + ("inconclusive",) * rest, lies_verified, 80
    )


def test_a_good_run_is_used_as_it_was_fitted(good_run, fitted):
    choice = fit_best([good_run], fitted)
    assert choice.fit is fitted
    by_basis = {one.basis: one for one in choice.judged}
    assert by_basis["fitted"].verified > by_basis["prior"].verified + 10
    assert all(one.wrong == 0 for one in choice.judged)
    assert "the fitted table" in choice.sentence()
    assert choice.document()["basis"] == "fitted"


def test_the_prior_is_what_a_pad_has_that_nobody_calibrated(fitted):
    record = fitted.on_basis("prior").commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)
    assert {point.sigma_mm for anchor in record.anchors for point in anchor.bias if point.range_mm > 5_000} == {45}
    assert (record.installation_sigma_mm, record.range_sigma_mm, record.correlation_ppm) == (60, 40, None)
    assert "not calibrated" in record.method


def test_a_fit_that_is_vaguer_than_the_prior_is_not_used(good_run, fitted, monkeypatch):
    """Whatever made it so: the held-out windows tell."""
    monkeypatch.setattr("wonderland_edge_agent.commissioning.choice.refit", lambda *_: vague)
    sigma = np.full_like(fitted.spread.bias_sigma_m, 0.19)
    vague = replace(fitted, spread=replace(fitted.spread, bias_sigma_m=sigma))
    choice = fit_best([good_run], vague)
    assert choice.fit.basis == "prior"
    assert "prior_better" in {note.code for note in choice.fit.warnings}


def test_what_is_better():
    assert _better(judged("prior", 20), judged("fitted", 6))
    assert not _better(judged("prior", 7), judged("fitted", 6))
    assert not _better(judged("prior", 6), judged("fitted", 20))
    assert not _better(judged("prior", 30, lies_verified=1), judged("fitted", 6))
    assert _better(judged("prior", 6), judged("fitted", 20, refuted=1))


def test_the_choice_is_told(monkeypatch, fitted):
    rows = [judged("fitted", 6, 33), judged("halfway", 15, 33), judged("prior", 20, 33)]
    monkeypatch.setattr("wonderland_edge_agent.commissioning.choice._judge", lambda *_: iter(rows))
    choice = fit_best([], fitted)
    assert choice.fit.basis == "prior"
    (text,) = [note.text for note in choice.fit.warnings if note.code == "prior_better"]
    assert "the chip's prior verifies 20 of 33" in text
    assert "the fitted table 6" in text
    assert [point.bias_mm for point in choice.fit.table(0)] == [point.bias_mm for point in choice.fit.table(1)]


def test_a_run_too_short_to_hold_anything_out_is_used_as_it_is(make_world):
    run = make_world().run(25.0)
    fit = fit_runs([run])
    choice = fit_best([run], fit)
    assert choice.fit is fit
    assert choice.sentence() == ""


@pytest.mark.parametrize("basis", ["halfway", "prior"])
def test_between_the_fit_and_the_prior(fitted, basis):
    other = fitted.on_basis(basis)
    low = np.minimum(fitted.spread.bias_sigma_m, 0.045)
    assert np.all(other.spread.bias_sigma_m >= low)
    assert np.all(other.spread.bias_sigma_m <= 0.045 + 1e-9)
    assert other.on_basis(basis) is other
