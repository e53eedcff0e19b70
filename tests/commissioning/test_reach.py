from __future__ import annotations

from dataclasses import replace

import numpy as np

from wonderland.proofs.differences import frames_needed
from wonderland.proofs.honest import narrowed, share_by
from wonderland.proofs.prospects import prospect
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.reach import HeightProspects, TimedProspects, by_distance, middle, reach
from wonderland_edge_agent.commissioning.survey_files import NOWHERE
from wonderland_research.attack_lab.attacks.height import still_at
from wonderland_research.attack_lab.judge import verdict_of
from wonderland_research.attack_lab.places import SQUARE


def test_go_is_said_where_most_honest_drones_are_verified_and_no_further(fitted):
    record = fitted.commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)
    [found] = reach(record, Policy(), buffers_m=[0.5])
    assert found.everywhere_m is not None
    east, north = middle(record)
    policy = Policy(buffer_mm=500)

    def shares(distance_m):
        places = [(distance_m, 0), (0, distance_m), (-distance_m, 0), (0, -distance_m)]
        found = [prospect(record, policy, (east + x) * 1000, (north + y) * 1000, 3000) for x, y in places]
        return [share_by(each, policy, 160) for each in found]

    assert min(shares(found.everywhere_m)) >= 0.9
    assert min(shares(found.everywhere_m + 2.0)) < 0.9
    assert "90 % of honest drones within" in found.sentence()


def test_farther_out_the_share_that_is_left_is_said(fitted):
    record = fitted.commissioning(NOWHERE.frame, valid_from_ms=0, valid_until_ms=1)
    items = by_distance(record, Policy(buffer_mm=500))
    assert items[0].sentence() == "At 2 m: 90 % of honest drones within 10 rounds (±0.5 m)."
    no_go = next(item for item in items if item.rounds < 0)
    assert no_go.share < 0.9
    assert no_go.sentence().endswith("within 160 rounds (±0.5 m), no-go.")
    shares = [round(item.share, 9) for item in items]
    assert shares == sorted(shares, reverse=True)


def test_where_heights_are_said_to_be_proved_they_are():
    """Four anchors, one raised: at the distance that is said, nine honest drones in ten, and well beyond not."""
    record = SQUARE.commissioning
    policy = Policy(height_required=True)
    [found] = reach(record, policy, buffers_m=[1.0], height_m=5.0, kind=HeightProspects)
    assert found.everywhere_m is not None

    def proved(distance_m):
        angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
        place = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(60)]) * distance_m * 1000 + [0, 0, 5_000]
        batch = still_at(np.random.default_rng(1), 2, SQUARE, place, place)
        found = [verdict_of(batch, row, 160).height for row in range(60)]
        return np.mean([height is not None and height.outcome == "proved" for height in found])

    assert proved(found.everywhere_m) >= 0.85
    assert proved(2.5 * found.everywhere_m) < 0.85


def test_what_a_wider_buffer_cannot_settle_no_narrower_one_is_asked_for():
    """Out to where nothing is settled any more: frames by buffer, each found by itself."""
    anchors = (replace(each, clock_offset_mm=0, clock_sigma_mm=7) for each in SQUARE.commissioning.anchors)
    record = replace(SQUARE.commissioning, anchors=tuple(anchors), timestamp_sigma_mm=30)
    policies = [Policy(buffer_mm=buffer_mm) for buffer_mm in (500, 2_000, 5_000)]
    prospects = TimedProspects(record, policies, 3.0)
    settled = set()
    for distance_m in (1.0, 4.0, 7.0, 10.0, 14.0, 25.0):
        place = (distance_m * 600, distance_m * 800, 3_000)
        frames = [frames_needed(record, narrowed(policy), *place) for policy in policies]
        expected = [
            max(each, policy.min_rounds) if 0 < each <= policy.max_rounds else -1
            for each, policy in zip(frames, policies, strict=True)
        ]
        assert list(prospects.rounds(distance_m * 0.6, distance_m * 0.8)) == expected, distance_m
        settled.add(sum(each > 0 for each in expected))
    assert {0, 3} <= settled
    assert settled & {1, 2}, "a narrow buffer that is not settled beside a wide one that is"
