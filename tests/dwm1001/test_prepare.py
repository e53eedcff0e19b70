"""Boards are put into their roles by their shells, checked, and recorded; what goes wrong is said."""

from __future__ import annotations

import asyncio
import csv
import json
import random
import sys
from dataclasses import dataclass

import pytest
from click.testing import CliRunner

from wonderland.uwb.commands import uwb
from wonderland.uwb.listen import UciBench
from wonderland.uwb.record import Recorder
from wonderland_edge_agent.commissioning.recording import Recording
from wonderland_fira_uci.dwm1001.roles import Role, parse_info, prepare
from wonderland_fira_uci.errors import NodeError
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.serial_port import serial_opener
from wonderland_simulator.dwm1001_node import VirtualDwm1001
from wonderland_simulator.dwm1001_node.lines import system_information
from wonderland_simulator.uci_node import IDEAL, Air, Measurement, PtyPort, VirtualNode

REAL_SI = """[000541.880 INF] sys: fw2 fw_ver=x01030001 cfg_ver=x00010700
[000541.880 INF] uwb0: panid=x0000 addr=xDECA9AABC0A2591A
[000541.890 INF] mode: tn (act,twr,np,le)
[000541.890 INF] cfg: sync=0 fwup=0 ble=1 upd_rate_norm=1 upd_rate_stat=100 label=DW591A
[000541.910 INF] enc: off
"""
"""Lines of a real board, as a user showed them in Qorvo's forum (forum.qorvo.com, thread 10676)."""


def test_what_a_real_board_says_of_itself():
    info = parse_info(REAL_SI)
    assert (info.address, info.network, info.mode) == (0x591A, 0, "tn")
    assert (info.rate_tenths, info.resting_tenths, info.encrypted) == (1, 100, False)
    assert info.firmware == "0x01030001"
    assert parse_info(system_information("ain", 0x3CAF, 0x1A2B, (1, 1)).decode()).network == 0x3CAF
    with pytest.raises(NodeError, match="does not say what it is"):
        parse_info("unknown command")


async def call(*arguments):
    return await asyncio.to_thread(CliRunner().invoke, uwb, [str(each) for each in arguments])


@pytest.mark.parametrize("port", ["socket://127.0.0.1", "loop://", ""])
@pytest.mark.parametrize(
    "words",
    [
        ("capabilities",),
        ("listen", "--kind", "dwm1001"),
        ("prepare", "--role", "pad", "--network", "3caf"),
        ("record", "--kind", "dwm1001", "--anchor", "A1=a001", "--out", "ranges.csv"),
    ],
)
async def test_a_port_that_can_never_be_one_is_refused_at_once_with_what_to_write(port, words):
    result = await call(*words, "--port", port)
    assert result.exit_code == 2
    assert "socket://" in result.output
    assert "HOST:PORT" in result.output or "needs host and port, for example" in result.output


async def test_a_board_of_a_recording_on_such_a_port_is_refused_too():
    boards = ("--board", "A1=loop://", "--peer", "1a2b", "--out", "ranges.csv")
    result = await call("record", "--kind", "dwm1001", *boards)
    assert result.exit_code == 2
    assert "--board A1=loop://" in result.output


async def test_boards_are_prepared_at_the_rate_of_their_line(monkeypatch):
    opened = []

    def opener(port, baud_rate, *, rtscts):
        opened.append((port, baud_rate, rtscts))
        raise NodeError("enough")

    monkeypatch.setattr("wonderland.uwb.prepare_command.serial_opener", opener)
    await call(
        *("prepare", "--port", "/dev/ttyX", "--role", "pad", "--network", "3caf", "--baud-rate", 921_600, "--rtscts")
    )
    assert opened == [("/dev/ttyX", 921_600, True)]


@dataclass
class Done:
    exit_code: int
    output: str


async def run(*arguments):
    """As a process: it hears signals."""
    program = "from wonderland.uwb.commands import uwb; uwb()"
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", program, *map(str, arguments)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    async with asyncio.timeout(30):
        out, _ = await process.communicate()
    return Done(process.returncode, out.decode())


