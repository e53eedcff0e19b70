"""Positions by MAVLink over real sockets and a pseudo-terminal, from an autopilot that speaks through pymavlink."""

from __future__ import annotations

import asyncio
import builtins
import contextlib
import os
import time
import tty

import pytest
from kit.fake_autopilot import LAT, FakeAutopilot, OverTcp, OverUdp
from kit.geoids import write_geoid

from wonderland.clock import SteadyClock
from wonderland_uav_agent import sources
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.mavlink import MavlinkPosition, SerialAddress, TcpAddress, UdpAddress

ANYWHERE = UdpAddress("127.0.0.1", 0)
LONG_S = 20.0


@contextlib.asynccontextmanager
async def by_udp(drone):
    clock = SteadyClock()
    async with MavlinkPosition(ANYWHERE, clock) as source, OverUdp(drone, source.address) as link:
        yield source, clock, link


async def until(condition, what):
    async with asyncio.timeout(LONG_S):
        while not condition():
            await asyncio.sleep(0.01)
    assert condition(), what


async def test_by_udp_it_asks_and_gets_a_position():
    drone = FakeAutopilot(deaf=2)
    async with by_udp(drone) as (source, clock, _):
        assert source.why_not(clock()) == "no heartbeat of an autopilot"
        await source.wait(LONG_S)
        claim = source.claim(clock())
        assert (claim.lat_e7, claim.height_mm, claim.accuracy_mm) == (LAT, 12_000 + 19_400, 490)
        assert abs(claim.t_ms - time.time() * 1_000) < 1_000
        assert source.why_not(clock()) == ""
        await until(lambda: set(drone.rates) == {33, 24, 2}, "all three are asked for, until they come")
        assert drone.asked[0] == (33, 100_000)
        await until(lambda: len(drone.heartbeats_heard) >= 2, "once a second")
        assert set(drone.heartbeats_heard) == {(1, 191, 18)}


async def test_by_tcp_it_comes_back_after_a_cut():
    drone, clock = FakeAutopilot(), SteadyClock()
    async with OverTcp(drone) as server, MavlinkPosition(TcpAddress("127.0.0.1", server.port), clock) as source:
        await source.wait(LONG_S)
        await until(lambda: set(drone.rates) == {33, 24, 2}, "all of them")
        server.hang_up()
        drone.rates.clear()
        cut_ms = clock()
        await until(lambda: set(drone.rates) == {33, 24, 2}, "connected again, and asked again")
        await until(lambda: (claim := source.claim(clock())) and claim.t_ms > cut_ms, "from there")


async def test_by_a_serial_line():
    drone, clock = FakeAutopilot(), SteadyClock()
    near, far = os.openpty()
    tty.setraw(near)
    tty.setraw(far)
    os.set_blocking(near, False)
    loop = asyncio.get_running_loop()
    loop.add_reader(near, lambda: os.write(near, drone.hear(os.read(near, 4_096))))
    speaking = asyncio.create_task(drone.speak(lambda data: os.write(near, data)))
    try:
        async with MavlinkPosition(SerialAddress(os.ttyname(far), 57_600), clock) as source:
            await source.wait(LONG_S)
            assert source.claim(clock()).lat_e7 == LAT
    finally:
        speaking.cancel()
        loop.remove_reader(near)
        await asyncio.gather(speaking, return_exceptions=True)
        os.close(near)
        os.close(far)


@pytest.mark.parametrize(
    ("drone", "reason"),
    [
        ({"beats": False}, "no heartbeat of an autopilot"),
        ({"fix_type": 1}, "no 3-D fix .fix type 1."),
        ({"h_acc": 0}, "no accuracy stated"),
        ({"alt_ellipsoid_mm": 0}, "no height above the ellipsoid"),
        ({"lat": 0, "lon": 0}, "the autopilot does not know yet where it is"),
        ({"refuses": frozenset({33})}, "no GLOBAL_POSITION_INT from the autopilot; the autopilot refused"),
    ],
)
async def test_waiting_in_vain_says_what_was_missing(drone, reason):
    async with by_udp(FakeAutopilot(**drone)) as (source, _, _link):
        with pytest.raises(PositionError, match=f"no position from mavlink:udp:127.0.0.1:0 within 2 s: {reason}"):
            await source.wait(2)


