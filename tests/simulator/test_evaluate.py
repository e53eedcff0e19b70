from __future__ import annotations

import json
import math
import random
import re

import pytest
from click.testing import CliRunner

from wonderland_research.evaluate import EvaluateSettings, claims_of, evaluate
from wonderland_research.evaluate_command import evaluate as command
from wonderland_simulator.recording import Recording, RecordingError, dw1000_commissioning

ANCHORS = {"3": (1.5, 1.5, 0.3), "5": (-1.5, 1.5, 1.5), "9": (-1.5, -1.5, 0.3), "12": (1.5, -1.5, 0.3)}


@pytest.fixture
def files(tmp_path):
    """A tag that flies past at 1 m/s, 20 rounds a second, σ = 2 cm."""
    rng = random.Random(1)
    ranges, anchors = tmp_path / "ranges.csv", tmp_path / "anchors.csv"
    anchors.write_text("anchor,x,y,z\n" + "".join(f"{n},{x},{y},{z}\n" for n, (x, y, z) in ANCHORS.items()))
    rows = ["t,anchor,range,gt_x,gt_y,gt_z"]
    for index in range(200):
        t_s = 0.05 * index
        truth = (-3.0 + t_s, 5.0, 3.0)
        for offset, (name, place) in enumerate(ANCHORS.items()):
            measured = math.dist(truth, place) + rng.gauss(0, 0.02)
            rows.append(f"{t_s + 0.001 * offset:.4f},{name},{measured:.4f},{truth[0]:.4f},{truth[1]},{truth[2]}")
    ranges.write_text("\n".join(rows) + "\n")
    return ranges, anchors


def commissioned(tmp_path, files):
    """A commissioning of these anchors that knows them well."""
    record = dw1000_commissioning(Recording.load(*files).pad(), 1_800_000_000_000).to_json()
    for anchor in record["anchors"]:
        anchor["bias"] = [{"range_mm": 0, "bias_mm": 0, "sigma_mm": 10}]
    record |= {"installation_sigma_mm": 10, "range_sigma_mm": 20}
    path = tmp_path / "commissioning.json"
    path.write_text(json.dumps(record))
    return path


def run(*args):
    result = CliRunner().invoke(command, [str(arg) for arg in args])
    lines = [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]
    return result, lines


def test_truth_is_verified_and_a_lie_is_refuted_window_by_window(tmp_path, files):
    ranges, anchors = files
    more = ("--recording", ranges, "--anchors", anchors, "--commissioning", commissioned(tmp_path, files), "--json")
    result, lines = run(*more)
    assert (result.exit_code, len(lines)) == (0, 10)
    assert {line["outcome"] for line in lines} == {"verified"}
    assert all(line["truth_error_m"] < 0.2 and line["likelihood"] >= 0.99 for line in lines)
    assert lines[1]["from_s"] == pytest.approx(1.0)
    assert set(lines[0]["covariance_mm2"]) == {"ee_mm2", "en_mm2", "nn_mm2"}
    assert all(line["height"]["sigma_m"] > 0 for line in lines)
    assert {line["height"]["outcome"] for line in lines} <= {"proved", "claimed"}
    _, lines = run(*more, "--claim", "offset:0,3,0", "--windows", "4")
    assert [line["outcome"] for line in lines] == ["refuted"] * 4
    assert all(2.7 < line["error_m"] < 3.3 for line in lines)
    assert {reason["code"] for line in lines for reason in line["reasons"]} >= {"outside_buffer"}


def test_a_file_of_claims_is_followed(tmp_path, files):
    ranges, anchors = files
    path = tmp_path / "claims.csv"
    path.write_text("t,x,y,z\n0,-3,5,3\n10,7,5,3\n")
    settings = EvaluateSettings(ranges, anchors, commissioned(tmp_path, files), f"csv:{path}", rounds=40)
    assert [window.verdict.outcome for window in evaluate(settings)] == ["verified"] * 5
    assert claims_of(f"csv:{path}")(2.5, (0, 0, 0)) == pytest.approx((-0.5, 5, 3))
    path.write_text("t,x,y,z\n0,-3,5,3\n10,-3,5,3\n")  # it says that it hovers, and flies
    last = list(evaluate(settings))[-1]
    assert last.verdict.outcome == "refuted"


