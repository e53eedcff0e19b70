from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.fix import Multilateration
from wonderland_research.batch import fixes
from wonderland_research.paper_points import POINTS, SIGMA_M, cramer_rao_m

PAD = ((1500.0, 1500.0, 300.0), (-1500.0, 1500.0, 1500.0), (-1500.0, -1500.0, 300.0), (1500.0, -1500.0, 300.0))
metres = st.floats(-60_000, 60_000)


def ranges_to(anchors, place):
    return [math.dist(anchor, place) for anchor in anchors]


@given(metres, metres, st.floats(0, 30_000))
@settings(deadline=None, max_examples=80)
def test_exact_ranges_give_the_place(east, north, up):
    place = (east, north, up)
    assume(min(ranges_to(PAD, place)) > 100.0)
    found = Multilateration(PAD).fix(ranges_to(PAD, place), up)
    assert found == pytest.approx((east, north), abs=1.0)


@given(
    st.lists(st.tuples(metres, metres, st.floats(0, 3000)), min_size=3, max_size=16),
    st.lists(st.floats(0, 100_000), min_size=16, max_size=16),
    st.floats(-1e6, 1e6),
)
@settings(deadline=None, max_examples=80)
def test_any_ranges_end_in_finite_numbers_or_none(anchors, ranges, up):
    try:
        geometry = Multilateration(anchors)
    except GeometryError:
        return
    found = geometry.fix(ranges[: len(anchors)], up)
    assert found is None or all(math.isfinite(value) for value in found)


@pytest.mark.parametrize(
    ("anchors", "says"),
    [
        (PAD[:2], "at least 3"),
        ([(0, 0, 0), (1000, 1000, 0), (3000, 3000, 500)], "in a line"),
        ([(5, 5, 5)] * 4, "line"),
    ],
)
def test_anchors_that_give_no_position_are_refused(anchors, says):
    with pytest.raises(GeometryError, match=says):
        Multilateration(anchors)


@pytest.mark.parametrize("point", POINTS, ids=lambda point: point.name)
def test_its_error_is_the_bound(point):
    """On the noise of the linearised estimate, whose error is the Cramér–Rao bound: chance falls out of the ratio."""
    rng = random.Random(7)
    anchors = [(x * 1000, y * 1000, 0.0) for x, y in point.anchors]
    truth = (point.position[0] * 1000, point.position[1] * 1000, 0.0)
    directions = np.array(truth[:2]) - np.array(anchors)[:, :2]
    gain = np.linalg.pinv(directions / np.linalg.norm(directions, axis=1, keepdims=True))
    noise = np.array([[rng.gauss(0, SIGMA_M * 1000) for _ in anchors] for _ in range(3000)])
    geometry = Multilateration(anchors)
    clean = np.array(ranges_to(anchors, truth))
    found = np.array([geometry.fix(row, 0.0) for row in clean + noise])
    ratio = np.sqrt(((found - truth[:2]) ** 2).sum() / ((noise @ gain.T) ** 2).sum())
    assert np.sqrt((gain**2).sum()) * SIGMA_M == pytest.approx(cramer_rao_m(point, 1), rel=1e-3)
    assert ratio <= 1.02


def test_a_batch_is_the_same_fix_many_times():
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(-20_000, 20_000, (200, 2)), rng.uniform(2000, 9000, 200)])
    ranges = np.linalg.norm(places[:, None, :] - np.array(PAD), axis=2) + rng.normal(0, 60, (200, 4))
    ranges[5, 2] = np.nan
    together = fixes(np.array(PAD), ranges, places[:, 2])
    geometry = Multilateration(PAD)
    for row, (place, found) in enumerate(zip(places, together, strict=True)):
        if row == 5:
            assert np.isnan(found).all()
            continue
        assert tuple(found) == pytest.approx(geometry.fix(ranges[row], place[2]), abs=1e-6)
