"""``wonderland uwb virtual`` as people call it: its ports answer as the boards would, until Ctrl-C."""

from __future__ import annotations

import asyncio
import csv
import json
import math
import signal
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from wonderland.uwb.commands import uwb

SURVEY = "anchor,x,y,z,mac\nA1,2,2,0.2,a001\nA2,-2,2,1.2,a002\nA3,-2,-2,0.2,a003\n"


async def wonderland(*arguments: object):
    return await asyncio.create_subprocess_exec(
        Path(sys.executable).with_name("wonderland"), *map(str, arguments), stdout=asyncio.subprocess.PIPE
    )


async def test_its_ports_are_boards_that_say_what_they_can_and_vanish_with_it(tmp_path):
    (tmp_path / "survey.csv").write_text(SURVEY)
    boards = await wonderland("uwb", "virtual", "--anchors", tmp_path / "survey.csv", "--directory", tmp_path / "b")
    try:
        async with asyncio.timeout(60):
            while b"Ctrl-C" not in (line := await boards.stdout.readline()):
                assert line
            asked = await wonderland("uwb", "capabilities", "--port", tmp_path / "b" / "tty-drone", "--json")
            said, _ = await asked.communicate()
        assert json.loads(said)["drone"]["assurance"] == 2
        assert {path.name for path in (tmp_path / "b").iterdir()} >= {"tty-A1", "tty-A2", "tty-A3", "tty-drone"}
    finally:
        boards.send_signal(signal.SIGINT)
        await boards.communicate()
    assert boards.returncode == 0
    assert not list((tmp_path / "b").glob("tty-*"))


async def test_dwm1001_boards_come_out_of_the_box_and_range_a_drone_that_is_carried_about(tmp_path):
    (tmp_path / "survey.csv").write_text(SURVEY)
    track = tmp_path / "track.csv"
    boards = await wonderland(
        *("uwb", "virtual", "--anchors", tmp_path / "survey.csv", "--directory", tmp_path),
        *("--profile", "DWM1001", "--carry", track),
    )
    try:
        async with asyncio.timeout(60):
            while b"Ctrl-C" not in (line := await boards.stdout.readline()):
                assert line
            for name, role in (("A1", "pad"), ("drone", "drone")):
                board = ("--port", tmp_path / f"tty-{name}", "--role", role, "--network", "3caf", "--json")
                said, _ = await (await wonderland("uwb", "prepare", *board)).communicate()
                assert json.loads(said)["address"], said
            ranges = tmp_path / "ranges.csv"
            board = ("--board", f"A1={tmp_path / 'tty-A1'}", "--peer", "1a2b", "--out", ranges, "--seconds", 2)
            recording = await wonderland("uwb", "record", "--kind", "dwm1001", *board)
            await recording.communicate()
            assert recording.returncode == 0
    finally:
        boards.send_signal(signal.SIGINT)
        await boards.communicate()
    with track.open() as file:
        seen = [(float(row["t"]), *(float(row[axis]) for axis in "xyz")) for row in csv.DictReader(file)]
    with ranges.open() as file:
        for row in list(csv.DictReader(file)):
            _, *place = min(seen, key=lambda each: abs(each[0] - float(row["t"])))
            assert float(row["range"]) == pytest.approx(math.dist(place, (2, 2, 0.2)), abs=0.5)
    assert max(math.dist(one[1:], seen[0][1:]) for one in seen) > 1


@pytest.mark.parametrize(
    ("survey", "options", "why"),
    [
        (SURVEY, ("--drone", "high"), "is not EAST,NORTH,UP"),
        (SURVEY, ("--drone", "1,2,inf"), "not all of these are finite"),
        (SURVEY.replace("A3", "drone"), (), "an anchor is called 'drone'"),
        ("anchor,x\nA1,2\n", (), "survey.csv"),
        (SURVEY, ("--carry", "/dev/null/track.csv"), "/dev/null/track.csv: Not a directory"),
    ],
)
def test_what_is_no_place_for_a_board(tmp_path, survey, options, why):
    (tmp_path / "survey.csv").write_text(survey)
    found = CliRunner().invoke(uwb, ["virtual", "--anchors", str(tmp_path / "survey.csv"), *options])
    assert found.exit_code != 0
    assert why in found.output
