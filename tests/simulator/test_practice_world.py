"""The world of a scenario by itself: ways, faults, words, and ports that nobody else loses."""

from __future__ import annotations

import asyncio
import contextlib
import io
import itertools
import json
import math
import os
import random
import signal
import socket
import sys
import termios
from pathlib import Path

import pytest
from rich.console import Console

from wonderland.proofs.frame import to_local
from wonderland.proofs.records.sessions import Claim
from wonderland_fira_uci.uci.packets import Group, MessageType, encode_control
from wonderland_remote_id import decode
from wonderland_simulator.practice.reading import read_scenario
from wonderland_simulator.practice.showing import table
from wonderland_simulator.practice.tour import Tour
from wonderland_simulator.practice.world import PracticeWorld, _alone
from wonderland_simulator.practice.writing import write_files

RESET = encode_control(MessageType.COMMAND, Group.CORE, 0, b"\0")
HEAD = """\
pads:
  - pad_id: quay
    origin: {{lat: {lat}, lon: {lon}, height_m: {height_m}}}
    survey: survey.csv
    remote_id: 127.0.0.1:{heard}
vehicles:
  - uav_id: D-1
    pad: quay
    position: 127.0.0.1:{told}
"""
STILL = "    path: [{east_m: 4, north_m: 3, up_m: 6}]\n"


@pytest.fixture
def scenario(tmp_path):
    """Reads a scenario of one pad and one vehicle."""
    (tmp_path / "survey.csv").write_text("anchor,x,y,z\nA1,2,2,0.2\nA2,-2,2,1.2\nA3,-2,-2,0.2\nA4,2,-2,0.2\n")

    def read(more=STILL, *, lat=60.4518, lon=22.2666, height_m=30.0, heard=9, told=10):
        path = tmp_path / "scenario.yaml"
        path.write_text(HEAD.format(lat=lat, lon=lon, height_m=height_m, heard=heard, told=told) + more)
        return read_scenario(path)

    return read


@contextlib.asynccontextmanager
async def running(world):
    ready = asyncio.Event()
    task = asyncio.create_task(world.run(ready.set))
    waiting = asyncio.create_task(ready.wait())
    await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def until(condition):
    async with asyncio.timeout(10):
        while not condition():
            await asyncio.sleep(0.01)


def tour_of(scenario):
    (vehicle,) = scenario.vehicles
    return Tour(vehicle.told, scenario.pads[0].site.frame, random.Random(1))


def flown(tour, seconds, step_s=0.05):
    """Place at each step."""
    places = []
    for number in range(1, round(seconds / step_s) + 1):
        tour.step(number * step_s, step_s)
        places.append(tour.flight.position)
    return places


def test_a_way_is_flown_as_fast_as_it_says_and_waited_on(scenario):
    way = "{east_m: 0, north_m: 0, up_m: 5, wait_s: 2}, {east_m: 20, north_m: 0, up_m: 5, speed_m_s: 4, wait_s: 3}"
    tour = tour_of(scenario(f"    path: [{way}]\n    repeat: true\n    start_s: 1\n"))
    places = flown(tour, 25)
    assert places[round(2.9 / 0.05)] == (0, 0, 5)
    speeds = [math.dist(one, other) / 0.05 for one, other in itertools.pairwise(places)]
    there = [number * 0.05 for number, place in enumerate(places) if math.dist(place, (20, 0, 5)) < 0.5]
    assert 7 < there[0] < 12
    assert 3.8 < max(speeds[: round(there[0] / 0.05)]) < 4.01
    assert min(place[0] for place in places[round(there[0] / 0.05) :]) < 10, "it came back"
    assert math.dist(places[round((there[0] + 2.9) / 0.05)], (20, 0, 5)) < 0.5, "it waited"


def test_who_is_led_away_arrives_by_its_receiver_and_goes_on(scenario):
    way = "{east_m: 0, north_m: 0, up_m: 5}, {east_m: 10, north_m: 0, up_m: 5}, {east_m: 10, north_m: 10, up_m: 5}"
    tour = tour_of(scenario(f"    path: [{way}]\n    lies: {{gnss_jump: {{from_s: 0, east_m: 3}}}}\n"))
    assert math.dist(flown(tour, 20)[-1], (7, 10, 5)) < 0.5


def test_a_way_of_one_point_stays_there(scenario):
    tour = tour_of(scenario(STILL + "    repeat: true\n"))
    assert not any(tour.step(number * 0.05, 0.05) for number in range(200))
    assert tour.flight.position == (4, 3, 6)


