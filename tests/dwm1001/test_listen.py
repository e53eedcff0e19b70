"""``wonderland uwb listen`` as an operator runs it: a process of its own, a board on a serial port."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import sys

import pytest

from wonderland.uwb.listen import Summary, UciBench
from wonderland_edge_agent.commissioning.live.radios import TagPlan
from wonderland_fira_uci.errors import NodeError
from wonderland_fira_uci.events import FrameStamped
from wonderland_fira_uci.node import UwbNode
from wonderland_fira_uci.uci.errors import UciEncodeError
from wonderland_simulator.dwm1001_node import Quirks
from wonderland_simulator.uci_node import IDEAL, SR150, Air, Measurement, PtyPort, VirtualNode

PROGRAM = "from wonderland.uwb.commands import uwb; uwb()"


async def run(*arguments: object) -> tuple[int, list[str], str]:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        PROGRAM,
        *map(str, arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    async with asyncio.timeout(30):
        out, err = await process.communicate()
    return process.returncode or 0, out.decode().splitlines(), err.decode()


@pytest.mark.parametrize("mode", ["tlv", "lec"])
async def test_a_dwm1001_as_json(bench, mode):
    path = bench.add(quirks=Quirks(update_ms=50))
    code, lines, err = await run("listen", "--port", path, "--kind", "dwm1001", "--mode", mode, "--count", 4, "--json")
    assert (code, err) == (0, "")
    ready, *reports, summary = map(json.loads, lines)
    assert ready["kind"] == "ready"
    assert ready["firmware"] == ("PANS R2 1.3.0" if mode == "tlv" else "not told")
    assert len(reports) == 4
    for report in reports:
        assert [row["address"] for row in report["ranges"]] == ["a001", "a002", "a003", "a004"]
        assert abs(report["ranges"][2]["range_mm"] - 5_222) <= 45
        assert report["position"]["z_mm"] == 1_680
        assert abs(report["t_ms"] - ready["t_ms"]) < 30_000
    assert summary["rounds"] == 4
    assert summary["peers"]["a003"]["ranges"] == 4
    assert abs(summary["peers"]["a003"]["mean_mm"] - 5_222) < 45


async def test_a_dwm1001_for_people(bench):
    path = bench.add()
    code, lines, _ = await run("listen", "--port", path, "--kind", "dwm1001", "--seconds", 3)
    assert code == 0
    text = "\n".join(lines)
    assert "dwm1001 is ready, firmware PANS R2 1.3.0" in text
    assert "a001   5.0" in text or "a001   4.9" in text
    assert "per second" in text


async def test_two_uci_boards_range_each_other(tmp_path):
    air = Air(lambda observer, peer, t_s: Measurement(4_320, rssi_dbm=-80.0), rng=random.Random(1))
    ports = {name: PtyPort(VirtualNode(name, air), tmp_path / name) for name in ("here", "there")}
    for port in ports.values():
        port.plug()
    try:
        other = UciBench(mac=0xD001, peers=(0xA001,), leads=False, interval_ms=50)
        async with UwbNode(ports["there"].path) as node:
            await node.wait_ready()
            await node.open_session(other.config())
            code, lines, err = await run(
                *("listen", "--port", ports["here"].path, "--kind", "uci", "--mac", "a001", "--peer", "0xD001"),
                *("--interval-ms", 50, "--count", 3, "--json"),
            )
    finally:
        for port in ports.values():
            port.close()
        air.close()
    assert (code, err) == (0, "")
    _, *reports, summary = map(json.loads, lines)
    assert [report["ranges"] for report in reports] == [[{"address": "d001", "range_mm": 4_320, "rssi_dbm": -80.0}]] * 3
    assert summary["peers"]["d001"]["mean_mm"] == 4_320


async def test_eight_boards_follow_one_that_leads_each_told_how_many_answer(tmp_path):
    air = Air(lambda observer, peer, t_s: Measurement(4_320, rssi_dbm=-80.0), rng=random.Random(1))
    ports = {name: PtyPort(VirtualNode(name, air), tmp_path / name) for name in (*(f"p{i}" for i in range(8)), "lead")}
    for port in ports.values():
        port.plug()
    peers = [word for index in range(8) for word in ("--peer", f"{0xA001 + index:04x}")]
    leading = UciBench(mac=0xD001, peers=tuple(range(0xA001, 0xA009)), leads=True, interval_ms=50)
    assert leading.config().app.slots_per_round == 20  # 40 ms of the 50, where 25 slots would not fit
    try:
        async with contextlib.AsyncExitStack() as stack:
            for index in range(7):
                node = await stack.enter_async_context(UwbNode(ports[f"p{index}"].path))
                await node.wait_ready()
                follows = UciBench(
                    mac=0xA001 + index, peers=(0xD001,), leads=False, interval_ms=50, responders=8, session_id=7
                )
                await node.open_session(follows.config())
            follower = asyncio.create_task(
                run(
                    *("listen", "--port", ports["p7"].path, "--kind", "uci", "--mac", "a008", "--peer", "d001"),
                    *("--follow", "--responders", 8, "--session", 7, "--interval-ms", 50, "--count", 10, "--json"),
                )
            )
            code, lines, err = await run(
                *("listen", "--port", ports["lead"].path, "--kind", "uci", "--mac", "d001", *peers, "--lead"),
                *("--session", 7, "--interval-ms", 50, "--seconds", 8, "--json"),
            )
            followed = await follower
    finally:
        for port in ports.values():
            port.close()
        air.close()
    assert (code, err) == (0, "")
    heard = json.loads(lines[-1])["peers"]
    assert sorted(heard) == [f"{0xA001 + index:04x}" for index in range(8)]
    assert all(peer["ranges"] > 0 for peer in heard.values())
    assert json.loads(followed[1][-1])["peers"]["d001"]["mean_mm"] == 4_320


def test_a_round_that_does_not_fit_is_refused_by_name():
    with pytest.raises(NodeError, match="a round of 8 nodes takes 40 ms, and the interval is 30 ms"):
        UciBench(mac=0xD001, peers=tuple(range(0xA001, 0xA009)), leads=True, interval_ms=30).config()


async def test_a_uci_board_says_what_it_can_do(tmp_path):
    air = Air(lambda *_: Measurement(4_320), rng=random.Random(1))
    node = VirtualNode("here", air, profile=IDEAL)
    port = PtyPort(node, tmp_path / "here")
    port.plug()
    try:
        code, lines, err = await run("capabilities", "--port", port.path, "--json")
        text_code, text, _ = await run("capabilities", "--port", port.path)
        node._core = lambda command: node._answer(command, 0, b"\x01\x05\xff\x01")  # a length that lies
        bad_code, _, bad = await run("capabilities", "--port", port.path)
    finally:
        port.close()
        air.close()
    assert (code, text_code, err) == (0, 0, "")
    [said] = map(json.loads, lines)
    assert said["capabilities"]["ranging_methods"][0] == "ul_tdoa"
    assert said["capabilities"]["channels"] == [5, 6, 8, 9, 10, 12, 13, 14]
    assert (said["pad"], said["drone"]) == ({"assurance": 4, "missing": []},) * 2
    assert "channels: 5, 6, 8, 9, 10, 12, 13, 14" in text
    assert "hopping: not told" in text
    assert "On a pad: assurance 4 at most" in text
    assert bad_code == 1
    assert "gave no answer that says what it can do" in bad
    assert "Traceback" not in bad


async def test_a_board_that_leads_blinks_for_nodes_that_time_stamp(tmp_path):
    """As the tag of a pad's calibration run, on another computer: what `pad commission` says to run there."""
    air = Air(lambda *_: Measurement(4_320), stamp=lambda *_: 1_234, rng=random.Random(1))
    ports = {name: PtyPort(VirtualNode(name, air, profile=SR150), tmp_path / name) for name in ("tag", "anchor")}
    for port in ports.values():
        port.plug()
    plan = TagPlan(macs={"A1": 0xA001}, tag_mac=0xD001, session_id=77, key=bytes(range(16)), interval_ms=50)
    key_file = tmp_path / "run.key"
    key_file.write_text(plan.key.hex())
    told = plan.command(key_file).replace("PORT", str(ports["tag"].path)).replace(key_file.name, str(key_file))
    try:
        async with UwbNode(ports["anchor"].path) as node:
            await node.wait_ready()
            peers = (plan.tag_mac,)
            bench = UciBench(mac=0xA001, peers=peers, leads=False, session_id=77, key=plan.key, interval_ms=50)
            await node.open_session(bench.config())  # on whose time the blinks come
            session = await node.open_session(plan.blinks().pad_anchor(0))
            listening = asyncio.create_task(run(*told.split()[2:], "--seconds", 6))
            async with asyncio.timeout(20):
                heard = [event async for event in _first(session.events(), 3)]
            code, _, err = await listening
    finally:
        for port in ports.values():
            port.close()
        air.close()
    assert code == 0, err
    assert {(event.tag_mac, event.ticks) for event in heard} == {(0xD001, 1_234)}
    assert [event.number for event in heard] == [1, 2, 3]


