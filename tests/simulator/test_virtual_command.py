"""``wonderland uwb virtual`` as people call it: its ports answer as the boards would, until Ctrl-C."""

from __future__ import annotations

import asyncio
import json
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


@pytest.mark.parametrize(
    ("survey", "options", "why"),
    [
        (SURVEY, ("--drone", "high"), "is not EAST,NORTH,UP"),
        (SURVEY, ("--drone", "1,2,inf"), "not all of these are finite"),
        (SURVEY.replace("A3", "drone"), (), "an anchor is called 'drone'"),
        ("anchor,x\nA1,2\n", (), "survey.csv"),
    ],
)
def test_what_is_no_place_for_a_board(tmp_path, survey, options, why):
    (tmp_path / "survey.csv").write_text(survey)
    found = CliRunner().invoke(uwb, ["virtual", "--anchors", str(tmp_path / "survey.csv"), *options])
    assert found.exit_code != 0
    assert why in found.output
