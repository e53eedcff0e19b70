"""A drone that is dragged away while it is ranged is refuted by its newest rounds, before it is two buffers off."""

from __future__ import annotations

from dataclasses import replace

import pytest
from kit.proof_world import START_MS, World

from wonderland.proofs.leaving import NEWEST
from wonderland.proofs.stopping import LOOKS
from wonderland.proofs.verdict import preview

PLACE = (5_000.0, 8_000.0, 5_000.0)


def dragged(speed_mm_s, from_ms):
    """Where a drone truly is that holds what its dragged receiver says."""
    return lambda t: (PLACE[0] + max(0.0, t - from_ms) * speed_mm_s / 1000.0, PLACE[1], PLACE[2])


def looked(world, truth, claimed=lambda t: PLACE, looks=LOOKS, **more):
    """The first verdict that settles it, and the time (ms) of its last round."""
    evidence = world.evidence(truth, claimed, rounds=looks[-1], **more)
    for rounds in looks:
        part = type(evidence.ranges)(
            t_ms=evidence.ranges.t_ms[:rounds],
            anchors=tuple(
                type(a)(anchor_id=a.anchor_id, range_mm=a.range_mm[:rounds]) for a in evidence.ranges.anchors
            ),
        )
        verdict = preview(
            world.session(world.claim(claimed(0), START_MS)),
            world.commissioning,
            replace(evidence, ranges=part),
            START_MS + 20_000,
        )
        if verdict.outcome != "inconclusive":
            break
    return verdict, 500 + 50 * (rounds - 1)


@pytest.mark.parametrize("from_ms", [-200, 0, 100])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slow_drag_is_refuted_before_two_buffers(seed, from_ms):
    truth = dragged(1000.0, from_ms)
    verdict, at_ms = looked(World(seed=seed), truth)
    assert verdict.outcome == "refuted"
    assert truth(at_ms)[0] - PLACE[0] < 2_000.0


def test_the_newest_rounds_say_why():
    codes = set()
    for seed in range(6):
        verdict, _ = looked(World(seed=seed), dragged(600.0, -700))
        codes |= {reason.code for reason in verdict.reasons}
        assert verdict.outcome == "refuted"
    assert "leaving" in codes


def test_what_was_within_the_buffer_and_is_leaving_it_is_not_verified():
    world = World(seed=4)
    # Still at its claim for three seconds, then away at once: the mean is well inside.
    evidence = world.evidence(
        lambda t: PLACE if t < 3_600 else (PLACE[0] + 1_150.0, *PLACE[1:]), lambda t: PLACE, rounds=72
    )
    verdict = preview(world.session(world.claim(PLACE, START_MS)), world.commissioning, evidence, START_MS + 20_000)
    assert verdict.outcome != "verified"
    assert {"leaving", "drifting", "claims_waver"} & {reason.code for reason in verdict.reasons}


@pytest.mark.parametrize("seed", range(8))
def test_honest_drones_that_hover_or_fly_are_not_touched(seed):
    def flying(t):
        return (PLACE[0] + 3.0 * t, PLACE[1] - 2.0 * t, PLACE[2])

    for path in (lambda t: PLACE, flying):
        verdict, _ = looked(World(seed=seed), path, path, looks=(10, 24, 60, 124))
        assert verdict.outcome == "verified"
        assert not {"leaving", "drifting"} & {reason.code for reason in verdict.reasons}


def test_few_rounds_are_judged_as_they_are():
    verdict, _ = looked(World(seed=1), lambda t: PLACE, looks=(NEWEST,))
    assert {reason.code for reason in verdict.reasons} >= {"too_few_rounds"}
