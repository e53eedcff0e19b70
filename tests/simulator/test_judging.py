"""`wonderland_research.judge`: ranges in memory, as arrays and frames, judged as a file of the same would be."""

from __future__ import annotations

import csv

import numpy as np
import pandas as pd
import pytest

from wonderland_research import InputError, judge
from wonderland_research.evaluate import EvaluateSettings, evaluate

ANCHORS = {"3": (1.5, 1.5, 0.3), "5": (-1.5, 1.5, 1.5), "9": (-1.5, -1.5, 0.3), "12": (1.5, -1.5, 0.3)}
T_S = np.arange(60) / 20
TRUTH = np.stack([-1.5 + T_S, np.full(60, 3.0), np.full(60, 3.0)], axis=1)
RANGES = np.round(
    np.linalg.norm(TRUTH[:, None] - np.array(list(ANCHORS.values())), axis=2)
    + np.random.default_rng(1).normal(0, 0.02, (60, 4)),
    4,
)


def lines(windows):
    return [{key: value for key, value in window.line().items() if key != "recording"} for window in windows]


@pytest.fixture
def files(tmp_path):
    ranges, anchors = tmp_path / "ranges.csv", tmp_path / "anchors.csv"
    with anchors.open("w", newline="") as file:
        csv.writer(file).writerows([["anchor", "x", "y", "z"], *([name, *at] for name, at in ANCHORS.items())])
    with ranges.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "anchor", "range", "gt_x", "gt_y", "gt_z"])
        for t_s, row, at in zip(T_S, RANGES, TRUTH, strict=True):
            writer.writerows([t_s, name, value, *at] for name, value in zip(ANCHORS, row, strict=True))
    return ranges, anchors


def test_an_array_a_wide_frame_a_long_frame_and_a_file_are_the_same(files):
    path = pd.DataFrame(TRUTH, columns=list("xyz")).assign(t=T_S)
    places = pd.DataFrame([(name, *at) for name, at in ANCHORS.items()], columns=["anchor", "x", "y", "z"])
    wide = pd.DataFrame(RANGES, columns=list(ANCHORS)).assign(t=T_S)
    long = wide.melt("t", var_name="anchor", value_name="range").sort_values("t", kind="stable")
    by_array = lines(judge(RANGES, ANCHORS, TRUTH, t_s=T_S, truth=TRUTH))
    assert len(by_array) == 3
    assert {line["outcome"] for line in by_array} == {"verified"}
    assert by_array == lines(evaluate(EvaluateSettings(*files)))
    assert by_array == lines(judge(wide, places, path, truth=path))
    assert by_array == lines(judge(long, places, TRUTH, truth=TRUTH))


def test_lies_missing_ranges_and_no_truth():
    lie = lines(judge(RANGES, ANCHORS, TRUTH + np.array([0.0, 4.0, 0.0]), t_s=T_S))
    assert {line["outcome"] for line in lie} == {"refuted"}
    assert all("truth_error_m" not in line for line in lie)
    few = RANGES.copy()
    few[::3, 0] = np.nan
    (first, *_) = lines(judge(few, ANCHORS, TRUTH, t_s=T_S))
    assert first["rounds"] <= 20
    assert len(judge(RANGES, ANCHORS, TRUTH, t_s=T_S, rounds=30)) == 2
    assert judge(RANGES[:5], ANCHORS, TRUTH[:5], t_s=T_S[:5]) == []


def test_a_commissioning_is_taken_as_a_record_as_json_and_from_a_file(tmp_path):
    from wonderland_simulator.recording import Recording, dw1000_commissioning

    record = dw1000_commissioning(Recording((), ANCHORS).pad(), 1_800_000_000_000)
    path = tmp_path / "commissioning.json"
    path.write_bytes(record.encode())
    expected = lines(judge(RANGES, ANCHORS, TRUTH, t_s=T_S))
    for given in (record, record.to_json(), path, str(path)):
        assert lines(judge(RANGES, ANCHORS, TRUTH, given, t_s=T_S)) == expected
    moved = {name: (x + 1.0, y, z) for name, (x, y, z) in ANCHORS.items()}
    with pytest.raises(InputError, match=r"anchor 3 1\.00 m away"):
        judge(RANGES, moved, TRUTH, record, t_s=T_S)


LONG = pd.DataFrame({"t": [0.0, 0.1], "anchor": ["3", "X"], "range": [1.0, 2.0]})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"t_s": None}, "t_s: say when each round was"),
        ({"t_s": T_S[:-1]}, "59 times for 60 rounds"),
        ({"t_s": T_S[::-1]}, "time goes backwards"),
        ({"t_s": T_S + np.nan}, "t_s: has values that are not finite"),
        ({"ranges": RANGES[:, :3]}, r"ranges: an array of shape \(60, 3\); \(n, 4\) is needed"),
        ({"ranges": "ranges.csv"}, "ranges: no numbers"),
        ({"ranges": LONG, "t_s": None}, "ranges: of X, which anchors does not have"),
        ({"ranges": LONG}, "t_s: is for arrays"),
        ({"ranges": LONG.drop(columns="anchor"), "t_s": None}, "without a column '3'; it has t, range"),
        ({"anchors": {"3": (0, 0, 0)}}, "anchors: 1; at least 3 are needed"),
        ({"anchors": np.zeros((4, 2))}, r"anchors: an array of shape \(4, 2\)"),
        ({"claims": TRUTH[:7]}, "claims: 7 places for 60 rounds"),
        ({"claims": TRUTH + np.inf}, "claims: has values that are not finite"),
        ({"claims": TRUTH + 1e9}, "nowhere on Earth"),
        ({"claims": pd.DataFrame({"t": [90.0], "x": [0], "y": [0], "z": [0]})}, "claims: from 90 to 90 s"),
        ({"commissioning": {"anchors": []}}, "commissioning: no record of one"),
        ({"commissioning": "nowhere.json"}, "no commissioning record"),
        ({"rounds": 0}, "rounds: 0; between 1 and 500"),
        ({"buffer_m": float("nan")}, "buffer_m: nan m"),
    ],
)
def test_what_cannot_be_judged_is_said(change, says):
    given = {"ranges": RANGES, "anchors": ANCHORS, "claims": TRUTH, "t_s": T_S, "commissioning": None} | change
    with pytest.raises(InputError, match=says):
        judge(**given)
