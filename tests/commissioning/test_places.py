"""Over which way a bias changes, and how much of it never does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wonderland_edge_agent.commissioning import places
from wonderland_edge_agent.commissioning.fit import FitSettings, fit_runs
from wonderland_edge_agent.commissioning.offline import NOWHERE


class Data:
    """Windows of a second on straight lines to and fro, at 1 m/s."""

    def __init__(self, runs=1, seconds=400):
        self.t_s = np.tile(np.arange(seconds, dtype=float), runs)
        self.run = np.repeat(np.arange(runs), seconds)
        across = 60.0 - np.abs(60.0 - np.arange(seconds) % 120.0)
        self.truth_m = np.column_stack([np.tile(across, runs), 40.0 * (self.t_s // 60), np.zeros(runs * seconds)])


class Spread:
    def __init__(self, own_m, sigma_m=0.04):
        self.own_m = own_m
        self.bias_sigma_m = np.full((own_m.shape[1], 5), sigma_m)


def drawn(data, *, length_m, fixed, anchors=4, seed=1):
    """Errors with that correlation over place, 4 cm; the fixed part is another one in each run, as in the field."""
    rng = np.random.default_rng(seed)
    apart = np.linalg.norm(data.truth_m[:, None] - data.truth_m[None], axis=2)
    alike = (1.0 - fixed) * np.exp(-apart / length_m) + 1e-9 * np.eye(len(apart))
    alike[data.run[:, None] != data.run[None, :]] = 0.0
    stays = rng.normal(0.0, np.sqrt(fixed), (int(data.run.max()) + 1, anchors))[data.run]
    return 0.04 * (np.linalg.cholesky(alike) @ rng.normal(0.0, 1.0, (len(apart), anchors)) + stays)


def found(data, own, *, remounted=False, reference_sigma_m=0.0, **more):
    return places.find_places(data, Spread(own, **more), reference_sigma_m=reference_sigma_m, remounted=remounted)


def test_the_length_is_found_and_never_understated():
    data = Data()
    for length in (0.5, 3.0, 5.0):
        seen = [found(data, drawn(data, length_m=length, fixed=0.0, seed=seed)).length_m for seed in range(6)]
        assert min(seen) >= places.LEAST_LENGTH_M
        assert np.median(seen) >= 0.85 * length
        assert max(seen) <= max(places.LEAST_LENGTH_M, 2.5 * length)


def test_one_run_takes_the_fixed_part_from_experience():
    data = Data()
    own = drawn(data, length_m=2.0, fixed=0.0)
    assert found(data, own).fixed == places.PRIOR_FIXED
    assert found(data, own, remounted=True).fixed == places.REMOUNTED_FIXED


def test_two_runs_show_it():
    data = Data(runs=2, seconds=300)
    means = {}
    for fixed in (0.0, 0.6):
        kept = [found(data, drawn(data, length_m=2.0, fixed=fixed, seed=seed)).fixed for seed in range(6)]
        means[fixed] = np.mean(kept)
        assert all(places.LEAST_FIXED <= value <= 1.0 for value in kept)
    assert means[0.0] < places.PRIOR_FIXED < 0.4 < means[0.6]


def test_what_the_reference_may_be_wrong_by_stays():
    data = Data()
    own = drawn(data, length_m=2.0, fixed=0.0)
    assert found(data, own, reference_sigma_m=0.02).fixed == pytest.approx(0.25 + 0.75 * 0.25)
    assert found(data, own, reference_sigma_m=0.1).fixed == 1.0


def test_too_short_a_way_says_nothing():
    data = Data(seconds=40)
    assert found(data, drawn(data, length_m=2.0, fixed=0.0)) is None
    still = Data()
    still.truth_m[:] = 5.0
    assert found(still, np.ones((400, 4))) is None


def test_the_record_has_it(make_world):
    fit = fit_runs([make_world().run(seconds=120.0)], FitSettings())
    record = fit.commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)
    assert fit.places is not None
    assert record.bias_length_mm == round(fit.places.length_m * 1000)
    assert record.bias_fixed_ppm == round(fit.places.fixed * 1e6)
    assert fit.document()["bias_fixed"] == round(fit.places.fixed, 3)
    without = replace(fit, places=None).commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)
    assert without.bias_length_mm is without.bias_fixed_ppm is None
