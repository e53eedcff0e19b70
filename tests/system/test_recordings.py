from __future__ import annotations

import csv
import math
import random

import pytest

from wonderland_simulator.recording import Recording, RecordingError

ANCHORS = {"1": (1.5, 1.5, 1.6), "2": (-1.5, 1.5, 0.2), "3": (-1.5, -1.5, 0.2), "4": (1.5, -1.5, 0.2)}


@pytest.fixture
def recording(tmp_path):
    """A tag that walks past a pad at 0.5 m/s, ranged at 10 Hz with the bias of a DW1000."""
    rng = random.Random(5)
    with (tmp_path / "anchors.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("anchor", "x", "y", "z"))
        writer.writerows((name, *place) for name, place in ANCHORS.items())
    with (tmp_path / "ranges.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("t", "anchor", "range", "rssi", "gt_x", "gt_y", "gt_z"))
        for step in range(180):
            t = step / 10
            truth = (3.0 + 0.05 * step / 10, 5.0 - 0.5 * t / 2, 2.0)
            for index, (name, place) in enumerate(ANCHORS.items()):
                measured = math.dist(truth, place) + rng.gauss(0.0, 0.03)
                writer.writerow((f"{t + index / 1000:.4f}", name, f"{measured:.4f}", -80, *truth))
    return ["--recording", str(tmp_path / "ranges.csv"), "--anchors", str(tmp_path / "anchors.csv")]


@pytest.mark.timeout(150)
def test_a_recording_goes_the_whole_way(wonderland, recording):
    code, lines, errors = wonderland("simulate", *recording, "--rounds", "20", "--windows", "4", "--json")
    assert code == 0, errors
    assert [line["outcome"] for line in lines] == ["verified"] * 4
    assert all(line["from_s"] < line["to_s"] for line in lines)
    assert "4 in the mirror" in " ".join(errors.split())


@pytest.mark.timeout(150)
def test_the_same_recording_with_a_lie_of_three_metres(wonderland, recording):
    code, lines, errors = wonderland("simulate", *recording, "--windows", "3", "--claim", "offset:3,0,0", "--json")
    assert code == 0, errors
    assert [line["outcome"] for line in lines] == ["refuted"] * 3
    assert all(line["error_m"] == pytest.approx(3.0, abs=0.5) for line in lines)


@pytest.mark.timeout(200)
@pytest.mark.parametrize("case", ["los_a_case_1", "nlos_a_case_1"])
def test_real_ranges_never_refute_an_honest_tag(wonderland, hyu, case):
    files = ["--recording", str(hyu / f"{case}.csv"), "--anchors", str(hyu / f"{case}_anchors.csv")]
    truth = ["--truth-shift", "-0.175", "--truth-raise", "1.05"]
    code, lines, errors = wonderland("simulate", *files, *truth, "--windows", "12", "--json", timeout_s=150)
    assert code == 0, errors
    outcomes = [line["outcome"] for line in lines]
    assert len(outcomes) == 12
    assert "refuted" not in outcomes
    assert "verified" in outcomes


def test_real_ranges_refute_a_lie_of_three_metres_and_never_verify_it(wonderland, hyu):
    files = ["--recording", str(hyu / "los_a_case_1.csv"), "--anchors", str(hyu / "los_a_case_1_anchors.csv")]
    truth = ["--truth-shift", "-0.175", "--truth-raise", "1.05"]
    code, lines, errors = wonderland("simulate", *files, *truth, "--windows", "8", "--claim", "offset:3,0,0", "--json")
    assert code == 0, errors
    outcomes = [line["outcome"] for line in lines]
    assert "verified" not in outcomes
    assert outcomes.count("refuted") >= 5


@pytest.mark.timeout(300)  # four whole systems, one after the other
def test_the_papers_four_points(wonderland, tmp_path):
    figure, sequence = tmp_path / "paper.svg", tmp_path / "sequence.svg"
    drawn = ("--plot", str(figure), "--sequence", str(sequence))
    code, lines, errors = wonderland("reproduce", "paper", "--json", *drawn, timeout_s=270)
    assert code == 0, errors
    assert [line["point"] for line in lines] == ["S1", "S2", "L1", "L2"]
    for line in lines:
        assert line["outcome"] == "verified"
        assert line["paper_rule"]
        assert line["error_m"] < 4 * line["cramer_rao_m"]
    # The bound for one round, as computed for this geometry by hand: bearing is the hard part at a distance.
    assert [line["cramer_rao_one_round_m"] for line in lines] == pytest.approx([0.26, 0.30, 1.80, 1.97], abs=0.02)
    for path in (figure, sequence):
        assert path.read_text().lstrip().startswith("<svg")
    steps = ["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
    for line in lines:
        times = [line["since_request_ms"][step] for step in steps]
        assert times[0] == 0
        assert times == sorted(times)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("anchors.csv", "anchor,x,y,z\n1,0,0,0\n", "at least 3"),
        ("anchors.csv", "anchor,x,y\n1,0,0\n", "no column z"),
        ("anchors.csv", "anchor,x,y,z\n1,0,zero,0\n", "line 2: y is no number"),
        ("ranges.csv", "", "the file is empty; it needs t, anchor, range"),
        ("ranges.csv", "t,anchor,range,gt_x,gt_y,gt_z\n", "no ranges in it"),
        ("ranges.csv", "t,anchor,range,gt_x,gt_y,gt_z\n1,9,5,0,0,0\n", "anchor '9' is not in"),
        ("ranges.csv", "t,anchor,range,gt_x,gt_y,gt_z\n1,1,nan,0,0,0\n", "range is nan"),
        ("ranges.csv", "t,anchor,range,gt_x,gt_y,gt_z\n2,1,5,0,0,0\n1,1,5,0,0,0\n", "time goes backwards"),
        ("ranges.csv", "t,anchor,range,gt_x,gt_y,gt_z\n1,1,5\n", "too few columns"),
    ],
)
def test_files_that_are_no_recordings(recording, tmp_path, name, text, complaint):
    (tmp_path / name).write_text(text)
    with pytest.raises(RecordingError, match=complaint):
        Recording.load(tmp_path / "ranges.csv", tmp_path / "anchors.csv")


def test_a_claim_that_is_none_is_explained(wonderland, recording):
    code, _, errors = wonderland("simulate", *recording, "--claim", "offset:3")
    assert code == 1
    assert "offset:3,0,0" in errors