async def test_boards_out_of_the_box_take_their_roles_and_keep_them(bench):
    port = bench.add("p1")
    board = bench.boards["p1"]
    for role, mode in (("pad", "tn"), ("drone", "ain"), ("pad", "tn")):
        done = await call("prepare", "--port", port, "--role", role, "--network", "3CAF", "--json")
        assert done.exit_code == 0, done.output
        assert json.loads(done.output)["mode"] == mode == board.mode
        assert (board.network, board.in_shell) == (0x3CAF, False)
    assert board.rates_tenths == (1, 1)


async def test_a_board_that_somebody_left_in_its_shell_streaming_is_prepared_all_the_same(bench):
    path = bench.add("p1")
    board = bench.boards["p1"]
    board.in_shell, board.streaming = True, "lec"
    info = await prepare(serial_opener(path), Role.TAG, 0x0042)
    assert (info.network, board.network) == (0x42, 0x42)


async def test_nothing_is_written_to_a_board_that_is_as_it_should_be(bench, monkeypatch):
    path = bench.add("p1")
    await prepare(serial_opener(path), Role.INITIATOR, 0x42)
    written = []
    monkeypatch.setattr(VirtualDwm1001, "_reboot", lambda self: written.append(self.name))
    await prepare(serial_opener(path), Role.INITIATOR, 0x42)
    assert written == []


async def test_a_board_that_does_not_take_its_role_and_one_that_is_none_are_said(bench, monkeypatch, tmp_path):
    path = bench.add("p1")
    monkeypatch.setattr(VirtualDwm1001, "_configured", _stubborn(VirtualDwm1001._configured))
    done = await call("prepare", "--port", path, "--role", "pad", "--network", "3caf")
    assert done.exit_code == 1
    assert "did not take its role: network 0x0000 in place of 0x3CAF" in done.output
    node = PtyPort(VirtualNode("u", Air(lambda *_: Measurement(1), rng=random.Random(1))), tmp_path / "uci")
    node.plug()
    try:
        monkeypatch.setattr("wonderland_fira_uci.dwm1001.roles.PROMPT_S", 0.2)
        done = await call("prepare", "--port", node.path, "--role", "pad", "--network", "3caf")
    finally:
        node.close()
    assert done.exit_code == 1
    assert "no shell answers" in done.output


def _stubborn(method):
    """As firmware behaves that reads the number otherwise: it says ok and keeps what it has."""

    def configured(self, command, *values):
        return b"nis: ok\r\n" if command == "nis" else method(self, command, *values)

    return configured


@pytest.mark.parametrize("network", ["xyz", "0", "ffff", "12345"])
async def test_networks_that_are_none(network):
    done = await call("prepare", "--port", "x", "--role", "pad", "--network", network)
    assert done.exit_code == 2


async def test_the_drones_tag_is_recorded_by_anchor(bench, tmp_path):
    out = tmp_path / "ranges.csv"
    arguments = ["record", "--kind", "dwm1001", "--port", bench.add(), "--out", out, "--seconds", 1.5]
    done = await run(*arguments, "--anchor", "A1=a001", "--anchor", "A2=a002")
    assert done.exit_code == 0, done.output
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["anchor"] for row in rows} == {"A1", "A2"}
    assert all(abs(float(row["range"]) - (5.0 if row["anchor"] == "A1" else 5.111)) < 0.05 for row in rows)
    assert [row["t"] for row in rows] == sorted(row["t"] for row in rows)
    again = await run(*arguments, "--anchor", "A1=a001")
    assert again.exit_code == 1
    assert "not overwritten" in again.output


async def test_tags_on_a_pad_are_recorded_each_by_its_own_range(bench, tmp_path):
    ports = {name: bench.add(name) for name in ("p1", "p2", "p3", "p4")}
    boards = [word for name, port in ports.items() for word in ("--board", f"{name}={port}")]
    out = tmp_path / "ranges.csv"
    done = await run("record", "--kind", "dwm1001", *boards, "--peer", "a003", "--out", out, "--seconds", 1.5)
    assert done.exit_code == 0, done.output
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["anchor"] for row in rows} == set(ports)
    assert all(abs(float(row["range"]) - 5.222) < 0.05 for row in rows)


