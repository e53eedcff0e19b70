"""Scenario files that are wrong: each is refused with the line, the field, and what is allowed."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from wonderland.cli import main
from wonderland_simulator.practice.description import ScenarioFile
from wonderland_simulator.practice.reading import MAX_FILE_BYTES, ScenarioError, read_scenario

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "practise.md"
TUTORIAL = GUIDE.parent / "tutorials" / "pad-operator.md"
GOOD = """\
pads:
  - pad_id: quay
    origin: {lat: 60.4518, lon: 22.2666, height_m: 30.0}
    survey: survey.csv
    range_bias_m: {A1: 0.05}
vehicles:
  - uav_id: D-1
    pad: quay
    path:
      - {east_m: 4, north_m: 3, up_m: 6}
      - {east_m: 5, north_m: 3, up_m: 6, speed_m_s: 2}
  - uav_id: D-2
    pad: quay
    path: [{east_m: -4, north_m: 3, up_m: 6}]
    lies: {claim_mirrored: true}
faults:
  - {at_s: 20, node: quay/A2, what: hang}
  - {at_s: 10, node: D-2, what: unplug}
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "survey.csv").write_text("anchor,x,y,z\nA1,2,2,0.2\nA2,-2,2,1.2\nA3,-2,-2,0.2\n")
    (tmp_path / "scenario.yaml").write_text(GOOD)
    return tmp_path / "scenario.yaml"


def test_a_good_one_has_ports_and_addresses_for_everything(file):
    found = read_scenario(file)
    (pad,) = found.pads
    assert {name: path.relative_to(file.parent).as_posix() for name, path in pad.ports.items()} == {
        name: f"ports/quay/tty-{name}" for name in ("A1", "A2", "A3")
    }
    assert [each.port.relative_to(file.parent).as_posix() for each in found.vehicles] == [
        "ports/tty-D-1",
        "ports/tty-D-2",
    ]
    assert len({pad.remote_id, *(each.position for each in found.vehicles)}) == 3
    assert [site.bias_m for site in pad.site.anchors] == [0.05, 0, 0]
    assert [fault.at_s for fault in found.faults] == [10, 20]


