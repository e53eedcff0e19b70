"""What no radio shows is no bias: it is refused, with what it looks like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.fit import fit_runs
from wonderland_edge_agent.commissioning.run import make_run
from wonderland_edge_agent.commissioning.shift import find_shift


@pytest.fixture
def good(make_world):
    return make_world().run()


def shifted(run, seconds):
    truth = np.stack([np.interp(run.t_s + seconds, run.t_s, run.truth_m[:, axis]) for axis in range(3)], axis=1)
    return replace(run, truth_m=truth)


def exchanged(run):
    return replace(run, range_m=run.range_m[:, [0, 3, 2, 1]])


def exchanged_in_a_ring(run):
    return replace(run, range_m=run.range_m[:, [1, 3, 2, 0]])


def raised(run, metres):
    return replace(run, truth_m=run.truth_m + np.array([0.0, 0.0, metres]))


def moved(run, metres):
    places = run.anchors_m.copy()
    places[1, 0] += metres
    return replace(run, anchors_m=places)


def one_stuck(run):
    ranges = run.range_m.copy()
    ranges[:, 2] = 12.5
    return replace(run, range_m=ranges)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda run: replace(run, range_m=run.range_m * 0 + 12.5), "A1: its ranges do not follow.*A4.*stuck"),
        (one_stuck, "anchor A3: its ranges do not follow the distance. .*The others follow"),
        (lambda run: replace(run, range_m=run.range_m + 10.0), "antenna delay"),
        (
            lambda run: replace(run, range_m=run.range_m + np.array([0.0, 1.5, 0.0, 0.0])),
            "anchor A2: .*The others agree",
        ),
        (lambda run: replace(run, range_m=run.range_m / 0.3048), "they are feet"),
        (lambda run: replace(run, range_m=run.range_m * 1.2), "all in metres"),
        (exchanged, "A2 and A4 fit each other's places"),
        (exchanged_in_a_ring, "A1, A2 and A4 fit each other's places"),
        (lambda run: moved(run, 2.0), "anchor A2: .*surveyed at another place"),
        (lambda run: shifted(run, 5.0), r"the truth is 5\.0\d s early.*--truth-shift lower"),
        (lambda run: shifted(run, -2.0), r"the truth is 2\.0\d s late.*--truth-shift higher"),
        (lambda run: replace(run, truth_m=run.truth_m + np.array([4.0, -3.0, 0.0])), "survey's frame"),
        (lambda run: replace(run, range_m=run.range_m / 0.9144), "they are yards"),
        (lambda run: raised(run, 2.0), r"truth seems [12]\.\d m too high: try --truth-raise -[12]\.\d"),
        (lambda run: raised(run, 3.0), r"truth seems [23]\.\d m too high"),
    ],
)
def test_what_no_radio_shows_is_refused_by_name(good, spoil, said):
    with pytest.raises(CalibrationError, match=said):
        fit_runs([spoil(good)])


def test_the_spoilt_one_of_several_runs_is_named(good):
    with pytest.raises(CalibrationError, match="friday: "):
        fit_runs([replace(good, name="monday"), replace(good, name="friday", range_m=good.range_m + 3.0)])


def test_a_plausible_bias_of_one_anchor_is_fitted_and_told(good):
    fit = fit_runs([replace(good, range_m=good.range_m + np.array([0.0, 0.5, 0.0, 0.0]))])
    said = {note.code: note.text for note in fit.warnings}
    assert "Anchor A2" in said["stands_out"]
    assert "stands_out" not in {note.code for note in fit_runs([good]).warnings}


def test_another_clock_is_found_ten_seconds_off(good):
    shift, gain = find_shift([shifted(good, -8.0)])
    assert shift == pytest.approx(8.0, abs=0.05)
    assert gain > 0.9


def test_nothing_is_cut_to_what_a_record_holds(fitted):
    curves = replace(fitted.curves, bias_m=fitted.curves.bias_m + 6.0)
    with pytest.raises(CalibrationError, match="a bias of anchor A1 of 6"):
        replace(fitted, curves=curves).table(0)


def test_a_tag_that_stays_at_one_distance_has_no_slope(make_world):
    run = make_world().run()
    angle = np.linspace(0.0, 40.0, len(run.t_s))
    truth = np.stack([8 * np.cos(angle), 8 * np.sin(angle), np.full_like(angle, 2.0)], axis=1)
    noise = np.random.default_rng(1).normal(0.0, 0.02, run.range_m.shape)
    away = np.linalg.norm(truth[:, None] - run.anchors_m, axis=2)
    round_and_round = make_run("ring", run.anchor_ids, run.anchors_m, run.t_s, truth, away + noise)
    assert fit_runs([round_and_round]).coverage.furthest_m < 11.0


def test_one_anchor_alone_is_not_exchanged(good):
    """A3 stands where A4 was surveyed (and nobody at its own place): an exchange needs two."""
    ranges = good.range_m.copy()
    ranges[:, 2] = np.linalg.norm(good.truth_m - good.anchors_m[3], axis=1)
    with pytest.raises(CalibrationError) as caught:
        fit_runs([replace(good, range_m=ranges)])
    assert "exchanged in" not in str(caught.value)
    assert "A3" in str(caught.value)
