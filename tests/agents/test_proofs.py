"""Whole proofs: radio bytes, agents, signed transactions, blocks, permission."""

from __future__ import annotations


async def test_an_honest_drone_is_verified_permitted_and_completes(world):
    async with world.pad(), world.uav() as uav:
        result = await uav.prove("pad-1", "land")
    assert (result.state, result.end) == ("completed", "done"), result
    assert result.verdict.outcome == "verified"
    print(result.steps, result.verdict.reasons, result.verdict.rounds)