WRONG = [
    # (what stands in the good file, what stands there instead, the line, the field and what is said)
    ("    pad: quay\n    path:\n", "    pad: quay\n    hight: 3\n    path:\n", 9, r"vehicles\[0\].hight is unknown; known here: uav_id, .*path"),
    ("speed_m_s: 2", "speed_km_h: 7", 11, r"vehicles\[0\].path\[1\].speed_km_h is unknown; known here: .*speed_m_s"),
    ("speed_m_s: 2", "speed_m_s: 2 m/s", 11, r"path\[1\].speed_m_s is '2 m/s': .*number"),
    ("speed_m_s: 2", "speed_m_s: true", 11, r"path\[1\].speed_m_s is True: .*number"),
    ("speed_m_s: 2", "speed_m_s: 0", 11, r"path\[1\].speed_m_s is 0: .*greater than 0"),
    ("speed_m_s: 2", "speed_m_s: 300", 11, r"path\[1\].speed_m_s is 300: .*30"),
    ("east_m: 5", "east_m: .nan", 11, r"path\[1\].east_m is nan: .*finite"),
    ("east_m: 5", "east_m: -.inf", 11, r"path\[1\].east_m is -inf: .*finite"),
    ("east_m: 5", "east_m: 5e5", 11, r"path\[1\].east_m is '?500000.0|'5e5'"),
    ("lat: 60.4518", "lat: 604518000", 3, r"pads\[0\].origin.lat is 604518000: .*80"),
    ("lat: 60.4518, ", "", 3, r"pads\[0\].origin.lat is missing"),
    ("origin: {lat: 60.4518, lon: 22.2666, height_m: 30.0}", "origin: here", 3, r"origin is 'here', and should be a table of lat"),
    ("uav_id: D-2", "uav_id: 0417", 12, r"vehicles\[1\].uav_id is 271, and should be a text"),
    ("uav_id: D-1", "uav_id: D-2", 12, r"vehicles\[1\].uav_id is D-2, which is vehicles\[0\].uav_id already"),
    ("uav_id: D-2", "uav_id: '../x'", 12, r"vehicles\[1\].uav_id is '../x'"),
    ("uav_id: D-2\n", "uav_id: D-2\n    port: ports/tty-D-1\n", 13, r"vehicles\[1\].port is .*tty-D-1, which is vehicles\[0\].port already"),
    ("uav_id: D-2\n", "uav_id: D-2\n    port: ports/quay/tty-A1\n", 13, r"vehicles\[1\].port is .*tty-A1, which is pads\[0\].ports already"),
    ("uav_id: D-2\n", "uav_id: D-2\n    port: ports/x/../tty-D-1\n", 13, r"vehicles\[1\].port is .*tty-D-1, which is vehicles\[0\].port already"),
    ("uav_id: D-2\n", "uav_id: D-2\n    position: 127.0.0.1\n", 13, r"vehicles\[1\].position is '127.0.0.1': is not host:port"),
    ("uav_id: D-2\n", "uav_id: D-2\n    position: 5500\n", 13, r"vehicles\[1\].position is 5500: should be host:port"),
    ("pad: quay\n    path: [", "pad: kay\n    path: [", 13, r"vehicles\[1\].pad is 'kay', and no pad of this file; quay are"),
    ("path: [{east_m: -4, north_m: 3, up_m: 6}]", "path: []", 14, r"vehicles\[1\].path is \[\]: .*at least 1"),
    ("claim_mirrored: true", "ranges: bent", 15, r"vehicles\[1\].lies.ranges is 'bent': .*'per-anchor'.*'relay'"),
    ("claim_mirrored: true", "gnss_drag: {}, gnss_jump: {}", 15, r"vehicles\[1\].lies has gnss_drag and gnss_jump"),
    ("quay/A2", "quay/A9", 17, r"faults\[0\].node is 'quay/A9', and no node of this file; D-1, D-2, quay/A1"),
    ("what: hang", "what: burn", 17, r"faults\[0\].what is 'burn': .*'unplug', 'hang', 'return' or 'move'"),
    ("what: hang", "what: move", 17, r"faults\[0\].by_m and what: move go together"),
    ("what: unplug", "what: move, by_m: [1, 0, 0]", 18, r"faults\[1\].what is 'move', and that is for anchors"),
    ("{A1: 0.05}", "{A7: 0.05}", 5, r"range_bias_m.A7 is no anchor of the survey; A1, A2, A3 are"),
    ("survey.csv", "nowhere.csv", 4, r"pads\[0\].survey .*nowhere.csv"),
    ("    pad: quay\n    path:\n", "    pad: quay\n    pad: quay\n    path:\n", 9, r"the field 'pad' stands twice"),
    ("  - uav_id: D-1", " - uav_id: D-1\n   x: [", 10, r"no YAML"),
]  # fmt: skip


@pytest.mark.parametrize(("there", "instead", "line", "said"), WRONG)
def test_what_is_wrong_is_one_line_with_its_place(file, there, instead, line, said):
    assert GOOD.count(there) >= 1
    file.write_text(GOOD.replace(there, instead, 1))
    with pytest.raises(ScenarioError) as caught:
        read_scenario(file)
    (text,) = str(caught.value).splitlines()
    assert re.search(said, text), text
    assert f"line {line}" in text, text


def test_everything_that_is_wrong_is_said_at_once(file):
    file.write_text(
        GOOD.replace("speed_m_s: 2", "speed: 2").replace("what: hang", "what: burn").replace("lon:", "long:")
    )
    done = CliRunner().invoke(main, ["world", "check", str(file)])
    assert done.exit_code == 1
    for line, place in ((3, "origin.lon "), (3, "origin.long"), (11, "path[1].speed "), (17, "faults[0].what")):
        assert re.search(rf"line {line}: \S*{re.escape(place)}", done.output), done.output