async def test_a_board_that_refuses_blinks_ends_with_one_line(tmp_path):
    air = Air(lambda *_: Measurement(4_320), rng=random.Random(1))
    port = PtyPort(VirtualNode("tag", air), tmp_path / "tag")
    port.plug()
    key_file = tmp_path / "run.key"
    key_file.write_text("00" * 16)
    try:
        code, lines, err = await run(
            *("listen", "--port", port.path, "--kind", "uci", "--mac", "d001", "--peer", "a001", "--lead"),
            *("--key-file", key_file, "--blink", "--seconds", 10),
        )
    finally:
        port.close()
        air.close()
    assert code == 1
    assert lines == []
    last = err.splitlines()[-1]
    assert "the board refuses to blink" in last
    assert "without --blink" in last
    assert "Traceback" not in err


async def _first(events, count):
    async for event in events:
        if isinstance(event, FrameStamped):
            yield event
            count -= 1
            if not count:
                return


async def test_a_peer_that_is_away_is_said(tmp_path):
    air = Air(lambda observer, peer, t_s: Measurement(1_000), rng=random.Random(1))
    port = PtyPort(VirtualNode("here", air), tmp_path / "here")
    port.plug()
    try:
        code, lines, _ = await run(
            *("listen", "--port", port.path, "--kind", "uci", "--mac", "a001", "--peer", "d001"),
            *("--interval-ms", 50, "--count", 2, "--json"),
        )
    finally:
        port.close()
        air.close()
    assert code == 0
    assert json.loads(lines[-1])["peers"]["d001"] == {
        "ranges": 0,
        "missing": 2,
        "rate_hz": 0.0,
        "mean_mm": None,
        "sigma_mm": None,
    }


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (("--kind", "uci"), 2, "needs --mac"),
        (("--kind", "uci", "--mac", "a001", "--peer", "a001"), 2, "the same address"),
        (("--kind", "uci", "--mac", "a001", "--peer", "xyzzy"), 2, "no short address"),
        (("--kind", "uci", "--mac", "0", "--peer", "a001"), 2, "of one board"),
        (("--kind", "uci", "--mac", "a001", "--peer", "ffff"), 2, "of one board"),
        (("--kind", "uci", "--mac", "1", "--peer", "2", "--key-file", "absent"), 2, "No such file"),
        (("--kind", "uci", "--mac", "1", "--peer", "2", "--key-file", "bad"), 2, "hexadecimal"),
        (("--kind", "uci", "--mac", "1", "--peer", "2", "--key-file", "short"), 2, "3 octets"),
        (("--kind", "uci", "--mac", "1", "--peer", "2", "--blink"), 2, "with the run's key"),
        (("--kind", "uci", "--mac", "1", "--peer", "2"), 1, "not one report"),
        (("--kind", "dwm1001"), 1, "not one report"),
    ],
)
async def test_mistakes_are_named(tmp_path, arguments, code, why):
    (tmp_path / "bad").write_text("not hex")
    (tmp_path / "short").write_text("010203")
    arguments = [tmp_path / word if word in {"absent", "bad", "short"} else word for word in arguments]
    returned, _, err = await run("listen", "--port", tmp_path / "no-board", *arguments, "--seconds", 0.5)
    assert "Traceback" not in err
    assert returned == code
    assert why in err


def test_a_summary_leaves_damaged_rounds_out():
    summary = Summary()
    for t_ms, range_mm, damaged in ((1_000, 5_000, False), (1_500, 9_000, True), (2_000, 5_020, False)):
        row = {"address": "a001", "range_mm": range_mm}
        summary.add({"kind": "ranges", "t_ms": t_ms, "ranges": [row], **({"damaged": True} if damaged else {})})
    document = summary.document()
    assert (document["rounds"], document["damaged"]) == (3, 1)
    assert document["peers"]["a001"] == {
        "ranges": 2,
        "missing": 0,
        "rate_hz": 1.0,
        "mean_mm": 5_010.0,
        "sigma_mm": 14.1,
    }


def test_a_bench_key_never_shows():
    bench = UciBench(mac=1, peers=(2, 3), leads=True, key=b"secret-secret-12")
    assert "secret" not in repr(bench)
    assert bench.config().app.session_key == b"secret-secret-12"
    with pytest.raises(UciEncodeError):
        UciBench(mac=1, peers=(), leads=True).config()
