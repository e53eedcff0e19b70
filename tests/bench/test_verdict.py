"""The contract's decision beside a Levenberg–Marquardt fit of the same ranges by SciPy (MINPACK)."""

from __future__ import annotations

import time

import numpy as np
import pytest
from bench.bench_tools import p50, show
from kit.proof_world import START_MS, World
from scipy.optimize import least_squares

from wonderland.proofs.records.sessions import Evidence
from wonderland.proofs.verdict import decide

TRUTH = (3_000, 6_000, 4_000)
REPEAT = 30

pytestmark = pytest.mark.bench


def timed(work):
    """Median milliseconds, and the last result."""
    took = []
    result = None
    for _ in range(REPEAT):
        start = time.perf_counter()
        result = work()
        took.append((time.perf_counter() - start) * 1e3)
    return p50(took), result


def fit(commissioning, evidence):
    """A position that fits all ranges, and its covariance: what one would write with SciPy."""
    anchors = np.array([(each.east_mm, each.north_mm, each.up_mm) for each in commissioning.anchors], dtype=float)
    ranges = np.array([column.range_mm for column in evidence.ranges.anchors], dtype=float)

    def residuals(place):
        return (np.linalg.norm(anchors - place, axis=1)[:, None] - ranges).ravel() / commissioning.range_sigma_mm

    found = least_squares(residuals, np.array([0.0, 0.0, 3_000.0]), method="lm")
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def test_milliseconds_for_a_verdict(keep):
    world = World(seed=3, bias_sigma_mm=5)
    session = world.session(world.claim(TRUTH, START_MS))
    rows = []
    for rounds in (10, 40, 100, 160):
        evidence = world.evidence(lambda t: TRUTH, lambda t: TRUTH, rounds=rounds, broadcast=lambda t: TRUTH)
        verdict_ms, verdict = timed(
            lambda evidence=evidence: decide(
                session,
                world.commissioning,
                evidence,
                confirmed=True,
                signature_valid=True,
                authorisation=(),
                now_ms=START_MS + 20_000,
                evidence_sha256="0" * 64,
            )
        )
        raw = evidence.encode()
        parse_ms, parsed = timed(lambda raw=raw: Evidence.decode(raw))
        fit_ms, (place, _) = timed(lambda evidence=evidence: fit(world.commissioning, evidence))
        assert (verdict.outcome, verdict.rounds) == ("verified", rounds)
        assert parsed == evidence
        # Both looked at the same ranges: they agree within what the noise of a few rounds leaves.
        assert np.hypot(verdict.estimate.east_mm - place[0], verdict.estimate.north_mm - place[1]) < 60
        rows.append((rounds, verdict_ms, fit_ms, parse_ms))
        keep(rounds=rounds, verdict_ms=verdict_ms, fit_ms=fit_ms, parse_ms=parse_ms)
    show(
        "A verdict (both claims, χ², likelihood) and a bare fit of position, 4 anchors; median ms",
        ("rounds", "decide()", "SciPy LM fit", "ratio", "parsing the evidence"),
        [(n, f"{a:.2f}", f"{b:.2f}", f"{a / b:.2f}", f"{c:.2f}") for n, a, b, c in rows],
    )
