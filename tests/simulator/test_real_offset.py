"""Real ranges: the offset that one recording shows is the one of another in the same mounting, and harms no window."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.policies import Policy
from wonderland_edge_agent.commissioning.drone_offset import Ranged, find_offset
from wonderland_edge_agent.commissioning.errors import CalibrationError
from wonderland_edge_agent.commissioning.judging import START_MS
from wonderland_research.evaluate import prepare
from wonderland_research.reproduction.hyu import TRUTH_RAISE_M, TRUTH_SHIFT_S, windows
from wonderland_simulator.recording import Recording, dw1000_commissioning

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "hyu"
POLICY = Policy(buffer_mm=1000, min_rounds=10, max_rounds=20)
DELAY_M = 0.3
NEAR_M = 12.0


@pytest.fixture(scope="module")
def recordings():
    if not DATA.is_dir():
        pytest.skip("the recordings (../shared/data/hyu) are not here")
    return {
        name: Recording.load(
            DATA / f"{name}_b_case_3.csv",
            DATA / f"{name}_b_case_3_anchors.csv",
            truth_shift_s=TRUTH_SHIFT_S,
            truth_raise_m=TRUTH_RAISE_M,
        )
        for name in ("los", "nlos")
    }


def delayed(window, delay_m):
    """The same rounds of a tag whose antenna delay is longer by this."""
    return [
        replace(each, ranges_m={name: value + delay_m if value > 0 else value for name, value in each.ranges_m.items()})
        for each in window
    ]


def prepared(window, commissioning, delay_m):
    return prepare(delayed(window, delay_m), commissioning, POLICY, lambda _, truth: truth)


def offset(recording, delay_m):
    """What the first windows near the pad say, those left out in which the ranges contradict one another."""
    commissioning = dw1000_commissioning(recording.pad(), START_MS)
    chosen = []
    for window in windows(recording.rounds, 20):
        if math.hypot(*window[10].truth_m[:2]) > NEAR_M:
            continue
        ranges = prepared(window, commissioning, delay_m).evidence.ranges
        places = {
            t_ms: tuple(1000 * each for each in item.truth_m) for t_ms, item in zip(ranges.t_ms, window, strict=True)
        }
        session = Ranged(str(len(chosen)), ranges, places.__getitem__)
        try:
            find_offset([session, replace(session, session_id="again")], commissioning, reference_mm=50.0)
        except CalibrationError:
            continue
        chosen.append(session)
        if len(chosen) == 8:
            break
    return find_offset(chosen, commissioning, reference_mm=50.0)


def test_two_recordings_show_the_same_offset(recordings):
    one, other = (offset(recording, 0.0) for recording in recordings.values())
    assert abs(one.offset_mm - other.offset_mm) < 2.0 * math.hypot(one.sigma_mm, other.sigma_mm)
    longer = offset(recordings["los"], DELAY_M)
    assert longer.offset_mm - one.offset_mm == pytest.approx(1000 * DELAY_M, abs=10)


def test_calibrated_on_one_recording_nothing_is_lost_on_the_other(recordings):
    """Beside a pad of 2 by 5 m bearings decide, not offsets: no more windows are verified either."""
    found = offset(recordings["los"], DELAY_M)
    drone = DroneOffset(offset_mm=round(found.offset_mm), sigma_mm=found.stated_sigma_mm, measured_ms=0)
    recording = recordings["nlos"]
    commissioning = dw1000_commissioning(recording.pad(), START_MS)
    plain, calibrated = Counter(), Counter()
    for window in list(windows(recording.rounds, 20))[::2]:
        case = prepared(window, commissioning, DELAY_M)
        plain[case.verdict().outcome] += 1
        calibrated[replace(case, session=replace(case.session, calibration=drone)).verdict().outcome] += 1
    assert plain["verified"] > 5
    assert calibrated["verified"] >= plain["verified"] - 1
    assert calibrated["refuted"] == 0