BOMBS = {
    "an empty file": ("", "the file"),
    "no table": ("- a\n- b\n", "the file"),
    "no pads": ("vehicles: []\n", "pads is missing"),
    "aliases": ("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "line 2, column 11: aliases are not allowed"),
    "a merge": ("base: &base {pad_id: quay}\npads: [{<<: *base}]\n", "aliases are not allowed"),
    "a python object": ("pads: !!python/object/apply:os.system [true]\n", "no YAML"),
    "half a character": (b"pads: \xff\n", "no YAML"),
    "depth": ("[" * 100_000, "no YAML"),
    "depth in tables": ("".join(f"{' ' * depth}a:\n" for depth in range(500)), "no YAML|is unknown"),
    "a million waypoints": (GOOD.replace("[{east_m: -4, north_m: 3, up_m: 6}]", f"[{'{},' * 1_000_000}]"), f"larger than {MAX_FILE_BYTES} bytes"),
    "many waypoints": (GOOD.replace("[{east_m: -4, north_m: 3, up_m: 6}]", f"[{'{},' * 20_000}]"), "at most 1000|more"),
    "many fields": ("".join(f"{number}: 0\n" for number in range(25_000)), "keys should be strings"),
    "a long number": (f"seed: {'9' * 100_000}\n", "seed|no YAML"),
}  # fmt: skip


FLOWN = GOOD.replace("    path: [{east_m: -4, north_m: 3, up_m: 6}]\n    lies: {claim_mirrored: true}\n", "    path: [{east_m: -4, north_m: 3, up_m: 0}]\n    autopilot: {program: /bin/true}\n")  # fmt: skip
OF_AUTOPILOTS = {
    "no program": (FLOWN.replace("/bin/true", "arducopter"), r"program is .*/arducopter, and no program"),
    "a file that is none": (FLOWN.replace("/bin/true", "survey.csv"), r"program is .*/survey.csv, and no program"),
    "a way": (FLOWN.replace("up_m: 0}", "up_m: 0}, {east_m: 0, north_m: 0, up_m: 5}"), "path has more than the place"),
    "again": (FLOWN.replace("autopilot:", "repeat: true\n    autopilot:"), "repeat is not for a vehicle with"),
    "a lying claim": (
        FLOWN.replace("autopilot:", "lies: {claim_share: 0.5}\n    autopilot:"),
        "claim_share is not for",
    ),
    "a foreign ground station": (FLOWN.replace("/bin/true", "/bin/true, ground_station: somewhere:1"), "IPv4 address"),
    "a parameter that is none": (FLOWN.replace("/bin/true", "/bin/true, parameters: {a b: 1}"), "parameters"),
}


@pytest.mark.parametrize("name", OF_AUTOPILOTS)
def test_what_a_real_autopilot_does_not_take_from_a_file(file, name):
    text, said = OF_AUTOPILOTS[name]
    file.write_text(text)
    with pytest.raises(ScenarioError, match=said):
        read_scenario(file)


def test_a_vehicle_with_an_autopilot_says_its_position_by_mavlink(file):
    file.write_text(FLOWN)
    flown = read_scenario(file).vehicles[1]
    assert flown.position_option == "mavlink:udp:{}:{}".format(*flown.position)
    assert flown.told.autopilot.ground_station == ("127.0.0.1", 14_550)


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_eat_the_machine_is_refused_soon(file, name):
    text, said = BOMBS[name]
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    begun_s = time.process_time()
    with pytest.raises(ScenarioError, match=said) as caught:
        read_scenario(file)
    assert time.process_time() - begun_s < 20
    lines = str(caught.value).splitlines()
    assert len(lines) <= 21
    assert max(map(len, lines)) < 700


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("world", "run"), "say --scenario"),
        (("world", "run", "--dir", "x", "--check"), "say --scenario"),
        (("world", "check", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_options_that_do_not_go_together(arguments, said):
    done = CliRunner().invoke(main, list(arguments))
    assert done.exit_code == 2
    assert said in done.output


def test_the_files_of_the_guide_are_good(file):
    """As a newcomer copies them."""
    (survey,) = re.findall(r"> survey.csv <<'END'\n(.*?)^END", TUTORIAL.read_text(), re.DOTALL | re.MULTILINE)
    (file.parent / "survey.csv").write_text(survey)
    scenarios = re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert len(scenarios) == 2
    program = file.parent / "ardupilot" / "build" / "sitl" / "bin" / "arducopter"
    program.parent.mkdir(parents=True)
    program.write_text("")
    program.chmod(0o755)
    for text in scenarios:
        file.write_text(text)
        assert read_scenario(file).pads[0].told.pad_id == "pad-1"


def test_the_guide_names_every_field():
    guide = GUIDE.read_text()
    fields = {name for each in ScenarioFile.model_json_schema()["$defs"].values() for name in each["properties"]}
    assert not {name for name in fields if f"`{name}`" not in guide}
