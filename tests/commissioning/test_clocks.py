"""Clocks: their offsets and wander are found again, a bad one is named, and the record lets time stamps prove a claim."""

from __future__ import annotations

import csv
import json
import math
import random
import re

import numpy as np
import pytest
from click.testing import CliRunner

from wonderland.proofs.records.pads import Commissioning
from wonderland_edge_agent.commands import pad
from wonderland_edge_agent.commissioning.clocks import fit_clocks
from wonderland_edge_agent.commissioning.errors import ClockError, RecordingError
from wonderland_edge_agent.commissioning.recording import Recording
from wonderland_edge_agent.commissioning.stamps import M_PER_TICK, StampedRun

OFFSETS_M = (0.42, -1.30, 0.05, 0.83)
COUNTER = 1 << 40
pytestmark = [pytest.mark.timeout(300), pytest.mark.usefixtures("calibrated_once")]


def write_stamps(path, world, seconds, *, offsets=OFFSETS_M, wander_m=None, noise_m=0.03, deaf=(), seed=4, shift_m=()):
    """Blinks every 100 ms of the drone of ``World``; each clock wanders slowly about its offset."""
    rng = random.Random(seed)
    wander_m = wander_m or (0.005,) * len(world.anchors)
    slow = [0.0] * len(world.anchors)
    day = shift_m or (0.0,) * len(world.anchors)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("t", "anchor", "blink", "ticks"))
        for blink in range(int(seconds * 10)):
            t_s = blink / 10
            sent_m = 299_792_458.0 * (t_s + rng.uniform(0, 0.005))
            truth = world.place_at(t_s, seconds)
            for index, (name, place) in enumerate(world.anchors.items()):
                # An Ornstein–Uhlenbeck wander of 3 s: what a synchronisation over the air does.
                slow[index] += -slow[index] / 30 + rng.gauss(0, wander_m[index] * math.sqrt(2 / 30))
                if name in deaf:
                    continue
                late = offsets[index] + day[index] + slow[index] + rng.gauss(0, noise_m)
                ticks = round((sent_m + math.dist(truth, place) + late) / M_PER_TICK) % COUNTER
                writer.writerow((f"{t_s:.3f}", name, blink, ticks))
    return path


@pytest.fixture
def stamped(tmp_path, make_world):
    """A run of 90 s, by the name of its file."""
    world = make_world()
    ranges, anchors = world.files(tmp_path, 90.0)
    recording = Recording.load(ranges, anchors)

    def make(name="stamps.csv", **more):
        path = write_stamps(tmp_path / name, world, 90.0, **more)
        return StampedRun.load(path, recording.anchors, recording.track, shift_s=0.0, raise_m=0.0)

    make.files = (ranges, anchors)
    make.world = world
    return make


def about_their_mean(values):
    return np.array(values) - np.mean(values)


def test_offsets_and_noise_are_found_again_and_what_is_stated_covers_the_truth(stamped):
    scores = []
    for seed in range(8):
        found = fit_clocks([stamped(seed=seed)])
        assert found.bad == ()
        assert found.stamp_sigma_m == pytest.approx(0.03, rel=0.1)
        off = found.offset_m - about_their_mean(OFFSETS_M)
        assert np.abs(off).max() < 0.005
        assert (found.sigma_m > 0.004).all()  # 5 mm is true; half of what a second shows always counts
        assert 0.005 < found.sigma_m.mean() < 0.012
        scores.extend((off / found.sigma_m).tolist())
    assert np.mean(np.abs(scores) < 1.0) > 0.9  # the mean of 90 s is known better than what a session meets


@pytest.mark.parametrize("bad", [0, 2])
def test_a_bad_clock_among_five_is_named_and_left_out(tmp_path, make_world, bad):
    five = {
        "A1": (1.6, 0, 1.6),
        "A2": (0.5, 1.5, 0.2),
        "A3": (-1.3, 0.9, 0.2),
        "A4": (-1.3, -0.9, 0.2),
        "A5": (0.5, -1.5, 0.2),
    }
    world = make_world(anchors=five, bias=(0.0,) * 5)
    ranges, anchors = world.files(tmp_path, 90.0)
    recording = Recording.load(ranges, anchors)
    wander = [0.004] * 5
    wander[bad] = 0.15
    path = write_stamps(tmp_path / "s.csv", world, 90.0, offsets=(0.1, 0.2, -0.4, 0.0, 0.3), wander_m=wander)
    found = fit_clocks([StampedRun.load(path, recording.anchors, recording.track, shift_s=0.0, raise_m=0.0)])
    name = list(five)[bad]
    assert [one for one, _ in found.bad] == [name]
    assert found.without == (name,)
    assert found.anchor_ids == tuple(other for other in five if other != name)
    assert (found.sigma_m < 0.015).all()
    assert f"Anchor {name}: its clock wanders by" in dict(found.notes())["clock_bad"]


