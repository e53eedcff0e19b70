"""Seconds in which something stood between are told from those in sight, and so is a free view."""

from __future__ import annotations

import numpy as np
import pytest

from wonderland_edge_agent.commissioning.sight import in_sight


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_a_free_view_is_left_alone(rng):
    clear = in_sight(rng.normal(0.0, 0.03, 400))
    assert (clear >= 0.5).mean() > 0.99
    assert (in_sight(rng.standard_t(5, 400) * 0.03) >= 0.5).mean() > 0.96  # heavy shoulders are no obstruction


def test_what_is_too_long_is_found_and_what_is_missing_left_out(rng):
    hidden = rng.random(400) < 0.3
    rest = rng.normal(0.0, 0.03, 400) + np.where(hidden, rng.uniform(0.2, 0.8, 400), 0.0)
    rest[::10] = np.nan
    clear = in_sight(rest)
    there = np.isfinite(rest)
    assert np.all(clear[~there] == 1.0)
    assert np.mean((clear < 0.5) == hidden, where=there) > 0.97


def test_the_first_path_helps_where_a_range_alone_does_not_tell(rng):
    hidden = rng.random(2_000) < 0.2
    rest = rng.normal(0.0, 0.03, 2_000) + np.where(hidden, 0.09, 0.0)
    first_path_db = rng.normal(1.0, 0.8, 2_000) + np.where(hidden, rng.normal(6.0, 2.0, 2_000), 0.0)
    right = [np.mean((in_sight(rest, db) < 0.5) == hidden) for db in (None, first_path_db)]
    assert right[1] > right[0] + 0.03
    silent = in_sight(rest, np.full(2_000, np.nan))
    assert np.allclose(silent, in_sight(rest))


def test_the_first_path_alone_convicts_nobody(rng):
    rest = rng.normal(0.0, 0.03, 400)
    strange = np.where(np.arange(400) < 40, 30.0, 1.0)
    near = np.abs(rest) < 0.03
    assert np.all(in_sight(rest, strange)[near] >= 0.5)
