"""What an operator mistypes costs him a message: nothing goes onto the ledger, and no key of the pad's is used up."""

from __future__ import annotations

import asyncio
import os
import re
import sys

import pytest

from wonderland_fira_uci.serial_port import PortError, serial_opener
from wonderland_uav_agent.results import lines

pytestmark = pytest.mark.timeout(60)


@pytest.mark.parametrize("command", ["prove", "calibrate"])
async def test_a_drone_without_its_node_asks_for_nothing(world, command):
    async with world.pad() as pad:
        blocks = await world.contract("uav").height()
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", "from wonderland.cli import main; main()", "uav", command),
            *("--connection", str(world.directory / "ledger" / "connection.json"), "--pad", "pad-1"),
            *("--port", "/dev/null/none", "--position", f"track:{_track(world)}"),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        _, said = await process.communicate()
        assert process.returncode == 1
        assert b"nothing was asked: " in said, said.decode()
        assert pad.status()["sessions_run"] == 0
        assert await world.contract("uav").height() == blocks


def _track(world):
    claim = world.flight.claim(world.clock())
    path = world.directory / "track.csv"
    path.write_text(
        "t_ms,lat_e7,lon_e7,height_mm,accuracy_mm,height_accuracy_mm\n"
        f"{claim.t_ms},{claim.lat_e7},{claim.lon_e7},{claim.height_mm},{claim.accuracy_mm},500\n"
    )
    return path


@pytest.mark.parametrize(
    ("what", "why"),
    [
        ("file", "it is a file, no device"),
        ("directory", "it is a directory, no device"),
        ("nothing", "there is nothing of that name"),
        ("taken", "another program has it open"),
    ],
)
def test_why_a_port_cannot_be_opened_is_said_in_words(tmp_path, what, why):
    port = tmp_path / what
    if what == "file":
        port.write_text("x")
    elif what == "directory":
        port.mkdir()
    if what == "taken":
        _, slave = os.openpty()
        port.symlink_to(os.ttyname(slave))
        held = serial_opener(port)()
    with pytest.raises(PortError, match=re.escape(f"{port} cannot be opened: {why}")):
        serial_opener(port)()
    if what == "taken":
        held.close()


def test_a_question_ends_with_its_own_mark():
    class Result:
        verdict, end, detail = None, "radios_unavailable", "is it a DWM1001?"

    assert lines(Result())[0].endswith("DWM1001?")