def test_a_bad_clock_among_four_is_named_and_its_uncertainty_is_stated(stamped):
    found = fit_clocks([stamped(wander_m=(0.004, 0.004, 0.2, 0.004))])
    assert [name for name, _ in found.bad] == ["A3"]
    assert found.without == ()
    assert found.sigma_m[2] > 0.1
    assert found.sigma_m[2] > 4 * np.delete(found.sigma_m, 2).max()


def test_what_changes_between_days_counts_as_uncertainty(stamped):
    one = fit_clocks([stamped("a.csv")])
    two = fit_clocks([stamped("a.csv"), stamped("b.csv", shift_m=(0.0, 0.04, 0.0, -0.04), seed=5)])
    assert two.sigma_m[1] > 0.02 > one.sigma_m[1]
    assert "clock_one_run" in dict(one.notes())
    assert "clock_one_run" not in dict(two.notes())


def test_too_few_that_share_a_clock(stamped):
    with pytest.raises(ClockError, match="A4: stamped fewer than half"):
        fit_clocks([stamped(deaf=("A4",))])


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("1.0,A9,1,5", "not in the survey"),
        ("1.0,A1,-1,5", "blink is no whole number"),
        ("1.0,A1,1,nan", "ticks is no whole number"),
        ("nan,A1,1,5", "t is nan"),
        ("1.0,A1,1,5\n0.9,A1,2,5", "time goes backwards"),
        ("1.0,A1,1,5\n1.0,A1,1,6", "twice"),
        ("9e5,A1,1,5", "no truth at the time"),
        ("", "no time stamps"),
    ],
)
def test_files_that_are_none(tmp_path, files, row, said):
    recording = Recording.load(*files)
    path = tmp_path / "s.csv"
    path.write_text(f"t,anchor,blink,ticks\n{row}\n" if row else "t,anchor,blink,ticks\n")
    with pytest.raises(RecordingError, match=said):
        StampedRun.load(path, recording.anchors, recording.track, shift_s=0.0, raise_m=0.0)


def test_the_command_puts_clocks_into_the_record_and_the_report(tmp_path, stamped):
    ranges, anchors = stamped.files
    stamped()
    arguments = ["commission", "--recording", ranges, "--time-stamps", tmp_path / "stamps.csv", "--anchors", anchors]
    arguments += ["--out", tmp_path / "c.json", "--report", tmp_path / "report.html"]
    result = CliRunner().invoke(pad, [str(each) for each in arguments])
    assert result.exit_code == 0, result.output
    told = " ".join(result.output.split())
    assert "At assurance 3 (time stamps alone)" in told
    assert re.search(r"within \d+ frames", told)
    record = Commissioning.decode((tmp_path / "c.json").read_bytes())
    assert record.timestamp_sigma_mm == pytest.approx(30, abs=3)
    expected = (about_their_mean(OFFSETS_M) * 1000).round()
    for anchor, offset in zip(record.anchors, expected, strict=True):
        assert anchor.clock_offset_mm == pytest.approx(offset, abs=5)
        assert 3 <= anchor.clock_sigma_mm <= 15
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") == 6
    assert "what time stamps alone can verify" in page
    document = json.loads(CliRunner().invoke(pad, [str(each) for each in arguments[:7]] + ["--json"]).stdout)
    assert document["clocks"]["bad"] == []
    assert {item["buffer_m"] for item in document["reach_by_time_stamps"]} >= {1.0, 5.0}
    assert [item["buffer_m"] for item in document["reach_of_heights"]] == [1.0, 2.0]
    assert "<h2>Heights</h2>" in page
    assert "Heights" in told
    result = CliRunner().invoke(pad, [str(each) for each in [*arguments, "--recording", ranges]])
    assert "one for each" in result.output
