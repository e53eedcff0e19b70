"""A fix from four ranges: error and speed beside SciPy's Levenberg–Marquardt on the same ranges, in one run."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from bench.bench_tools import p50, show
from scipy.optimize import least_squares

from wonderland.proofs.fix import Multilateration
from wonderland_research.batch import fixes
from wonderland_research.paper_points import POINTS, SIGMA_M

pytestmark = pytest.mark.bench
TRIES = 40_000
PEER_TRIES = 400
REPEAT = 15


def best_of(work, count):
    """Microseconds of one of ``count`` in ``work``: median of the runs, since two cores are shared."""
    took = []
    for _ in range(REPEAT):
        start = time.perf_counter()
        work()
        took.append((time.perf_counter() - start) / count * 1e6)
    return p50(took)


def test_microseconds_and_error_of_a_fix(keep):
    rng = np.random.default_rng(1)
    rows = []
    for point in POINTS:
        anchors = np.array([(x * 1000, y * 1000, 0.0) for x, y in point.anchors])
        truth = np.array(point.position) * 1000
        noise = rng.normal(0, SIGMA_M * 1000, (TRIES, 4))
        ranges = np.linalg.norm(truth - anchors[:, :2], axis=1) + noise
        directions = truth - anchors[:, :2]
        gain = np.linalg.pinv(directions / np.linalg.norm(directions, axis=1, keepdims=True))
        bound = (noise @ gain.T) ** 2
        geometry = Multilateration([tuple(anchor) for anchor in anchors.tolist()])
        rows_of_ranges = ranges.tolist()

        def each(geometry=geometry, chosen=rows_of_ranges[:2000]):
            for row in chosen:
                geometry.fix(row, 0.0)

        def peer(row, anchors=anchors):
            def residuals(place):
                return np.hypot(place[0] - anchors[:, 0], place[1] - anchors[:, 1]) - row

            return least_squares(residuals, np.array([0.0, 3000.0]), method="lm").x

        found = np.array([geometry.fix(row, 0.0) for row in rows_of_ranges])
        ratio = math.sqrt(((found - truth) ** 2).sum() / bound.sum())
        theirs = np.array([peer(row) for row in ranges[:PEER_TRIES]])
        peer_ratio = math.sqrt(((theirs - truth) ** 2).sum() / bound[:PEER_TRIES].sum())
        ours_there = math.sqrt(((found[:PEER_TRIES] - truth) ** 2).sum() / bound[:PEER_TRIES].sum())
        one_us = best_of(each, 2000)
        batch_us = best_of(lambda anchors=anchors, ranges=ranges: fixes(anchors, ranges, 0.0), TRIES)
        peer_us = best_of(lambda ranges=ranges: [peer(row) for row in ranges[:20]], 20)
        assert np.allclose(fixes(anchors, ranges, 0.0), found, atol=1e-3)
        assert ratio <= 1.02
        keep(point=point.name, ratio=ratio, one_us=one_us, batch_us=batch_us, peer_us=peer_us, peer_ratio=peer_ratio)
        rows.append(
            (
                point.name,
                f"{ratio:.4f}",
                f"{ours_there:.3f} / {peer_ratio:.3f}",
                f"{one_us:.2f}",
                f"{batch_us:.2f}",
                f"{peer_us:.0f}",
                f"{peer_us / one_us:.0f} ×",
            )
        )
    show(
        f"One round's fix: RMSE / bound ({TRIES} fixes), the same beside SciPy on {PEER_TRIES}, µs a fix (medians)",
        ("point", "RMSE/CRLB", "ours / SciPy", "pure Python", "batched NumPy", "SciPy LM", "faster"),
        rows,
    )
