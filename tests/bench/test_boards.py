"""How many honest drones are verified, by board: whole sessions of both machines over virtual boards, in virtual time.

"Beside others": another pad and its drone range on the same channel, at a random distance and phase. Each session, theirs
and ours, draws its preamble code (of four) and the length of its blocks (of four) as sessions do.
"""

from __future__ import annotations

import math
import random

import pytest
from bench.bench_tools import p50, p95, show
from kit.agents import ANCHORS, Flight
from kit.air_duo import AirDuo
from kit.virtual_air import VirtualAir

from wonderland.proofs.records.policies import Policy
from wonderland.uwb.agreed import preamble_code_of
from wonderland.uwb.layout import RangingPlan
from wonderland_simulator.uci_node import DWM3001CDK, IDEAL, PICA, QM35, SR150

SESSIONS = 1_000
OTHERS = tuple(f"other {name}" for name in ANCHORS)

pytestmark = [pytest.mark.bench]


def others_start(air, rng) -> None:
    """Another pad's session, 3 to 80 m away from everything of ours, at any phase."""
    session_id = rng.randrange(2, 1 << 31, 2)
    plan = RangingPlan(
        session_a_id=session_id,
        session_b_id=session_id + 1,
        pad_macs=(1, 2, 3, 4),
        uav_mac=9,
        sts_key=rng.randbytes(16),
        preamble_code=preamble_code_of(session_id),
    )
    away_mm = round(1_000 * rng.uniform(3, 80))
    for name in (*OTHERS, "other uav"):
        if name not in air.hosts:
            air.add(name, DWM3001CDK)
        for ours in (*ANCHORS, "uav"):
            air.ranges_mm[frozenset((name, ours))] = away_mm
    for name in (*OTHERS, "other uav"):
        air.close_sessions(name)
        air.hosts[name].messages.clear()
    air.run(20 + rng.uniform(0, 27))
    for index, name in enumerate(OTHERS):
        air.open(name, plan.pad_ranging(index))
    air.open("other uav", plan.uav_ranging())
    air.run(rng.uniform(0, 60))


def prove(profile, *, assurance, beside, sessions=SESSIONS, seed=1):
    """(verified, collisions, lost to others, ms from the request to the verdict). Nobody is refuted."""
    rng = random.Random(seed)
    air = VirtualAir(seed=seed)
    verified, took = 0, []
    try:
        for number in range(sessions):
            if beside:
                others_start(air, rng)
            # Time differences of four anchors prove a place beside the raised one, not towards it.
            here = (rng.uniform(3_000, 5_000), rng.uniform(2_000, 4_000), rng.uniform(5_000, 7_000))
            for name, place in ANCHORS.items():
                air.ranges_mm[frozenset((name, "uav"))] = round(math.dist(place, here))
            duo = AirDuo(
                profile,
                air,
                noise_seed=number,
                session_id=f"{number:064x}",
                flight=Flight(truth=here, claimed=here, stamp_noise_mm=10.0),
                policy=Policy(min_assurance=assurance),
                timed=assurance > 2,
            )
            decided_ms = []
            duo.on(
                lambda duo: duo.verdict is not None, lambda duo, out=decided_ms: out.append(duo.now_ms - duo.START_MS)
            )
            duo.run(60_000)
            verified += duo.verdict is not None and duo.verdict.outcome == "verified"
            assert duo.verdict is None or duo.verdict.outcome != "refuted"
            took += decided_ms
            for name in (*ANCHORS, "uav"):
                air.close_sessions(name)
            air.run(60)
    finally:
        air.close()
        air.loop.close()
    return verified, air.air.collisions, air.air.drowned, took


@pytest.mark.timeout(3_600)
@pytest.mark.parametrize("beside", [False, True], ids=["alone", "beside others"])
@pytest.mark.parametrize(
    ("profile", "assurance"),
    [(DWM3001CDK, 2), (QM35, 2), (SR150, 2), (SR150, 3), (PICA, 2), (IDEAL, 3)],
    ids=lambda each: getattr(each, "name", str(each)),
)
def test_verified_by_board(keep, profile, assurance, beside):
    if beside and not profile.quirks.one_radio:
        pytest.skip("no radio stands behind it that others could drown")
    verified, collisions, drowned, took = prove(profile, assurance=assurance, beside=beside)
    assert collisions == 0
    share = 100 * verified / SESSIONS
    assert share > 50
    keep(**{f"{profile.name}_{assurance}{'_beside' if beside else ''}_verified_percent": share})
    show(
        f"Honest drones, {profile.name}, assurance {assurance}, {'beside others' if beside else 'alone'}: "
        f"{SESSIONS} sessions in virtual time",
        ("verified", "collisions a session", "pairs' rounds lost to others, a session", "p50 ms", "p95 ms to verdict"),
        [(f"{share:.1f} %", collisions / SESSIONS, f"{drowned / SESSIONS:.1f}", p50(took), p95(took))],
    )
