"""A node over a pseudo-terminal, against the virtual board with its faults."""

from __future__ import annotations

import asyncio

import pytest

from wonderland_fira_uci.dwm1001 import Dwm1001Node, Generation, LocationReport, Mode, TimedReport, Timings
from wonderland_fira_uci.errors import NodeUnavailableError
from wonderland_simulator.dwm1001_node import Quirks

QUICK = Timings(
    poll_ms=10, answer_ms=150, retry_ms=50, listen_ms=60, prompt_ms=300, silence_ms=400, boot_ms=150, silence_max_ms=800
)


async def take(node: Dwm1001Node, count: int) -> list[LocationReport]:
    out: list[LocationReport] = []
    async with asyncio.timeout(5):
        async for timed in node.reports():
            assert isinstance(timed, TimedReport)
            if isinstance(timed.report, LocationReport) and timed.report.distances:
                out.append(timed.report)
            if len(out) == count:
                break
    return out


async def lost(node: Dwm1001Node) -> None:
    async with asyncio.timeout(5):
        while node.is_ready:
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("generation", list(Generation))
async def test_tlv_gives_each_round_once(bench, generation):
    path = bench.add(generation=generation)
    async with Dwm1001Node(path, timings=QUICK) as node:
        await node.wait_ready()
        begun = bench.boards["tag"].rounds
        reports = await take(node, 10)
        rounds = bench.boards["tag"].rounds - begun
    assert node.firmware == f"{generation.value} 1.3.0"
    assert rounds >= 9, "asked twice as often as there are rounds, and still none came twice"
    for report in reports:
        assert [d.address for d in report.distances] == [0xA001, 0xA002, 0xA003, 0xA004]
        assert all(abs((d.range_mm or 0) - 5_000 - 111 * i) <= 40 for i, d in enumerate(report.distances))


@pytest.mark.parametrize("mode", [Mode.LES, Mode.LEC])
async def test_shell_streams(bench, mode):
    path = bench.add()
    async with Dwm1001Node(path, mode=mode, timings=QUICK) as node:
        reports = await take(node, 5)
    assert bench.boards["tag"].streaming == mode.value
    assert not any(report.damaged for report in reports)
    assert all(len(report.distances) == 4 and report.position is not None for report in reports)


async def test_a_stream_left_running_is_taken_over(bench):
    path = bench.add()
    async with Dwm1001Node(path, mode=Mode.LEC, timings=QUICK) as node:
        await take(node, 2)
    async with Dwm1001Node(path, mode=Mode.LEC, timings=QUICK) as node:
        await take(node, 2)
    assert bench.boards["tag"].streaming == "lec"


async def test_a_board_left_in_its_shell_is_brought_back_to_tlv(bench):
    path = bench.add()
    async with Dwm1001Node(path, mode=Mode.LEC, timings=QUICK) as node:
        await take(node, 1)
    async with Dwm1001Node(path, timings=QUICK) as node:
        await take(node, 2)
    assert not bench.boards["tag"].in_shell


async def test_a_toggled_off_stream_is_brought_back_by_a_reset(bench):
    path = bench.add()
    async with Dwm1001Node(path, mode=Mode.LEC, timings=QUICK) as node:
        await take(node, 2)
        bench.boards["tag"].streaming = ""
        await lost(node)
        assert "reset" in node.detail
        await node.wait_ready()


@pytest.mark.parametrize("mode", [Mode.TLV, Mode.LES, Mode.LEC])
async def test_splices_noise_and_nan_invent_nothing(bench, mode):
    path = bench.add(quirks=Quirks(update_ms=5, splice=0.3, garbage=0.2, nan=0.3, busy=0.2))
    async with Dwm1001Node(path, mode=mode, timings=QUICK) as node:
        reports = await take(node, 60)
    for report in reports:
        if not report.damaged:
            assert all(abs((d.range_mm or 0) - 5_000 - 111 * (d.address - 0xA001)) <= 50 for d in report.distances)
    assert any(report.position is None for report in reports)
    if mode is not Mode.TLV:
        assert node.device.reports_bad > 0


async def test_unplugged_and_back(bench):
    path = bench.add()
    async with Dwm1001Node(path, timings=QUICK) as node:
        await take(node, 2)
        bench.ports["tag"].unplug()
        await lost(node)
        with pytest.raises(NodeUnavailableError):
            await node.wait_ready(0.05)
        bench.ports["tag"].plug()
        await node.wait_ready()
        await take(node, 2)


async def test_a_port_that_is_not_there_is_named(tmp_path):
    async with Dwm1001Node(tmp_path / "absent") as node:
        with pytest.raises(NodeUnavailableError, match="absent"):
            await node.wait_ready(0.05)