def local(tour, fix):
    return [mm / 1e3 for mm in to_local(tour.frame, fix.lat_e7, fix.lon_e7, fix.height_mm)]


@pytest.mark.parametrize(
    ("lies", "truth", "claim"),
    [
        ("{}", (4, 3, 6), (4, 3, 6)),
        ("{gnss_drag: {from_s: 2, speed_m_s: 1, bearing_deg: 90, limit_m: 5}}", (-1, 3, 6), (4, 3, 6)),
        ("{gnss_jump: {from_s: 2, north_m: 5}}", (4, -2, 6), (4, 3, 6)),
        ("{claim_off_m: [0, 4, 1]}", (4, 3, 6), (4, 7, 7)),
        ("{claim_mirrored: true}", (4, 3, 6), (-4, -3, 6)),
    ],
)
def test_a_liar_is_where_it_is_and_claims_what_it_claims(scenario, lies, truth, claim):
    tour = tour_of(scenario(f"{STILL}    lies: {lies}\n"))
    honest = tour_of(scenario())
    flown(tour, 20)
    assert math.dist(tour.flight.position, truth) < 0.3
    fix = tour.fix(20, 0)
    assert math.dist(local(tour, fix), claim) < 0.5
    assert fix.accuracy_mm == honest.fix(20, 0).accuracy_mm, "its receiver's flags stay"


EXTREMES = list(
    itertools.product((-80, 80), (-180, 180), (-500, 9_000), (-1_000, 1_000), (-100, 1_000), (-1_000, 1_000))
)


@pytest.mark.parametrize(("lat", "lon", "height_m", "away", "up", "off"), EXTREMES[::3])
def test_what_a_file_may_say_stops_no_world(scenario, lat, lon, height_m, away, up, off):
    world = PracticeWorld(
        scenario(
            f"    gnss_sigma_m: 50\n    path: [{{east_m: {away}, north_m: {away}, up_m: {up}}}]\n"
            f"    lies: {{claim_off_m: [{off}, {off}, {off}], gnss_drag: {{speed_m_s: 30, limit_m: 500}}}}\n"
            f"    remote_id: {{off_m: [{off}, {off}], impostor_m: [{off}, {off}, {off}]}}\n",
            lat=lat,
            lon=lon,
            height_m=height_m,
        ),
        lambda *_: None,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for tick in range(1, 400):
            world._fly(out, out, tick, tick * 0.25)


def heard_at(port_socket):
    """What came in the meantime."""
    port_socket.setblocking(False)
    found = []
    with contextlib.suppress(BlockingIOError):
        while True:
            found.append(port_socket.recv(2_048))
    return found


async def test_positions_and_broadcasts_are_what_agents_and_receivers_take(scenario):
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pad,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as uav,
    ):
        for each in (pad, uav):
            each.bind(("127.0.0.1", 0))
        more = f"{STILL}    remote_id: {{serial: SOMEBODY, off_m: [22, 0], impostor_m: [30, 0, 2]}}\n"
        found = scenario(more, heard=pad.getsockname()[1], told=uav.getsockname()[1])
        world = PracticeWorld(found, lambda *_: None)
        claims, packs = [], []

        def enough():
            claims.extend(heard_at(uav))
            packs.extend(heard_at(pad))
            return len(claims) > 5 and len(packs) > 3

        async with running(world):
            await until(enough)
    claim = Claim.decode(claims[-1], max_bytes=1_024)
    assert math.dist(local(world.tours["D-1"], claim), (4, 3, 6)) < 0.5
    said = {}
    for data in packs:
        basic, location, *_ = decode(data).messages
        place = to_local(found.pads[0].site.frame, location.lat_e7, location.lon_e7, location.altitude_mm)
        said.setdefault(basic.uas_id, [round(mm / 1e3) for mm in place[:2]])
    assert said == {"SOMEBODY": [26, 3], "D-1": [30, 0]}


async def answers(path):
    """Whether the node behind a path answers a reset."""
    line = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        termios.tcflush(line, termios.TCIFLUSH)  # what it said before
        os.write(line, RESET)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(0.3):
                while True:
                    with contextlib.suppress(BlockingIOError):
                        return bool(os.read(line, 100))
                    await asyncio.sleep(0.01)
        return False
    finally:
        os.close(line)


