"""Blinks gathered from several ports: by number, in any order, over the counter's end; strangers' do not count."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.records.sessions import MAX_FRAMES, TimeStamps
from wonderland_edge_agent.session.frames import MAX_TICKS, WINDOW_MS, FrameGatherer

NAMES = ("A1", "A2", "A3", "A4")
ANSWER = b"answered"
START_MS = 1_800_000_000_000


@pytest.fixture
def gatherer():
    made = FrameGatherer(NAMES, "challenge")
    made.expect(ANSWER)
    return made


def heard(gatherer, number, ticks, t_ms=None, payload=ANSWER):
    """One blink as every node in ``ticks`` reports it."""
    for name, value in ticks.items():
        gatherer.add(name, START_MS + 50 * number if t_ms is None else t_ms, number, value, payload)


def test_differences_are_taken_within_one_blink_and_over_the_counters_end(gatherer):
    end = 2**40
    heard(gatherer, 1, {"A1": 1_000, "A2": 1_500, "A3": 900, "A4": 1_000})
    heard(gatherer, 2, {"A1": end - 100, "A2": 400, "A3": end - 200, "A4": end - 100})
    stamps = gatherer.stamps()
    assert [anchor.ticks for anchor in stamps.anchors] == [(100, 100), (600, 600), (0, 0), (100, 100)]
    assert stamps.gap_ms == (0, 50)
    assert stamps.start_ms == START_MS + 50
    assert stamps.bound_by == "challenge"


def test_a_blink_that_a_node_did_not_hear_is_kept_with_a_gap(gatherer):
    heard(gatherer, 1, {"A1": 10, "A3": 30, "A4": 20})
    assert gatherer.frames == 0
    gatherer.expire(START_MS + 50 + WINDOW_MS)
    assert [anchor.ticks for anchor in gatherer.stamps().anchors] == [(0,), (-1,), (20,), (10,)]


def test_reports_of_one_node_alone_are_none(gatherer):
    heard(gatherer, 1, {"A1": 10})
    gatherer.expire(START_MS + 1_000)
    assert gatherer.stamps() is None


def test_only_blinks_with_the_answer_count_and_none_before_the_challenge():
    gatherer = FrameGatherer(NAMES, "challenge")
    heard(gatherer, 1, dict.fromkeys(NAMES, 5))
    gatherer.expect(ANSWER)
    heard(gatherer, 2, dict.fromkeys(NAMES, 5), payload=b"")
    heard(gatherer, 3, dict.fromkeys(NAMES, 5), payload=b"answered?")
    assert (gatherer.frames, gatherer.foreign) == (0, 8)
    heard(gatherer, 4, dict.fromkeys(NAMES, 5))
    assert gatherer.frames == 1


def test_a_repeated_number_counts_once_and_a_repeated_report_not_at_all(gatherer):
    heard(gatherer, 7, {"A1": 10, "A2": 20})
    heard(gatherer, 7, {"A1": 99, "A3": 30, "A4": 40})
    heard(gatherer, 7, dict.fromkeys(NAMES, 1))
    heard(gatherer, 6, dict.fromkeys(NAMES, 1))
    assert [anchor.ticks for anchor in gatherer.stamps().anchors] == [(0,), (10,), (20,), (30,)]


def test_a_stamp_that_no_light_explains_is_left_out(gatherer):
    heard(gatherer, 1, {"A1": 0, "A2": 50, "A3": MAX_TICKS + 60, "A4": 20})
    assert [anchor.ticks for anchor in gatherer.stamps().anchors] == [(0,), (50,), (-1,), (20,)]


def test_frozen_and_full_it_takes_no_more(gatherer):
    for number in range(MAX_FRAMES + 20):
        heard(gatherer, number, dict.fromkeys(NAMES, 5))
    assert gatherer.frames == MAX_FRAMES
    assert TimeStamps.parse(gatherer.stamps().to_json()) == gatherer.stamps()
    other = FrameGatherer(NAMES, "key")
    other.expect(ANSWER)
    other.frozen = True
    heard(other, 1, dict.fromkeys(NAMES, 5))
    assert other.stamps() is None


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.1, 0.5]), delay_ms=st.integers(0, 12))
def test_whatever_the_serial_lines_do_the_differences_are_those_of_the_air(seed, loss, delay_ms):
    rng = random.Random(seed)
    gatherer = FrameGatherer(NAMES, "challenge")
    gatherer.expect(ANSWER)
    reports = []
    truth = {}
    start = rng.randrange(2**40)
    for number in range(1, 30):
        offsets = {name: rng.randrange(0, 20_000) for name in NAMES if rng.random() >= loss}
        truth[number] = offsets
        for name, offset in offsets.items():
            ticks = (start + number * 3_194_880_000 + offset) % 2**40
            reports.append((START_MS + 50 * number + rng.randint(0, delay_ms), name, number, ticks))
    for t_ms, name, number, ticks in sorted(reports):
        gatherer.add(name, t_ms, number, ticks, ANSWER)
    gatherer.expire(START_MS + 10_000)
    stamps = gatherer.stamps()
    rows = [] if stamps is None else list(zip(*(anchor.ticks for anchor in stamps.anchors), strict=True))
    expected = []
    for offsets in truth.values():
        if len(offsets) >= 2:
            first = min(offsets.values())
            expected.append(tuple(offsets[name] - first if name in offsets else -1 for name in NAMES))
    assert rows == expected
    if stamps is not None:
        assert TimeStamps.parse(stamps.to_json()) == stamps
