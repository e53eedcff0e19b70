"""Honest drones by board, by the clock on the wall: agents and ledger as processes, nodes on pseudo-terminals."""

from __future__ import annotations

import pytest
from bench.bench_sessions import sessions
from bench.bench_tools import p50, p95, show

from wonderland.proofs.records.policies import Policy
from wonderland_simulator.scenario import PADS
from wonderland_simulator.uci_node import DWM3001CDK, IDEAL, QM35, SR150

SESSIONS = 50

pytestmark = [pytest.mark.bench]


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("board", "assurance"),
    [(DWM3001CDK, 2), (QM35, 2), (SR150, 2), (SR150, 3), (IDEAL, 3)],
    ids=lambda each: getattr(each, "name", str(each)),
)
async def test_verified_by_board_in_real_time(tmp_path, keep, board, assurance):
    pad = next(each for each in PADS if (each.clock_sigma_mm is not None) == (assurance > 2))
    verified, took, otherwise = 0, [], []
    async with sessions(tmp_path, policy=Policy(min_assurance=assurance), pad=pad, board=board) as proving:
        await proving.attempt()  # the first one finds nothing warm
        for _ in range(SESSIONS):
            result = await proving.attempt()
            if result.verdict is not None and result.verdict.outcome == "verified":
                asked = await proving.agent._ledger.read_session(result.session_id)
                took.append(result.steps["verdict"] - asked.requested_ms)
                verified += 1
            else:
                otherwise.append(result.verdict.outcome if result.verdict else f"{result.end}: {result.detail}")
    share = 100 * verified / SESSIONS
    assert share > 50, otherwise
    keep(**{f"{board.name}_{assurance}_real_time_verified_percent": share, "p50_ms": p50(took), "p95_ms": p95(took)})
    show(
        f"Honest drones, {board.name}, assurance {assurance}: {SESSIONS} sessions in real time, embedded ledger",
        ("verified", "p50 ms", "p95 ms from the request to the committed verdict", "otherwise"),
        [(f"{share:.0f} %", p50(took), p95(took), "; ".join(otherwise) or "–")],
    )