def test_a_claim_far_away_is_a_reason_in_every_window(tmp_path, files):
    more = ("--recording", files[0], "--anchors", files[1])
    result, lines = run(*more, "--claim", "offset:12000000,0,0", "--json")
    assert (result.exit_code, len(lines)) == (3, 10)
    assert {line["outcome"] for line in lines} == {"inconclusive"}
    assert all("claim_far_away" in {reason["code"] for reason in line["reasons"]} for line in lines)
    claims = tmp_path / "claims.csv"
    claims.write_text("t,x,y,z\n0,-3,5,3\n3.96,0.96,5,3\n3.97,12000000,0,0\n10,12000000,0,0\n")
    result, lines = run(*more, "--claim", f"csv:{claims}", "--json")
    assert result.exit_code == 0
    assert ["likelihood" in line for line in lines] == [True] * 4 + [False] * 6
    result, _ = run(*more, "--claim", "offset:12000000,0,0")
    assert result.output.count("no estimate") == 10
    assert "nan" not in result.output


@pytest.mark.parametrize("content", ["t,x\n1,2\n", "t,x,y,z\n1,2,3,x\n", "t,x,y,z\n", "t,x,y,z\n2,0,0,0\n1,0,0,0\n"])
def test_files_that_hold_no_claims(tmp_path, content):
    path = tmp_path / "claims.csv"
    path.write_text(content)
    with pytest.raises(RecordingError, match=r"claims\.csv"):
        claims_of(f"csv:{path}")


def test_what_cannot_be_judged_is_said(tmp_path, files):
    ranges, anchors = files
    other = tmp_path / "commissioning.json"
    other.write_text("{}")
    result, _ = run("--recording", ranges, "--anchors", anchors, "--commissioning", other)
    assert result.exit_code == 1
    assert "no commissioning record" in result.output
    result, _ = run("--recording", ranges, "--anchors", anchors, "--claim", "somewhere")
    assert result.exit_code == 1
    assert "offset:3,0,0" in result.output
    result, _ = run("--recording", ranges, "--anchors", anchors, "--json", "--claim", "offset:900000000,0,0")
    assert isinstance(result.exception, SystemExit)
    assert "at 0.000 s" in result.output
    assert "(--claim, --truth-raise)" in result.output
    record = json.loads(commissioned(tmp_path, files).read_text())
    record["anchors"][0]["anchor_id"] = "other"
    other.write_text(json.dumps(record))
    result, _ = run("--recording", ranges, "--anchors", anchors, "--commissioning", other)
    assert "but not the recording's 3" in result.output


@pytest.fixture
def bare(tmp_path, files):
    """The same ranges without truth, and the drone's claims in a file of their own."""
    ranges, claims = tmp_path / "bare.csv", tmp_path / "said.csv"
    rows = [line.split(",") for line in files[0].read_text().splitlines()]
    ranges.write_text("\n".join(",".join(row[:3]) for row in rows) + "\n")
    claims.write_text("t,x,y,z\n0,-3,5,3\n10,7,5,3\n")
    return ranges, claims


def test_ranges_and_claims_are_enough(tmp_path, files, bare):
    more = ("--recording", bare[0], "--anchors", files[1], "--commissioning", commissioned(tmp_path, files), "--json")
    result, lines = run(*more, "--claim", f"csv:{bare[1]}", "--report", tmp_path / "report")
    assert (result.exit_code, {line["outcome"] for line in lines}) == (0, {"verified"})
    assert all("truth_error_m" not in line and "estimate_m" in line for line in lines)
    assert lines[0]["distance_m"] == pytest.approx(math.hypot(-2.5, 5.0), abs=0.1)
    assert {path.name for path in (tmp_path / "report").iterdir()} == {
        "report.html", "path.png", "likelihood.png", "residuals.png",
    }  # fmt: skip
    result, lines = run(*more)
    assert (result.exit_code, lines) == (1, [])
    assert "--claim csv:FILE" in result.output


def test_a_reference_of_ones_own_is_taken_with_its_delay(tmp_path, files, bare):
    """As [truth] in pad.toml records it; this one comes 0.3 s late."""
    track = tmp_path / "track.csv"
    track.write_text("t,x,y,z\n" + "".join(f"{t / 10 + 0.3},{-3 + t / 10},5,3\n" for t in range(-10, 120)))
    more = ("--recording", bare[0], "--anchors", files[1], "--commissioning", commissioned(tmp_path, files))
    more += ("--reference", track, "--json")
    result, lines = run(*more, "--truth-shift", "auto")
    assert (result.exit_code, len(lines)) == (0, 10)
    assert all(line["truth_error_m"] < 0.2 for line in lines)
    assert "Of each range the truth 0.3" in result.output
    assert "s later was taken" in result.output
    _, lines = run(*more)
    assert all(0.2 < line["truth_error_m"] < 0.4 for line in lines[1:]), "0.3 s at 1 m/s"


