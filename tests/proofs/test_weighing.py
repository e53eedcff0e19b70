"""The sums that are written out for four anchors: the same bits as those for any number."""

from __future__ import annotations

import random

import pytest

from wonderland.proofs import weighing


def columns(count, width, rng):
    return [tuple(rng.gauss(0, 10 ** rng.uniform(-6, 6)) for _ in range(width)) for _ in range(count)]


@pytest.mark.parametrize("seed", range(20))
def test_written_out_sums_have_the_bits_of_the_general_ones(seed, monkeypatch):
    rng = random.Random(seed)
    weights, pairs, lines = columns(4, 4, rng), columns(4, 2, rng), columns(4, 4, rng)
    column = [rng.gauss(0, 1e3) for _ in range(4)]

    def everything():
        return (
            weighing.weighed_pairs(weights, pairs),
            weighing.weighed_lines(weights, lines),
            [tuple(row) for row in weighing.less_outer(weights, column, 0.37)],
        )

    written_out = everything()
    monkeypatch.setattr(weighing, "_WRITTEN_OUT", 0)
    assert everything() == written_out


@pytest.mark.parametrize("count", [1, 3, 4, 5, 16])
def test_sums_are_those_of_a_matrix(count):
    rng = random.Random(count)
    weights, lines = columns(count, count, rng), columns(count, 4, rng)
    for row, sums in zip(weights, weighing.weighed_lines(weights, lines), strict=True):
        for position, found in enumerate(sums):
            expected = 0.0
            for weight, line in zip(row, lines, strict=True):
                expected += weight * line[position]
            assert found == expected
