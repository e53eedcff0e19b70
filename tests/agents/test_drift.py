"""A running pad's anchors range each other while no drone is there."""

from __future__ import annotations

import asyncio

from wonderland_edge_agent.drift import Baseline
from wonderland_edge_agent.drift.baseline import PairBaseline

DRIFT = {"every_s": 1}


async def until(condition, limit_s=90.0):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.02)


def state_of(agent) -> str:
    return agent.status().get("drift", {}).get("state", "")


async def test_a_proof_comes_before_the_anchors_own_ranging(world):
    """They range each other nearly all the time; a request ends that at once."""
    async with world.pad(drift=DRIFT) as pad, world.uav() as uav:
        await until(lambda: state_of(pad) == "ok")
        await until(lambda: pad._radios._between is not None)
        result = await uav.prove("pad-1", "land")
        assert result.verdict.outcome == "verified"
        assert "pad_drifts" not in {reason.code for reason in result.verdict.reasons}
        looks = pad.status()["drift"]["looks"]
        await until(lambda: pad.status()["drift"]["looks"] > looks)
    assert (world.directory / "spool" / "anchors.json").exists()


async def test_a_moved_anchor_is_told_and_ends_proving_until_the_pad_is_commissioned_anew(world):
    ledger = world.contract("pad")
    pad = await ledger.read_pad("pad-1")
    places = dict(world.stand)
    pairs = {(a, b): PairBaseline(_distance(places[a], places[b]), 4.0) for a in places for b in places if a < b}
    Baseline(pairs, 0, "commissioning").save(world.directory / "spool" / "anchors.json", pad.commissioning_sha256)
    east, north, up = world.stand["A3"]
    world.stand["A3"] = (east + 100, north, up)
    async with world.pad(drift=DRIFT) as agent, world.uav() as uav:
        await until(lambda: state_of(agent) == "moved")
        told = agent.status()["drift"]
        assert told["anchor_id"] == "A3"
        assert 50 <= told["off_mm"] <= 170
        assert told["extra_sigma_mm"] >= told["off_mm"]
        result = await uav.prove("pad-1", "land")
        assert result.verdict is None
        assert (result.state, result.end) == ("cancelled", "pad_moved")


def _distance(a, b) -> float:
    return sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) ** 0.5


def test_drift_makes_the_verdict_vaguer_and_is_said(make_duo):
    sure = make_duo()
    sure.run()
    unsure = make_duo(drift_sigma_mm=60)
    unsure.run()
    assert sure.verdict.outcome == "verified"
    codes = {reason.code for reason in unsure.verdict.reasons}
    assert "pad_drifts" in codes
    assert unsure.evidence.drift_sigma_mm == 60
    assert unsure.verdict.covariance.ee_mm2 > 2 * sure.verdict.covariance.ee_mm2