async def test_nodes_are_unplugged_hang_return_and_are_moved_when_the_file_says_so(scenario):
    said = []
    faults = (
        "faults:\n"
        "  - {at_s: 0.2, node: quay/A1, what: unplug}\n"
        "  - {at_s: 0.2, node: quay/A2, what: hang}\n"
        "  - {at_s: 0.2, node: quay/A3, what: move, by_m: [0, 0, 2]}\n"
        "  - {at_s: 3600, node: D-1, what: unplug}\n"
    )
    found = scenario(STILL + faults)
    world = PracticeWorld(found, lambda _, text: said.append(text))
    ports = found.pads[0].ports

    def apart():
        """Some rounds are lost."""
        rounds = (world._air.measure("quay/A3", "quay/A4", t_s).range_mm for t_s in range(20))
        return next(range_mm for range_mm in rounds if range_mm is not None)

    before = apart()
    async with running(world):
        assert await answers(ports["A2"])
        await until(lambda: len(said) == 3)
        assert not ports["A1"].exists()
        assert ports["A2"].exists()
        assert not await answers(ports["A2"])
        assert await answers(ports["A4"])
        assert apart() == pytest.approx(math.hypot(4, 2) * 1e3, abs=150)
        assert before == pytest.approx(4_000, abs=150)
        console = Console(record=True, width=140, file=io.StringIO())
        console.print(table(world, said))
        shown = console.export_text()
        assert "A1 unplugged · A2 hangs · A3 waits · A4 in use" in shown
        assert "next: D-1 unplug at 3600 s" in shown
        for name in ("A1", "A2"):
            world.ports[f"quay/{name}"].unplug()
            world.ports[f"quay/{name}"].plug()
            assert await answers(ports[name])
    assert not (ports["A1"].parent.parent).exists()


async def test_ports_of_others_are_left_alone(scenario, tmp_path):
    found = scenario()
    theirs = tmp_path / "ports" / "tty-D-1"
    theirs.parent.mkdir()
    theirs.write_text("a letter")
    with pytest.raises(FileExistsError, match=r"is there already.*tty-D-1"):
        await PracticeWorld(found, lambda *_: None).run(lambda: None)
    assert theirs.read_text() == "a letter"
    assert list(theirs.parent.iterdir()) == [theirs]
    theirs.unlink()
    theirs.symlink_to("/dev/pts/of-a-world-that-was-killed")
    first = PracticeWorld(found, lambda *_: None)
    async with running(first):
        assert await answers(theirs)
        with pytest.raises(FileExistsError, match="another run"):
            await PracticeWorld(found, lambda *_: None).run(lambda: None)
        assert await answers(theirs)
    assert not theirs.is_symlink()


async def test_two_worlds_do_not_mix_their_drones_positions(scenario):
    world = PracticeWorld(scenario(), lambda *_: None)
    addresses = world._told()
    assert {address[1] for address in addresses} == {9, 10}, "the pad's receiver, the drone's agent"
    async with running(world):
        for address in addresses:
            with pytest.raises(
                OSError, match=rf"another world on this machine sends to 127\.0\.0\.1:{address[1]}; end it"
            ):
                _alone(address)
    for address in addresses:
        _alone(address).close()


def test_files_that_somebody_changed_are_not_overwritten(scenario, tmp_path):
    found = scenario()
    for _ in range(2):
        written = dict(write_files(found, tmp_path / "to", Path("/ledger/connection.json"), "https://console.example"))
        assert list(written.values()) == [True, True]
    mine = tmp_path / "to" / "quay" / "pad.toml"
    mine.write_text(mine.read_text() + "# mine\n")
    written = dict(write_files(found, tmp_path / "to", Path("/ledger/connection.json"), "https://console.example"))
    assert [path.name for path, new in written.items() if not new] == ["pad.toml"]
    assert mine.read_text().endswith("# mine\n")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
async def test_the_command_ends_and_leaves_nothing(scenario, tmp_path, how):
    scenario()
    process = await asyncio.create_subprocess_exec(
        *(Path(sys.executable).with_name("wonderland"), "world", "run", "--json"),
        *("--scenario", tmp_path / "scenario.yaml"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(30):
        ready = json.loads(await process.stdout.readline())
        assert all(Path(path).exists() for path in ready["ports"].values())
        process.send_signal(how)
        out, err = await process.communicate()
    assert (process.returncode, out, err) == (0, b"", b"")
    assert {path.name for path in tmp_path.iterdir()} == {"survey.csv", "scenario.yaml"}
