"""The pad counts the rounds in which nobody measured: a drone that breaks off what does not suit it shows there."""

from __future__ import annotations

import random

import pytest

from wonderland_edge_agent.session.evidence import GatheredEvidence
from wonderland_edge_agent.session.ranging import Ranging
from wonderland_edge_agent.session.timing import PadTiming

ANCHORS = ("A0", "A1", "A2", "A3")
INTERVAL_MS = 50
SEEN_FROM_MS = 5_000


@pytest.fixture
def ranging():
    """Ranging that never looks: what it counts is asked for here."""
    return Ranging(
        GatheredEvidence(ANCHORS),
        lambda now_ms: pytest.fail("no look is due"),
        interval_ms=INTERVAL_MS,
        measured_ago_ms=0,
        max_rounds=160,
        timing=PadTiming(),
    )


def play(ranging, rounds, heard):
    """``heard(round)``: positions of the anchors that measure it; each report comes some milliseconds late."""
    rng = random.Random(4)
    ranging.start(SEEN_FROM_MS)
    for number in range(rounds):
        t_ms = SEEN_FROM_MS + INTERVAL_MS * number
        for late_ms, index in sorted((t_ms + rng.randrange(8), index) for index in heard(number)):
            ranging.take(ANCHORS[index], late_ms, 5_000, nlos=False, now_ms=late_ms)


EVERYBODY = range(4)


def test_when_all_is_heard_nothing_is_missing(ranging):
    play(ranging, 9, lambda number: EVERYBODY)
    assert ranging.attempted == 9


def test_before_the_first_round_nothing_was_attempted(ranging):
    assert ranging.attempted == 0
    play(ranging, 60, lambda number: EVERYBODY if number > 55 else ())
    assert ranging.attempted == 4


@pytest.mark.parametrize("every", [2, 5, 10])
def test_a_drone_that_completes_one_round_of_several(ranging, every):
    play(ranging, 5 * every, lambda number: EVERYBODY if number % every == 0 else ())
    assert ranging.attempted == 4 * every + 1


def test_rounds_that_too_few_anchors_measured_were_attempted_too(ranging):
    """A drone can leave two responders out of its frames as well as all of them."""
    play(ranging, 10, lambda number: EVERYBODY if number % 3 == 0 else (0, 2))
    assert ranging.attempted == 10


def test_the_first_round_is_brought_however_few_measured_it(ranging):
    """From its moment on the drone was ranged, so that its claims are judged; the others would only cost air."""
    play(ranging, 12, lambda number: EVERYBODY if number > 4 else (0, 2))
    table = ranging._gathered.table()
    assert ranging.attempted == 12
    assert len(table.t_ms) == 1 + 7
    assert table.t_ms[0] - SEEN_FROM_MS < INTERVAL_MS
    assert table.t_ms[1] - table.t_ms[0] > 4 * INTERVAL_MS


def test_rounds_that_every_node_reports_as_failed_are_missing(ranging):
    ranging.start(SEEN_FROM_MS)
    for number in range(9):
        t_ms = SEEN_FROM_MS + INTERVAL_MS * number
        for anchor in ANCHORS:
            ranging.take(anchor, t_ms, 5_000 if number % 4 == 0 else None, nlos=False, now_ms=t_ms)
    assert ranging.attempted == 9


def test_what_happens_while_a_look_waits_for_a_claim_counts_too(ranging):
    play(ranging, 21, lambda number: EVERYBODY if number < 10 or number == 20 else ())
    assert ranging.attempted == 10 + 10  # a look is due after the tenth round, so that the last one is not gathered


def test_reports_that_come_late_and_all_at_once_miss_nothing(ranging):
    """A busy pad: nine rounds were measured on time, and five of them read half a second later."""
    ranging.start(SEEN_FROM_MS)
    for number in range(9):
        t_ms = SEEN_FROM_MS + INTERVAL_MS * number if number < 4 else SEEN_FROM_MS + INTERVAL_MS * 8 - 4 * (8 - number)
        for anchor in ANCHORS:
            ranging.take(anchor, t_ms, 5_000, nlos=False, now_ms=t_ms)
    assert ranging.attempted == 9


def test_a_clock_that_drifts_by_a_millisecond_each_round_misses_nothing(ranging):
    ranging.start(SEEN_FROM_MS)
    for number in range(9):
        t_ms = SEEN_FROM_MS + (INTERVAL_MS + 1) * number
        for anchor in ANCHORS:
            ranging.take(anchor, t_ms, 5_000, nlos=False, now_ms=t_ms)
    assert ranging.attempted == 9