async def test_a_uci_board_is_recorded_and_one_that_nobody_answers_leaves_no_recording(tmp_path):
    air = Air(lambda observer, peer, t_s: Measurement(4_320, nlos=True, rssi_dbm=-80.0), rng=random.Random(1))
    here, there = (PtyPort(VirtualNode(name, air, profile=IDEAL), tmp_path / name) for name in ("here", "there"))
    out = tmp_path / "ranges.csv"
    arguments = ["record", "--kind", "uci", "--port", here.path, "--mac", "d001", "--anchor", "A1=a001", "--out", out]
    answering = UciBench(mac=0xA001, peers=(0xD001,), leads=False, interval_ms=100, responders=1)
    try:
        here.plug()
        there.plug()
        alone = await run(*arguments, "--seconds", 1.0)
        assert alone.exit_code == 1
        assert "not one range was written" in alone.output
        assert not out.exists()
        async with UwbNode(str(there.path)) as anchor:
            await anchor.wait_ready()
            await anchor.open_session(answering.config())
            done = await run(*arguments, "--seconds", 2.0)
    finally:
        here.close()
        there.close()
        air.close()
    assert done.exit_code == 0, done.output
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 5
    assert {(row["anchor"], row["range"], row["nlos"]) for row in rows} == {("A1", "4.320", "1")}


async def test_a_port_that_is_not_there_is_named_while_recording(tmp_path):
    out = tmp_path / "ranges.csv"
    board = f"A1={tmp_path / 'nowhere'}"
    done = await run("record", "--kind", "dwm1001", "--board", board, "--peer", "1a2b", "--out", out, "--seconds", "1")
    assert done.exit_code == 1
    assert "nowhere cannot be opened" in done.output
    assert not out.exists()


def test_what_is_recorded_can_be_commissioned_with_also_where_a_port_hands_over_two_reports_at_once(tmp_path):
    recorder = Recorder(tmp_path / "ranges.csv")
    for t_ms in (1_000, 1_000, 990, 1_100):
        ranges = [{"address": f"a00{index}", "range_mm": 4_000 + index} for index in (1, 2, 3)]
        names = {f"a00{index}": f"A{index}" for index in (1, 2, 3)}
        recorder.write({"kind": "ranges", "t_ms": t_ms, "ranges": ranges}, names)
    recorder.close()
    anchors = tmp_path / "anchors.csv"
    anchors.write_text("anchor,x,y,z\nA1,0,0,1\nA2,2,0,1\nA3,0,2,1\n", encoding="utf-8")
    recording = Recording.load(tmp_path / "ranges.csv", anchors, truthless=True)
    assert sum(len(each.ranges_m) for each in recording.rounds) == 12


async def test_a_rate_that_the_firmware_does_not_have_is_refused_and_a_resting_tag_is_as_fast(bench, monkeypatch):
    path = bench.add("p1")
    arguments = ("prepare", "--port", path, "--role", "pad", "--network", "3caf")
    done = await call(*arguments, "--every-ms", "150")
    assert done.exit_code == 2
    assert "in steps of 100 ms" in done.output

    def sleepy(self, command, *values, method=VirtualDwm1001._configured):
        """As a board that keeps its ten seconds at rest, where a tag on a pad always is."""
        answer = method(self, command, *values)
        self.rates_tenths = (self.rates_tenths[0], 100)
        return answer

    monkeypatch.setattr(VirtualDwm1001, "_configured", sleepy)
    done = await call(*arguments)
    assert done.exit_code == 1
    assert "at rest a round every 100 tenths of a second in place of 1" in done.output


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ((), "give --board for each"),
        (("--board", "A1=x", "--port", "y"), "give --board for each"),
        (("--board", "A1=x"), "needs --peer"),
        (("--board", "A1", "--peer", "1"), "is not ANCHOR="),
        (("--board", "A1=x", "--board", "A1=y", "--peer", "1"), "there twice"),
        (("--port", "x"), "needs --anchor"),
    ],
)
async def test_mistakes_are_named(tmp_path, arguments, why):
    done = await call("record", "--kind", "dwm1001", "--out", tmp_path / "x.csv", *arguments)
    assert done.exit_code == 2
    assert why in done.output
