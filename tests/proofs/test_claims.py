"""Claimed places for many moments in one pass: the same as one by one."""

from __future__ import annotations

import random

import pytest
from kit.proof_world import FRAME, START_MS, World

from wonderland.proofs.claims import ClaimedPath


def path_of(times_ms, seed=1):
    world, rng = World(), random.Random(seed)
    claims = [world.claim((rng.uniform(-9e3, 9e3), rng.uniform(-9e3, 9e3), 4e3), START_MS + t) for t in times_ms]
    return ClaimedPath(FRAME, claims)


@pytest.mark.parametrize("claimed", [[0], [0, 200, 400], [0, 200, 200, 9_000], [0, 3_900, 8_100, 8_100, 20_000]])
@pytest.mark.parametrize("seed", range(5))
def test_a_track_has_the_places_of_its_moments(claimed, seed):
    path = path_of(claimed, seed)
    rng = random.Random(seed)
    moments = sorted(START_MS + rng.randrange(-4_000, 24_000) for _ in range(200))
    track = path.along(moments)
    one_by_one = [(position, path.at(t_ms)) for position, t_ms in enumerate(moments)]
    expected = [(position, place) for position, place in one_by_one if place is not None]
    assert list(track.kept) == [position for position, _ in expected]
    assert track.t_ms == [place.t_ms for _, place in expected]
    columns = zip(track.east, track.north, track.up, strict=True)
    assert list(columns) == [(place.east, place.north, place.up) for _, place in expected]
    some = range(0, len(track.kept), 2)
    assert track.only(some).east == track.east[::2]


def test_nothing_is_along_no_moments_or_moments_far_from_every_claim():
    path = path_of([0, 200])
    assert list(path.along([]).kept) == []
    assert list(path.along([START_MS + 60_000]).kept) == []


def test_the_velocity_is_that_between_the_claims_it_rests_on():
    world = World()
    path = ClaimedPath(FRAME, [world.claim((1_000.0 * step, 0.0, 4_000.0), START_MS + 500 * step) for step in range(5)])
    east, north = path.along([START_MS + 300, START_MS + 1_700]).velocity()
    assert east == pytest.approx(2.0, rel=1e-2)  # a claim is whole 10⁻⁷ degrees
    assert abs(north) < 1e-2
    late = path.along([START_MS + 1_000, START_MS + 2_080])  # after the last claim its own time counts
    assert late.t_ms == [START_MS + 1_000, START_MS + 2_000]
    assert late.velocity()[0] == pytest.approx(2.0, rel=1e-2)
    assert path.along([START_MS + 300]).velocity() == (0.0, 0.0)
