from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from wonderland.proofs.records.pads import Commissioning
from wonderland.proofs.reduction import bias_at
from wonderland_edge_agent.commissioning.curves import Curves
from wonderland_edge_agent.commissioning.errors import CalibrationError, SurveyError
from wonderland_edge_agent.commissioning.fit import FitSettings, fit_runs
from wonderland_edge_agent.commissioning.run import make_run, windows
from wonderland_edge_agent.commissioning.spread import shrunk, wandered
from wonderland_edge_agent.commissioning.survey_files import NOWHERE


def record_of(fit) -> Commissioning:
    return fit.commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)


def test_the_bias_of_every_anchor_is_found_by_distance(fitted, true_bias):
    for index in range(4):
        for distance in (4.0, 8.0, 12.0, 16.0, 20.0):
            found = np.interp(distance, fitted.curves.knots_m, fitted.curves.bias_m[index])
            assert found == pytest.approx(true_bias(distance, index), abs=0.015)
    assert 0.020 < fitted.spread.range_sigma_m < 0.032
    assert fitted.spread.correlation < 0.3
    assert np.nanmedian(np.abs(fitted.held_m)) < 0.01 < np.nanmedian(np.abs(fitted.windows.error_m))


def test_the_record_says_what_was_found_and_survives_its_encoding(fitted, true_bias):
    record = record_of(fitted)
    assert Commissioning.decode(record.encode()) == record
    for index, anchor in enumerate(record.anchors):
        bias, sigma = bias_at(anchor, 10_000.0)
        assert bias == pytest.approx(1000 * true_bias(10.0, index), abs=15)
        assert 3 <= sigma <= 25
        assert anchor.bias[0].range_mm == 0
        assert anchor.bias[0].sigma_mm > sigma  # nobody was there
    assert record.max_range_mm == pytest.approx(22_000, abs=2_000)
    assert 12 <= record.installation_sigma_mm <= 40  # one run cannot show another day
    assert json.dumps(fitted.document())


def test_what_is_stated_holds_on_a_run_that_was_not_seen(fitted, make_world):
    """The pulls of a second run have the spread that the table states, or less."""
    other = windows((make_world(seed=9).run(),))
    rest = other.error_m - fitted.curves.at(other.distance_m)
    sigma = np.stack(
        [
            np.interp(other.distance_m[:, i], fitted.curves.knots_m, fitted.spread.bias_sigma_m[i])
            for i in range(rest.shape[1])
        ],
        axis=1,
    )
    total = np.sqrt(sigma**2 + fitted.spread.range_sigma_m**2 / other.rounds + fitted.installation_m**2)
    pulls = (rest / total)[np.isfinite(rest)]
    assert np.mean(np.abs(pulls) > 2) < 0.05
    assert np.mean(np.abs(pulls) > 3) < 0.01


def test_what_all_anchors_share_is_the_installations_and_no_anchors_noise(fitted, make_world):
    """An error that all ranges of a second have in common moves the distance and not the bearing."""
    run = make_world().run()
    shared = np.random.default_rng(3).normal(0.0, 0.05, int(run.t_s[-1]) + 1)[run.t_s.astype(int)]
    spread = fit_runs([replace(run, range_m=run.range_m + shared[:, None])]).spread
    assert spread.range_sigma_m == pytest.approx(fitted.spread.range_sigma_m, rel=0.1)
    assert spread.correlation < 0.2
    assert np.median(spread.bias_sigma_m) < 1.2 * np.median(fitted.spread.bias_sigma_m)
    assert 0.04 < spread.installation_m < 0.09