def test_references_that_are_none(tmp_path, files, bare):
    more = ("--recording", bare[0], "--anchors", files[1])
    result, _ = run(*more, "--reference", files[1])
    assert (result.exit_code, "no reference; it needs the columns" in result.output) == (1, True)
    result, _ = run(*more, "--claim", f"csv:{bare[1]}", "--truth-shift", "auto")
    assert (result.exit_code, "there is no truth whose delay could be found" in result.output) == (1, True)
    result, _ = run(*more, "--truth-shift", "30")
    assert (result.exit_code, "bring the clocks together first" in result.output) == (2, True)


def test_the_error_is_that_at_the_estimates_time(tmp_path, files):
    """The place is one of a moment at which rounds were: half come in the first tenth, half in the last."""
    ranges, anchors = files
    head, *rows = ranges.read_text().splitlines()
    kept = [row for row in rows if not 0.5 < float(row.split(",")[0]) < 9.5]
    ranges.write_text("\n".join([head, *kept]) + "\n")
    (window,) = evaluate(EvaluateSettings(ranges, anchors, commissioned(tmp_path, files), rounds=20))
    assert min(abs(window.at_s - end) for end in (0.25, 9.7)) < 0.3
    assert window.truth_m[0] == pytest.approx(-3.0 + window.at_s, abs=0.01)
    assert window.truth_error_m < 0.4  # 4 m and more from the truth of any other moment


def test_commission_first_is_said_with_the_command(tmp_path, files):
    far = tmp_path / "far.csv"
    rng = random.Random(3)
    rows = ["t,anchor,range,gt_x,gt_y,gt_z"]
    for index in range(200):
        truth = (-3.0 + 0.05 * index, 35.0, 3.0)
        for name, place in ANCHORS.items():
            rows.append(f"{0.05 * index:.3f},{name},{math.dist(truth, place) + 0.14 + rng.gauss(0, 0.02):.4f},"
                        f"{truth[0]:.3f},{truth[1]},{truth[2]}")  # fmt: skip
    far.write_text("\n".join(rows) + "\n")
    result, _ = run("--recording", far, "--anchors", files[1], "--truth-raise", "0.01")
    assert result.exit_code == 4
    assert "Commission first" in result.output
    assert f"wonderland pad commission --recording OTHER.csv --anchors {files[1]} --truth-raise 0.01" in result.output
    result, _ = run("--recording", far, "--anchors", files[1], "--commissioning", commissioned(tmp_path, files))
    assert result.exit_code == 0
    assert "Commission first" not in result.output


def late(path, target, anchors, metres):
    head, *rows = path.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    for row in cells:
        if row[1] in anchors:
            row[2] = str(float(row[2]) + metres)
    target.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    return target


def test_antenna_delays_are_named_with_their_size(tmp_path, files, bare):
    one = late(files[0], tmp_path / "one.csv", {"9"}, 0.31)
    result, _ = run("--recording", one, "--anchors", files[1])
    assert re.search(r"one: Anchor 9's ranges are 0\.3\d m longer than the others'; uncalibrated DW1000", result.output)
    assert result.output.count("antenna delay") == 1
    every = late(files[0], tmp_path / "every.csv", set(ANCHORS), -0.25)
    result, _ = run("--recording", every, "--anchors", files[1])
    assert re.search(r"every: All anchors' ranges are 0\.2\d m too short", result.output)
    blind = late(bare[0], tmp_path / "blind.csv", {"9"}, 0.31)
    result, _ = run("--recording", blind, "--anchors", files[1], "--claim", f"csv:{bare[1]}")
    assert "if the claims are true" in result.output
    result, _ = run("--recording", files[0], "--anchors", files[1])
    assert "antenna delay" not in result.output


