"""A reference beside the estimates: in time, recorded, and never in a drone's way."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import socket

import pytest
from kit.agents import decided

from wonderland.toml_settings import SettingsError
from wonderland_edge_agent.references import live as module
from wonderland_edge_agent.references.live import KEPT_S, LiveTruth
from wonderland_edge_agent.references.sources import UdpSource
from wonderland_edge_agent.settings import parse


def test_a_place_between_two_positions_and_none_beyond_them_or_across_a_gap():
    truth = LiveTruth(delay_ms=100)
    for t_s, east in ((10.1, 1.0), (10.3, 2.0), (10.2, 9.0), (11.3, 3.0)):
        truth.reference(t_s, (east, 0.0, 0.5))
    assert truth.at(10_000) == pytest.approx((1.0, 0.0, 0.5)), "it is a tenth of a second old when it comes"
    assert truth.at(10_100) == pytest.approx((1.5, 0.0, 0.5))
    assert truth.at(10_200) == pytest.approx((2.0, 0.0, 0.5)), "one that is older than the last is left out"
    assert [truth.at(t_ms) for t_ms in (9_998, 10_700, 11_202)] == [None, None, None]
    truth.reference(11.3 + KEPT_S + 1, (4.0, 0.0, 0.5))
    assert truth.at(10_000) is None
    assert LiveTruth().at(10_000) is None


def test_it_is_one_drones_where_it_says_whose():
    truth = LiveTruth(uav_id="uav-1")
    truth.reference(1.0, (1.0, 0.0, 0.5))
    assert (truth.of("uav-1", 1_000), truth.of("uav-2", 1_000)) == ((1.0, 0.0, 0.5), None)


async def test_a_liar_beside_the_motion_capture_neither_stops_it_nor_spoils_what_is_told():
    """One datagram from tomorrow, or from a thousand kilometres off, and the next true one counts."""
    now_ms, truth = 1_790_000_000_000, LiveTruth()
    async with UdpSource(("127.0.0.1", 0)).open(None, truth, lambda: now_ms) as live:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as liar:
            for lie in ({"t": now_ms / 1000 + 86_400, "x": 5.0}, {"x": 1e6}, {"x": math.nan}):
                liar.sendto(json.dumps({"y": 0.0, "z": 0.5} | lie).encode(), live.address)
            async with asyncio.timeout(5):
                while live.bad < 2:
                    await asyncio.sleep(0.01)
            now_ms += 100
            liar.sendto(b'{"x": 1.0, "y": 0.0, "z": 0.5}', live.address)
            async with asyncio.timeout(5):
                while truth.at(now_ms) != (1.0, 0.0, 0.5):
                    await asyncio.sleep(0.01)


def test_every_position_is_recorded_and_a_restart_goes_on(tmp_path):
    path = tmp_path / "truth.csv"
    for t_s in (1.0, 2.0):
        truth = LiveTruth(record=path)
        truth.reference(t_s, (t_s, 0.0, 0.5))
        truth.close()
        truth.reference(t_s + 0.5, (0.0, 0.0, 0.0))
    assert path.read_text().splitlines() == [
        "t,x,y,z",
        "1.0000,1.0000,0.0000,0.5000",
        "2.0000,2.0000,0.0000,0.5000",
    ]


def test_a_disk_that_is_full_ends_the_recording_and_nothing_else(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(module, "MAX_FILE_OCTETS", 60)
    truth = LiveTruth(record=tmp_path / "truth.csv")
    for t_s in range(1, 6):
        truth.reference(float(t_s), (1.0, 0.0, 0.5))
    assert truth.at(5_000) == (1.0, 0.0, 0.5)
    assert [each.levelno for each in caplog.records] == [logging.ERROR]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"record": "truth.csv"}, "no truth.reference"),
        ({"reference": "natnet:"}, "natnet:HOST"),
        ({"reference": "track.csv"}, "is a file"),
        ({"reference": "udp:127.0.0.1:1", "delay_ms": 20_000}, "delay_ms"),
    ],
)
def test_settings_that_are_none_say_what_is_wrong(tmp_path, given, says):
    document = {
        "pad_id": "pad-1",
        "connection": "connection.json",
        "spool": "spool",
        "anchors": [{"anchor_id": f"A{each}", "port": f"/dev/{each}"} for each in range(4)],
        "truth": given,
    }
    with pytest.raises(SettingsError, match=says):
        parse(document, tmp_path / "pad.toml")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


async def test_estimates_say_where_the_reference_has_the_drone(world):
    port, reports = free_port(), world.directory / "reports.sock"
    heard = []
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.setblocking(False)
    listener.bind(str(reports))
    asyncio.get_running_loop().add_reader(listener, lambda: heard.append(json.loads(listener.recv(1 << 16))))
    true = [value / 1000 for value in world.flight.truth]

    async def motion_capture():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while True:
                place = dict(zip("xyz", true, strict=True)) | {"t": world.clock() / 1000}
                sender.sendto(json.dumps(place).encode(), ("127.0.0.1", port))
                sender.sendto(b"no position", ("127.0.0.1", port))
                await asyncio.sleep(0.02)

    sending = asyncio.create_task(motion_capture())
    truth = {"reference": f"udp:127.0.0.1:{port}", "record": str(world.directory / "truth.csv")}
    try:
        async with world.pad(truth=truth, local_reports=str(reports)), world.uav() as uav:
            assert (await decided(uav)).verdict.outcome == "verified"
            await asyncio.sleep(0.3)
    finally:
        sending.cancel()
        asyncio.get_running_loop().remove_reader(listener)
        listener.close()
    estimates = [each["body"] for each in heard if each["kind"] == "estimate"]
    assert estimates
    last = estimates[-1]
    assert (last["truth_east_mm"], last["truth_north_mm"]) == tuple(round(1000 * each) for each in true[:2])
    assert math.dist((last["east_mm"], last["north_mm"]), [1000 * each for each in true[:2]]) < 500
    assert (world.directory / "truth.csv").read_text().count("\n") > 20


async def test_a_reference_that_is_away_keeps_no_drone_from_its_proof(world, caplog):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        truth = {"reference": f"udp:127.0.0.1:{taken.getsockname()[1]}"}
        async with world.pad(truth=truth), world.uav() as uav:
            assert (await decided(uav)).verdict.outcome == "verified"
    assert "cannot be listened to" in caplog.text
    assert "again in 10 s" in caplog.text
