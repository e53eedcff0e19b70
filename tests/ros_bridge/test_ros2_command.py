"""``wonderland ros2`` as its users run it, and the package of messages as colcon would read it."""

from __future__ import annotations

import asyncio
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from click.testing import CliRunner
from kit.agents import open_ledger
from kit.ros2 import TYPES

from wonderland_rmw_zenoh.interfaces import SHARE
from wonderland_ros_bridge.ros2.commands import ros2
from wonderland_ros_bridge.ros2.interfaces_command import PACKAGE

LEDGER = '[ledger]\nconnection = "connection.json"\nidentity = "pad"\n'
PAD = '[pad]\npad_id = "pad-1"\nreports = "reports.sock"\n'
FILES = sorted((SHARE / PACKAGE).glob("*/*.*"))


@pytest.fixture(scope="module")
def connection(tmp_path_factory):
    """The file of a ledger that ran once."""

    async def once(directory):
        async with open_ledger(directory):
            pass

    directory = tmp_path_factory.mktemp("once")
    asyncio.run(once(directory))
    return directory / "ledger" / "connection.json"


def on(connection):
    return LEDGER.replace("connection.json", str(connection))


def run(*arguments):
    return CliRunner().invoke(ros2, [str(each) for each in arguments])


def checked(tmp_path, text):
    path = tmp_path / "ros2.toml"
    path.write_text(text)
    return run("run", "--check", "--config", path)


def test_a_door_of_open_rmf_is_explained(tmp_path, connection):
    found = checked(tmp_path, on(connection) + PAD + "[pad.open_rmf]\n")
    assert "door pad-1, with no mutex group; only a proof opens it" in found.output
    found = checked(tmp_path, on(connection) + PAD + '[pad.open_rmf]\ndoor = "roof 1"\nmutex_group = "roof"\n')
    assert "door roof 1, with mutex group roof" in found.output


def test_settings_are_explained(tmp_path, connection):
    found = checked(tmp_path, on(connection) + PAD)
    assert found.exit_code == 0, found.output
    assert "node /wonderland/pad_1" in found.output
    assert "this machine alone" in found.output
    assert re.search(r"On the ledger at 127\.0\.0\.1:\d+ it is pad of PadMSP\.", found.output)
    tls = (
        '[ros2]\nconnect = ["tls/a.example:7447"]\n[ros2.tls]\nca = "a"\ncertificate = "b"\nkey = "c"\npeers = ["d"]\n'
    )
    assert ": d." in checked(tmp_path, on(connection) + PAD + tls).output


def test_a_check_notices_a_ledger_and_an_identity_that_are_not_there(tmp_path, connection):
    found = checked(tmp_path, LEDGER + PAD)
    assert (found.exit_code, "connection.json" in found.output) == (1, True)
    found = checked(tmp_path, on(connection).replace('"pad"', '"nobody"') + PAD)
    assert (found.exit_code, "identities.nobody: there is no such identity" in found.output) == (1, True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (LEDGER, "nothing to do"),
        (
            LEDGER + PAD + '[[to_ledger]]\ntopic = "pose"\n',
            "to_ledger[0].topic is 'pose', which is not of the form of '/pose'",
        ),
        (LEDGER + PAD + '[ros2]\nconnect = ["tcp/10.0.0.1:7447"]\n', "another machine's"),
        (LEDGER + PAD + '[ros2]\nlisten = ["tcp/0.0.0.0:7447"]\n', "another machine's"),
        (LEDGER + PAD + "[ros2]\ndomain = 300\n", "domain"),
        (LEDGER + PAD + 'map_frame = "a b"\n', "map_frame"),
        (LEDGER + PAD + '[pad.open_rmf]\ndoor = ""\n', "pad.open_rmf.door"),
        (LEDGER + PAD + f'[pad.open_rmf]\nmutex_group = "{"x" * 201}"\n', "pad.open_rmf.mutex_group"),
        (LEDGER + PAD + "[pad.open_rmf]\nautorise = true\n", "autorise"),
    ],
)
def test_settings_that_cannot_be_worked_with_name_the_field(tmp_path, text, says):
    found = checked(tmp_path, text)
    assert found.exit_code == 1
    assert says in found.output


def test_what_is_not_there_is_one_line(tmp_path):
    path = tmp_path / "ros2.toml"
    path.write_text(LEDGER + PAD)
    found = run("run", "--config", path)
    assert found.exit_code == 1
    assert found.output.startswith("Error: ")
    assert "connection.json" in found.output


def test_the_package_is_written_once(tmp_path):
    assert run("interfaces", tmp_path / "src").exit_code == 0
    written = sorted(
        each.relative_to(tmp_path / "src" / PACKAGE) for each in (tmp_path / "src").rglob("*") if each.is_file()
    )
    there = sorted(each.relative_to(SHARE / PACKAGE) for each in (SHARE / PACKAGE).rglob("*") if each.is_file())
    assert written == there
    found = run("interfaces", tmp_path / "src")
    assert found.exit_code == 1
    assert "is there already" in found.output


def test_the_package_names_all_of_its_files_and_all_that_they_need():
    """What rosidl's generators would miss; they are not to be had here."""
    cmake = (SHARE / PACKAGE / "CMakeLists.txt").read_text()
    assert re.findall(r'"(.*?)"', cmake) == [f"{each.parent.name}/{each.name}" for each in FILES]
    described = ET.parse(SHARE / PACKAGE / "package.xml").getroot()
    depends = {each.text for each in described.findall("depend")}
    used = set(re.findall(r"^([a-z_]+)/", "\n".join(each.read_text() for each in FILES), re.MULTILINE))
    assert used | {"action_msgs"} == depends
    assert used == set(re.search(r"DEPENDENCIES (.*)", cmake)[1].split())


@pytest.mark.parametrize("path", FILES, ids=lambda each: each.stem)
def test_each_file_is_an_interface(path: Path):
    kind = f"{PACKAGE}/{path.parent.name}/{path.stem}"
    made = TYPES.action(kind) if path.suffix == ".action" else TYPES.message(kind)
    assert made.name == kind
    constants_and_names = re.findall(r"^\S+ +([A-Za-z_0-9]+)", path.read_text(), re.MULTILINE)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*(?<!_)", each) for each in constants_and_names if not each[0].isupper())