def test_what_changes_with_the_place_is_stated_once(make_world):
    """Reflections of each place: neither noise that more rounds average out and bias again, nor left out."""

    def reflected(seed):
        run = make_world(seed=seed).run(240.0)
        errors = np.random.default_rng(seed).normal(0.0, 0.04, (int(run.t_s[-1]) // 2 + 1, run.range_m.shape[1]))
        return replace(run, range_m=run.range_m + errors[run.t_s.astype(int) // 2])

    fit = fit_runs([reflected(1)])
    other = windows((reflected(2),))
    rest = other.error_m - fit.curves.at(other.distance_m)
    own = (rest - rest.mean(axis=1, keepdims=True)) * np.sqrt(4 / 3)
    bias2 = float(np.median(fit.spread.bias_sigma_m)) ** 2
    worth = (1 - fit.spread.correlation) / (1 + fit.spread.correlation)
    stated = np.sqrt(bias2 + fit.spread.range_sigma_m**2 / (2 * other.rounds * worth))  # sessions of two seconds
    assert 0.9 < stated / np.sqrt(np.nanmean(own**2)) < 1.4


def test_correlated_rounds_are_worth_less(make_world):
    run = make_world(sigma_m=0.05).run(60.0)
    kernel = np.ones(5) / 5  # a node that hands out a moving average
    smooth = np.stack([np.convolve(np.nan_to_num(c, nan=np.nanmean(c)), kernel, "same") for c in run.error_m.T], axis=1)
    filtered = replace(run, range_m=run.distance_m + smooth)
    fit = fit_runs([filtered])
    assert 0.5 < fit.spread.correlation <= 0.9
    worth = (1 - fit.spread.correlation) / (1 + fit.spread.correlation)
    stated = fit.spread.range_sigma_m / math.sqrt(20 * worth)
    assert stated == pytest.approx(0.05 / math.sqrt(20), rel=0.5)  # of a mean over a second, whatever the filter


def test_obstructed_stretches_do_not_bend_the_table(make_world, fitted):
    run = make_world().run()
    range_m = run.range_m.copy()
    range_m[400:520, 2] += 1.5  # six seconds behind a car
    range_m[1000::37, 1] -= 2.0  # and single bursts
    fit = fit_runs([replace(run, range_m=range_m)])
    assert np.max(np.abs(fit.curves.bias_m - _at(fitted.curves, fit.curves.knots_m))) < 0.03
    assert fit.outliers["A2"] > 0.015


def _at(curves: Curves, knots):
    return np.stack([np.interp(knots, curves.knots_m, bias) for bias in curves.bias_m])


def test_a_truth_that_is_late_is_noticed_and_by_how_much(make_world):
    fit = fit_runs([make_world().run(60.0, late_s=0.15)])
    assert fit.shift_s == pytest.approx(0.15, abs=0.03)
    assert "truth_delayed" in {note.code for note in fit.warnings}
    assert "truth_delayed" not in {note.code for note in fit_runs([make_world().run(60.0)]).warnings}


def test_what_differs_between_runs_counts_as_the_installations(make_world):
    one = make_world(seed=1).run(60.0, "monday")
    two = make_world(seed=2, bias=tuple(value + 0.08 for value in (0.03, -0.02, 0.0, 0.015))).run(60.0, "friday")
    fit = fit_runs([one, two])
    assert fit.installation_m > 0.04
    assert "one_run" not in {note.code for note in fit.warnings}


def test_distances_without_data_are_told_and_widened(make_world):
    run = make_world().run()
    away = np.linalg.norm(run.truth_m, axis=1)
    keep = (away < 8) | (away > 14)
    cut = replace(run, t_s=run.t_s[keep], truth_m=run.truth_m[keep], range_m=run.range_m[keep])
    fit = fit_runs([cut])
    assert any(low < 10 < high for low, high in fit.coverage.gaps_m)
    _, inside = bias_at(record_of(fit).anchors[0], 11_000.0)
    _, beside = bias_at(record_of(fit).anchors[0], 6_000.0)
    assert inside > 1.5 * beside


@pytest.mark.parametrize("count", [3, 5, 16])
def test_any_number_of_anchors(make_world, count):
    places = {
        f"N{i}": (2 * math.cos(2 * math.pi * i / count), 2 * math.sin(2 * math.pi * i / count), 0.3 + 0.2 * (i % 3))
        for i in range(count)
    }
    fit = fit_runs([make_world(anchors=places, bias=tuple(0.01 * (i % 3) for i in range(count))).run(30.0)])
    assert len(record_of(fit).anchors) == count


def test_what_cannot_be_calibrated_is_said(make_world):
    run = make_world().run(60.0)
    still = np.repeat(run.truth_m[:1], len(run.t_s), axis=0)
    with pytest.raises(CalibrationError, match="hardly moved"):
        make_run("still", run.anchor_ids, run.anchors_m, run.t_s, still, run.range_m)
    with pytest.raises(CalibrationError, match="zero, negative or beyond"):
        make_run("mm", run.anchor_ids, run.anchors_m, run.t_s, run.truth_m, run.range_m * 1000)
    with pytest.raises(CalibrationError, match="zero, negative or beyond"):
        make_run("none", run.anchor_ids, run.anchors_m, run.t_s, run.truth_m, run.range_m * 0 - 1)
    with pytest.raises(CalibrationError, match="no range"):
        make_run("nan", run.anchor_ids, run.anchors_m, run.t_s, run.truth_m, run.range_m * np.nan)
    few = replace(run, t_s=run.t_s[:200], truth_m=run.truth_m[:200], range_m=run.range_m[:200])
    with pytest.raises(CalibrationError, match="are the least"):
        fit_runs([few])
    dead = run.range_m.copy()
    dead[:, 1] = np.nan
    with pytest.raises(CalibrationError, match="anchor A2"):
        fit_runs([replace(run, range_m=dead)])
    slow = replace(run, t_s=run.t_s * 200)
    with pytest.raises(CalibrationError, match=r"0\.4 Hz"):
        fit_runs([slow])
    with pytest.raises(CalibrationError, match="no calibration run"):
        fit_runs([])
    with pytest.raises(CalibrationError, match="same anchors"):
        fit_runs([run, replace(run, anchor_ids=("A1", "A2", "A3", "B4"))])
    same = run.anchors_m.copy()
    same[1] = same[0]
    with pytest.raises(SurveyError, match="same place"):
        fit_runs([replace(run, anchors_m=same)])


def test_anchors_on_a_line_are_fitted_with_a_warning(make_world):
    line = {f"L{i}": (i * 1.0, 0.0, 0.5 + 0.1 * i) for i in range(4)}
    fit = fit_runs([make_world(anchors=line).run(40.0)])
    assert "anchors_on_a_line" in {note.code for note in fit.warnings}


def test_the_installation_of_anchors_that_are_mounted_anew(make_world):
    fit = fit_runs([make_world().run(40.0)], FitSettings(installation_floor_m=0.06))
    assert record_of(fit).installation_sigma_mm == 60


def test_slow_ranges_are_commissioned_in_longer_windows(make_world, true_bias):
    """One range a second: half an hour as a person walks it."""
    fit = fit_runs([make_world().run(900.0, interval_s=1.0)])
    assert fit.windows.length_s == pytest.approx(6.0)
    assert fit.coverage.seconds == pytest.approx(900, abs=20)
    for index in range(4):
        found = np.interp(12.0, fit.curves.knots_m, fit.curves.bias_m[index])
        assert found == pytest.approx(true_bias(12.0, index), abs=0.025)
    assert np.median(fit.spread.bias_sigma_m) < 0.035


def test_little_data_leaves_what_was_known_and_much_replaces_it():
    known = 0.045**2
    assert shrunk(0.2**2, 0.0, known, 3.0) == pytest.approx(known)
    assert 0.045 < math.sqrt(shrunk(0.2**2, 1.0, known, 3.0)) < 0.1
    assert math.sqrt(shrunk(0.01**2, 500.0, known, 3.0)) == pytest.approx(0.01, rel=0.05)
    assert math.sqrt(shrunk(0.2**2, 500.0, known, 3.0)) == pytest.approx(0.2, rel=0.05)
    stated = [shrunk(0.01**2, samples, known, 3.0) for samples in (1, 2, 4, 8, 16, 64)]
    assert stated == sorted(stated, reverse=True)


def test_no_bias_is_stated_vaguer_where_nobody_was_than_before_anybody_measured():
    assert wandered(0.02, 0.0) == 0.02
    assert 0.04 < wandered(0.02, 0.06) < 0.075
    assert wandered(0.02, 5.0) == pytest.approx(math.hypot(0.045, 0.060), rel=0.01)
    assert wandered(0.2, 5.0) == 0.2


def test_an_anchor_that_is_often_obstructed_keeps_its_sigma_in_sight(make_world, fitted):
    """A third of the time something stands before A3; what is stated of it holds for the rest, and the third is told."""
    run = make_world().run()
    range_m = run.range_m.copy()
    hidden = (run.t_s // 7).astype(int) % 3 == 0
    late = np.random.default_rng(2).uniform(0.15, 0.7, int(run.t_s[-1] // 7) + 1)[(run.t_s // 7).astype(int)]
    range_m[hidden, 2] += late[hidden]
    fit = fit_runs([replace(run, range_m=range_m)])
    assert np.max(np.abs(fit.curves.bias_m[2] - _at(fitted.curves, fit.curves.knots_m)[2])) < 0.04
    assert np.median(fit.spread.bias_sigma_m[2]) < 0.045
    assert 1 - fit.spread.in_sight[2] == pytest.approx(1 / 3, abs=0.08)
    (told,) = [note.text for note in fit.warnings if note.code == "obstructed"]
    assert "Anchor A3" in told