async def test_nobody_there_is_said():
    async with MavlinkPosition(TcpAddress("127.0.0.1", 1), SteadyClock()) as source:
        with pytest.raises(PositionError, match=r"no heartbeat of an autopilot .*cannot be opened"):
            await source.wait(1)
    async with MavlinkPosition(SerialAddress("/dev/none"), SteadyClock()) as source:
        with pytest.raises(PositionError, match="/dev/none cannot be opened"):
            await source.wait(0.2)


async def test_a_second_autopilot_on_the_port_moves_nobody():
    drone, liar = FakeAutopilot(), FakeAutopilot(lat=LAT + 50_000)
    async with by_udp(drone) as (source, clock, _):
        await source.wait(LONG_S)
        liar.rates = {33: 0.02, 24: 0.02, 2: 0.02}
        async with OverUdp(liar, source.address) as other:
            other.transport.sendto(liar.heartbeat()[:9])  # half a message, to swallow the next
            await until(lambda: source.navigator.strangers > 30, "heard")
            seen = set()
            for _ in range(30):
                await asyncio.sleep(0.02)
                claim = source.claim(clock())
                seen.add(claim and claim.lat_e7)
            assert seen == {LAT}
            assert liar.heartbeats_heard == []
            assert liar.asked == []


async def test_after_a_reboot_it_is_asked_again():
    drone = FakeAutopilot(unix_ahead_ms=-200)
    async with by_udp(drone) as (source, clock, _):
        await until(lambda: source.navigator.skew_ms is not None and source.claim(clock()), "all of it")
        await until(lambda: source.claim(clock()).t_ms < clock() - 150, "by the autopilot's time")
        drone.reboot()
        await until(lambda: source.claim(clock()) is None, "nothing comes")
        await until(lambda: set(drone.rates) == {33, 24, 2} and source.claim(clock()), "asked again")
        assert source.navigator.refused == 0


async def test_a_taken_port_is_said():
    async with MavlinkPosition(ANYWHERE, SteadyClock()) as source:
        host, port = source.address
        with pytest.raises(PositionError, match=f"cannot listen on mavlink:udp:{host}:{port}"):
            async with MavlinkPosition(UdpAddress(host, port), SteadyClock()):
                pass


async def test_the_option_of_the_commands(capsys, monkeypatch):
    drone, clock = FakeAutopilot(), SteadyClock()
    async with (
        OverTcp(drone) as server,
        sources.open_position(f"mavlink:tcp:127.0.0.1:{server.port}", clock, wait=True) as source,
    ):
        assert source.claim(clock()).lat_e7 == LAT
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sources, "AUTOPILOT_PATIENCE_S", 0.2)
    monkeypatch.setattr(sources, "SAY_AFTER_S", 0.1)
    with pytest.raises(PositionError, match="no heartbeat"):
        async with sources.open_position("mavlink:udp:0.0.0.0:0", clock, wait=True):
            pass
    said = capsys.readouterr().err
    assert "whoever reaches this address can say where the drone is" in said
    assert "Waiting for a position (up to 0.1 s more): no heartbeat of an autopilot" in said
    for wrong in ("mavlink:", "mavlink:udp:x", "nonsense"):
        with pytest.raises(PositionError, match="give mavlink:udp:HOST:PORT"):
            async with sources.open_position(wrong, clock, wait=True):
                pass


async def test_a_geoid_is_for_an_autopilot_that_has_none(tmp_path):
    drone, clock, grid = FakeAutopilot(alt_ellipsoid_mm=12_000), SteadyClock(), write_geoid(tmp_path / "WW15MGH.DAC")
    async with (
        OverTcp(drone) as server,
        sources.open_position(f"mavlink:tcp:127.0.0.1:{server.port}", clock, grid, wait=True) as source,
    ):
        assert source.claim(clock()).height_mm == 12_000 + 60_452
    for text, file, says in (
        ("mavlink:udp:127.0.0.1:0", tmp_path, "--geoid: .*Is a directory"),
        ("mavlink:udp:127.0.0.1:0", tmp_path / "none", "--geoid: .*No such file"),
        ("udp:127.0.0.1:0", grid, "--geoid: not with this --position"),
    ):
        with pytest.raises(PositionError, match=says):
            async with sources.open_position(text, clock, file, wait=False):
                pass


async def test_without_pymavlink_it_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *more):
        if name.startswith("pymavlink"):
            raise ImportError(name)
        return real(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(PositionError, match=r'pip install "wonderland-uav-agent\[mavlink\]"'):
        async with MavlinkPosition(ANYWHERE, SteadyClock()):
            pass
