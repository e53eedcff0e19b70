from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commands import pad
from wonderland_research.evaluate import EvaluateSettings, evaluate

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.usefixtures("calibrated_once"),
]  # seconds of work; minutes where the machine is crowded


def run(*arguments):
    return CliRunner().invoke(pad, ["commission", *(str(argument) for argument in arguments)])


def test_a_recording_becomes_a_commissioning_that_evaluate_takes_and_profits_from(tmp_path, files, make_world):
    out, report = tmp_path / "c.json", tmp_path / "report.html"
    result = run("--recording", files[0], "--anchors", files[1], "--out", out, "--report", report)
    assert result.exit_code == 0, result.output
    assert "go" in result.output
    assert "±1 m: out to" in " ".join(result.output.split())
    record = Commissioning.decode(out.read_bytes())
    assert record.correlation_ppm is not None
    page = report.read_text()
    assert page.count("<svg") == 5
    assert "http" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )
    others = make_world(seed=5).files(tmp_path, 40.0, "other-", reach_m=16.0)
    with_it = [w.verdict.outcome for w in evaluate(EvaluateSettings(*others, out))]
    without = [w.verdict.outcome for w in evaluate(EvaluateSettings(*others))]
    assert "refuted" not in with_it
    assert with_it.count("verified") >= without.count("verified") + 5
    lies = [w.verdict.outcome for w in evaluate(EvaluateSettings(*others, out, "offset:3,0,0", windows=10))]
    assert "verified" not in lies
    assert lies.count("refuted") > 0.8 * len(lies)


def test_a_script_tells_no_go_by_the_exit_code(tmp_path, make_world, files):
    line = {f"L{i}": (i * 1.0, 0.0, 0.5 + 0.1 * i) for i in range(4)}
    nowhere = make_world(anchors=line).files(tmp_path, 40.0)
    result = run("--recording", nowhere[0], "--anchors", nowhere[1], "--out", tmp_path / "c.json")
    assert result.exit_code == 3
    assert "No-go: ±1 m" in result.output
    assert (tmp_path / "c.json").exists()
    result = run("--recording", files[0], "--anchors", files[1], "--buffer", "0.1", "--json")
    assert (result.exit_code, json.loads(result.stdout)["go"]) == (3, False)
    result = run("--recording", files[0], "--anchors", files[1], "--json")
    assert (result.exit_code, json.loads(result.stdout)["go"]) == (0, True)
    assert "3  no-go" in run("--help").output


def test_machines_get_one_document_and_a_directory_gets_the_plots(tmp_path, files):
    result = run(
        "--recording", files[0], "--anchors", files[1], "--json", "--report", tmp_path / "out", "--buffer", "1.5"
    )
    document = json.loads(result.stdout)
    assert document["seconds"] == 90
    assert set(document["anchors"]) == {"A1", "A2", "A3", "A4"}
    assert {item["buffer_m"] for item in document["reach"]} >= {1.0, 1.5, 5.0}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "report.html", "fit.json", "bias.svg", "residuals.svg", "correlation.svg", "coverage.svg", "reach.svg",
    }  # fmt: skip


def test_the_delay_of_the_truth_is_found_and_used(tmp_path, make_world):
    late = make_world().files(tmp_path, 60.0, late_s=0.2)
    document = json.loads(run("--recording", late[0], "--anchors", late[1], "--truth-shift", "auto", "--json").stdout)
    assert document["truth_shift_s"] == pytest.approx(0.2, abs=0.03)
    assert "truth_delayed" not in {entry["code"] for entry in document["warnings"]}


def test_the_truth_from_a_file_of_its_own(tmp_path, files, make_world):
    rows = [line.split(",") for line in files[0].read_text().splitlines()]
    bare, track = tmp_path / "bare.csv", tmp_path / "track.csv"
    bare.write_text("\n".join(",".join(row[:3]) for row in rows) + "\n")
    seen = {row[0]: row[3:] for row in rows[1:]}
    track.write_text("t,x,y,z\n" + "".join(f"{t},{','.join(place)}\n" for t, place in seen.items()))
    document = json.loads(run("--recording", bare, "--reference", track, "--anchors", files[1], "--json").stdout)
    assert document["held_out_error_m"] < 0.02
    shifted = tmp_path / "elsewhen.csv"
    shifted.write_text("t,x,y,z\n" + "".join(f"{float(t) + 9e4},{','.join(p)}\n" for t, p in seen.items()))
    result = run("--recording", bare, "--reference", shifted, "--anchors", files[1])
    assert result.exit_code == 1
    assert "no truth for" in result.output


def edited(lines, kind):
    head, *rows = lines
    match kind:
        case "nan":
            rows[7] = rows[7].replace(rows[7].split(",")[2], "nan")
        case "twice":
            rows.insert(5, rows[4])
        case "backwards":
            rows[40], rows[80] = rows[80], rows[40]
        case "unknown":
            rows[9] = rows[9].replace(",A", ",B")
        case "huge":
            rows = [f"{r.split(',')[0]},{r.split(',')[1]},{9e9},{','.join(r.split(',')[3:])}" for r in rows]
        case "zero":
            rows = [f"{r.split(',')[0]},{r.split(',')[1]},0,{','.join(r.split(',')[3:])}" for r in rows]
        case "still":
            rows = [",".join([*r.split(",")[:3], "5", "5", "2"]) for r in rows]
        case "short":
            rows = rows[:400]
        case "silent":
            rows = [r for r in rows if ",A3," not in r]
        case "empty":
            rows = []
        case "columns":
            head = head.replace("gt_x", "x")
    return [head, *rows]


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("nan", "range is nan"),
        ("twice", "second range"),
        ("backwards", "time goes backwards"),
        ("unknown", "is not in"),
        ("huge", "zero, negative or beyond"),
        ("zero", "zero, negative or beyond"),
        ("still", "hardly moved"),
        ("short", "are the least"),
        ("silent", "no range of A3"),
        ("empty", "no ranges in it"),
        ("columns", "no column gt_x"),
    ],
)
def test_recordings_that_teach_nothing(tmp_path, files, kind, said):
    path = tmp_path / "broken.csv"
    path.write_text("\n".join(edited(files[0].read_text().splitlines(), kind)) + "\n")
    result = run("--recording", path, "--anchors", files[1], "--json")
    assert result.exit_code == 1
    assert said in " ".join(result.output.split())


def test_no_table_for_other_anchors(tmp_path, files, make_world):
    out = tmp_path / "c.json"
    assert run("--recording", files[0], "--anchors", files[1], "--out", out).exit_code == 0
    moved = {name: (x + 0.5, y, z) for name, (x, y, z) in make_world().anchors.items()}
    others = make_world(anchors=moved).files(tmp_path, 10.0, "other-")
    from wonderland_simulator.recording import RecordingError

    with pytest.raises(RecordingError, match=r"0\.50 m away"):
        list(evaluate(EvaluateSettings(*others, out)))


def test_what_the_command_line_cannot_mean(files):
    assert run("--anchors", files[1]).exit_code == 2
    assert run("--recording", files[0], "--anchors", files[1], "--truth-shift", "soon").exit_code == 2
    assert run("--recording", files[0], "--anchors", files[1], "--origin", "north").exit_code == 1
