"""A truth that is off is found in the ranges, told apart from bias, and refused where it is certain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wonderland_edge_agent.commissioning.errors import TruthError
from wonderland_edge_agent.commissioning.fit import fit_runs
from wonderland_edge_agent.commissioning.truth import find_truth


def off(run, offset):
    return replace(run, truth_m=run.truth_m - np.array(offset))


def test_a_good_truth_is_where_the_ranges_put_it(good_run):
    found = find_truth([good_run])
    found.check("run")
    for part in (found.east, found.north, found.up, found.forward, found.left):
        assert abs(part.value) < 3 * part.sigma
        assert 0.002 < part.sigma < 0.3
    assert abs(found.delay.value) < 0.03
    assert found.notes() == []


@pytest.mark.parametrize(
    ("name", "offset"),
    [("up", (0, 0, 1.05)), ("up", (0, 0, -0.6)), ("east", (0.5, 0, 0)), ("north", (0, -0.7, 0))],
)
def test_what_is_wrong_is_measured_and_named(good_run, name, offset):
    found = find_truth([off(good_run, offset)])
    part = getattr(found, name)
    wrong = sum(offset)
    assert part.value == pytest.approx(wrong, abs=4 * part.sigma)
    assert part.beyond(0.3, 4.0)
    others = {"up", "east", "north"} - {name}
    assert all(not getattr(found, other).beyond(0.3, 4.0) for other in others)


def test_a_wrong_height_is_refused_with_what_to_do(good_run):
    with pytest.raises(TruthError, match=r"1\.0\d ± 0\.\d\d m higher: .*--truth-raise that is 1\.0\d higher"):
        fit_runs([off(good_run, (0, 0, 1.05))])
    with pytest.raises(TruthError, match=r"east: is the reference in the survey's frame"):
        fit_runs([off(good_run, (0.5, 0, 0))])


def test_a_lever_arm_turns_with_the_drone(good_run):
    velocity = np.gradient(good_run.truth_m[:, :2], good_run.t_s, axis=0)
    ahead = velocity / np.linalg.norm(velocity, axis=1)[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(ahead))], axis=1)
    found = find_truth([replace(good_run, truth_m=good_run.truth_m - 0.6 * left)])
    assert found.left.value == pytest.approx(0.6, abs=max(4 * found.left.sigma, 0.1))
    with pytest.raises(TruthError, match="lever arm"):
        found.check("run")


def test_bias_is_no_error_of_the_truth(make_world):
    """Units that differ and grow with distance: what a table is for."""
    for seed in range(4):
        run = make_world(seed=seed, bias=tuple(np.random.default_rng(seed).normal(0.0, 0.06, 4))).run(60.0)
        find_truth([run]).check("run")