def test_several_recordings_make_one_table_and_one_report(tmp_path, files):
    other = late(files[0], tmp_path / "other.csv", {"9"}, 0.02)
    record = commissioned(tmp_path, files)
    more = ("--recording", files[0], "--recording", other, "--anchors", files[1], "--commissioning", record)
    result, _ = run(*more, "--report", tmp_path / "out", "--windows", "4")
    assert result.exit_code == 0, result.output
    (total,) = [line for line in result.output.splitlines() if line.startswith("all ")]
    assert total.split()[1] == "8"
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"report.html", "calibration.png", "ranges-path.png", "other-residuals.png"} <= names
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("<svg") == 7
    assert "<script" not in page
    result, lines = run(*more, "--json")
    assert [line["recording"] for line in lines] == ["ranges"] * 10 + ["other"] * 10
    result, _ = run(*more, "--anchors", files[1], "--anchors", files[1])
    assert result.exit_code == 2
    assert "3 --anchors for 2 recordings" in result.output


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"t;anchor;range\n1;2;3\n", "separate them by commas"),
        (b"anchor,x,y,z\n1,2,3,4\n", "no column t, range; it needs t, anchor, range; it has anchor, x, y, z"),
        (b"\x7fELF\xd0\xff", "is no text"),
        (b"t,anchor,range\n", "no ranges in it"),
    ],
)
def test_files_that_are_no_recordings(tmp_path, files, bare, content, says):
    path = tmp_path / "broken.csv"
    path.write_bytes(content)
    result, lines = run("--recording", path, "--anchors", files[1], "--claim", f"csv:{bare[1]}")
    assert (result.exit_code, lines) == (1, [])
    assert says in result.output


def test_claims_of_another_time_are_refused(tmp_path, files, bare):
    bare[1].write_text("t,x,y,z\n9000,-3,5,3\n9010,7,5,3\n")
    result, _ = run("--recording", bare[0], "--anchors", files[1], "--claim", f"csv:{bare[1]}")
    assert result.exit_code == 1
    assert "bring them to one clock" in result.output


def test_short_windows_are_judged_by_fewer_rounds(files):
    windows = list(evaluate(EvaluateSettings(*files, rounds=3, windows=5)))
    assert [window.verdict.rounds for window in windows] == [3] * 5
    assert "refuted" not in {window.verdict.outcome for window in windows}
    assert [window.first_s for window in windows] == pytest.approx([0.0, 0.15, 0.3, 0.45, 0.6])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--claim", "offset:nan,0,0"), "finite numbers"),
        (("--claim", "offset:0,inf,0"), "finite numbers"),
        (("--claim", "offset:1e300,0,0"), "nowhere on Earth"),
        (("--claim", "csv:nowhere.csv"), "nowhere.csv"),
        (("--claim", "offset:1,2"), "offset:3,0,0"),
        (("--truth-shift", "nan"), "--truth-shift"),
        (("--truth-raise", "inf"), "--truth-raise"),
        (("--truth-raise", "1e12"), "nowhere on Earth"),
        (("--rounds", "0"), "--rounds"),
        (("--buffer", "nan"), "--buffer"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(files, arguments, says):
    ranges, anchors = files
    result, lines = run("--recording", ranges, "--anchors", anchors, *arguments)
    assert result.exit_code in {1, 2}
    assert isinstance(result.exception, SystemExit)
    assert says in result.output
    assert lines == []


@pytest.mark.parametrize("count", [3, 4, 9, 16])
def test_any_number_of_anchors(tmp_path, count):
    """Anchors on a helix about the pad: any placement, three of them to sixteen."""
    rng = random.Random(count)
    places = {
        f"N{i}": (2.5 * math.cos(math.tau * i / count), 2.5 * math.sin(math.tau * i / count), 0.2 + 1.5 * i / count)
        for i in range(count)
    }
    anchors, ranges = tmp_path / "anchors.csv", tmp_path / "ranges.csv"
    anchors.write_text("anchor,x,y,z\n" + "".join(f"{n},{x},{y},{z}\n" for n, (x, y, z) in places.items()))
    rows = ["t,anchor,range,gt_x,gt_y,gt_z"]
    for index in range(40):
        for name, place in places.items():
            measured = math.dist((3.0, 6.0, 4.0), place) + rng.gauss(0, 0.02)
            rows.append(f"{0.1 * index:.3f},{name},{measured:.4f},3,6,4")
    ranges.write_text("\n".join(rows) + "\n")
    more = ("--recording", ranges, "--anchors", anchors, "--rounds", "40", "--json")
    _, honest = run(*more)
    _, lie = run(*more, "--claim", "offset:4,0,0")
    assert honest[0]["truth_error_m"] < 0.3
    assert honest[0]["outcome"] != "refuted"
    # Three anchors have no redundancy, so that nobody is refuted on them.
    assert lie[0]["outcome"] == ("inconclusive" if count == 3 else "refuted")
