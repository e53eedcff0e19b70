"""Drones on the edge of the buffer whose biases change along their way: wrong in one of a hundred at most, at any look.

Along the ellipse's long axis, as ``sampling.settle``: the bias is drawn with its correlation over place, the variance is
stated as ``travel`` states it of ranges without noise, and the decision's own thresholds are applied.
"""

from __future__ import annotations

import timeit

import numpy as np
import pytest
from bench.bench_tools import show

from wonderland.proofs import stopping
from wonderland.proofs.travel import bias_left
from wonderland_research.attack_lab.places import FLOWN
from wonderland_research.reproduction.sampling import Share

pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]
R, ROUNDS, TRIES = 1000.0, 160, 20_000
PAD = FLOWN.commissioning
LOOKS = range(10, ROUNDS + 1)
TIME = np.arange(ROUNDS)
WAYS = {
    "hovers": 0.0 * TIME,
    "straight on, 0.1 m a round": 100.0 * TIME,
    "to and fro, 3 m": 1000.0 * np.abs(0.1 * TIME % 6 - 3),
    "40 rounds, then hovers": 100.0 * np.minimum(TIME, 40),
    "hovers 80 rounds first": 100.0 * np.maximum(TIME - 80, 0),
    "dashes in the last 20": 500.0 * np.maximum(TIME - 140, 0),
}


def stated(way_mm):
    """What ``travel`` leaves after each look."""
    ranges = tuple(20_000 + 10 * round(x / 10) for x in way_mm)
    return np.array([bias_left([ranges[:look]] * 4, PAD)[0] for look in LOOKS])


def needed(side, s1, step):
    """The least distance (σ) that proves a side."""
    low, high = 0.0, 20.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stopping.proved(side, 0.01, R, s1, middle, step) else (middle, high)
    return high


def wrong(way_mm, white_mm, bias_mm, *, fixed, length_mm, seed=1):
    """(verified, refuted) of drones on the edge whose biases are truly so."""
    rng = np.random.default_rng(seed)
    apart = np.abs(np.subtract.outer(way_mm, way_mm))
    alike = np.linalg.cholesky(fixed + (1.0 - fixed) * np.exp(-apart / length_mm) + 1e-9 * np.eye(ROUNDS))
    errors = bias_mm * rng.normal(size=(TRIES, ROUNDS)) @ alike.T + white_mm * rng.normal(size=(TRIES, ROUNDS))
    looks = np.array(LOOKS)
    away = np.abs(R + (np.cumsum(errors, axis=1) / np.arange(1, ROUNDS + 1))[:, looks - 1]) - R
    white = white_mm**2 / looks
    variance = white + bias_mm**2 * stated(way_mm)
    step = np.sqrt(1.0 / variance - 1.0 / (variance + white / (looks - 1)))
    s1 = np.sqrt(variance)
    inside = np.array([needed(stopping.INSIDE, *each) for each in zip(s1, step, strict=True)])
    outside = np.array([needed(stopping.OUTSIDE, *each) for each in zip(s1, step, strict=True)])
    return int((-away / s1 >= inside).any(axis=1).sum()), int((away / s1 >= outside).any(axis=1).sum())


def test_error_rates_at_the_edge_with_biases_that_change_over_place(keep):
    rows = []
    for name, way in WAYS.items():
        for white, bias in ((1800.0, 300.0), (300.0, 400.0), (100.0, 400.0)):
            verified, refuted = wrong(way, white, bias, fixed=PAD.bias_fixed_ppm / 1e6, length_mm=PAD.bias_length_mm)
            assert max(verified, refuted) / TRIES <= 0.0115
            said = [Share(count, TRIES).percent() for count in (verified, refuted)]
            rows.append((name, f"{white:.0f} mm", f"{bias:.0f} mm", *said))
            keep(way=name, white=white, bias=bias, verified=verified, refuted=refuted, tries=TRIES)
    show(
        f"On the edge, looks after every round from the tenth; {TRIES} drones each",
        ("way", "one round's noise", "bias", "verified", "refuted"),
        rows,
    )


def test_what_it_costs(keep):
    rng = np.random.default_rng(1)
    way = 50.0 * np.arange(100)
    ranges = [tuple(20_000 + 10 * round(x / 10) for x in way + rng.normal(0.0, 30.0, 100)) for _ in range(4)]
    took_us = min(timeit.repeat(lambda: bias_left(ranges, PAD), number=200, repeat=21)) / 200 * 1e6
    keep(bias_left_us=took_us)
    show("Four anchors, 100 rounds", ("what", "µs"), [("bias_left", f"{took_us:.0f}")])
    assert took_us < 100.0  # 40 on an idle machine
