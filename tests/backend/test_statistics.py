"""Statistics count what is on the ledger, on both databases, and nothing twice."""

from __future__ import annotations

from itertools import pairwise

import pytest

from wonderland_backend.statistics.queries import percentile, step_times

START_MS = 1_800_000_000_000
HOUR_MS = 3_600_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
SPAN = {"since_ms": START_MS - HOUR_MS, "until_ms": START_MS + HOUR_MS, "bin_ms": 600_000}


@both
async def test_verdicts_by_time_pad_operator_and_action(running):
    found = await running.json("/statistics", **SPAN)
    assert found["total"] == {"verified": 1, "refuted": 1, "inconclusive": 0, "granted": 1}
    assert sum(each["verified"] + each["refuted"] for each in found["bins"]) == 2
    starts = [each["start_ms"] for each in found["bins"]]
    assert len(starts) in {12, 13}
    assert all(later - earlier == 600_000 for earlier, later in pairwise(starts))
    assert [(each["id"], each["verified"], each["refuted"]) for each in found["pads"]] == [("pad-1", 1, 1)]
    assert [each["id"] for each in found["operators"]] == ["fleet"]
    assert [each["id"] for each in found["actions"]] == ["land"]
    assert sum(found["likelihood"]) == sum(each["count"] for each in found["error"]) == 2
    assert (found["proofs_per_hour"], found["busiest_hour"]) == (1.0, 2)
    steps = [each["step"] for each in found["steps"]]
    assert steps[0] == "poll"
    assert steps[-1] == "verdict"
    assert all(0 <= each["p50_ms"] <= each["p95_ms"] for each in found["steps"])
    for total in found["step_totals"]:
        own = [each for each in found["steps"] if each["step"] == total["step"]]
        assert total["count"] == sum(each["count"] for each in own) > 0
        assert min(each["p95_ms"] for each in own) <= total["p95_ms"] <= max(each["p95_ms"] for each in own)
    assert {each["step"] for each in found["step_totals"]} == set(steps)


@both
async def test_what_is_filtered_away_is_not_counted(running):
    for more in ({"pad": "pad-2"}, {"operator": "nobody"}, {"action": "dock"}, {"since_ms": START_MS + 60_000}):
        found = await running.json("/statistics", **(SPAN | more))
        assert found["total"]["verified"] == 0
        assert found["pads"] == []
    assert (await running.json("/statistics", **SPAN, operator="fleet"))["total"]["verified"] == 1


@pytest.mark.parametrize(
    "more",
    [
        {"until_ms": START_MS - 2 * HOUR_MS},
        {"bin_ms": 1_000},
        {"since_ms": 0, "bin_ms": 60_000},
        {"pad": "%"},
        {"colour": "red"},
    ],
)
async def test_spans_that_make_no_sense_are_refused(running, more):
    assert (await running.get("/statistics", params=SPAN | more)).status_code == 422


def test_step_times_and_percentiles():
    steps = [{"step": "poll", "t_ms": 120}, {"step": "range", "t_ms": 90}, {"step": "unknown", "t_ms": 1}]
    assert step_times(100, 300, steps) == [("poll", 20), ("range", 0), ("verdict", 210)]
    assert [percentile([1, 2, 3, 4], each) for each in (50, 95, 100)] == [2, 4, 4]
    assert percentile([7], 50) == 7
