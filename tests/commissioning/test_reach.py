from __future__ import annotations

from edge_agent.commissioning.reach import by_distance, middle, reach
from edge_agent.commissioning.survey_files import NOWHERE
from wonderland.proofs.honest import share_by
from wonderland.proofs.prospects import prospect
from wonderland.proofs.records.policies import Policy


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
