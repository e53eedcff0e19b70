"""A signed link: who has no key is not heard, nothing is replayed, and nobody shuts the autopilot out."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from kit.fake_autopilot import LAT, FakeAutopilot, OverUdp, dialect

from wonderland.clock import SteadyClock
from wonderland_uav_agent import sources
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.mavlink import MavlinkPosition, UdpAddress
from wonderland_uav_agent.position.mavlink.signing import SINCE_MS, Signing, read_key
from wonderland_uav_agent.position.mavlink.wire import Wire

KEY = bytes(range(32))
NOW_MS = 1_790_000_000_000


def ticks(now_ms):
    return 100 * (now_ms - SINCE_MS)


def signed(drone, key=KEY, now_ms=None, link=3):
    """`drone`, with signatures and a parser that wants them."""
    clock = SteadyClock()
    for mav in (drone._mav, drone._reader):
        mav.signing = dialect.MAVLinkSigning()
        mav.signing.secret_key, mav.signing.link_id = key, link
        mav.signing.timestamp = ticks(clock() if now_ms is None else now_ms)
        mav.signing.sign_outgoing = True
    return drone


@contextlib.asynccontextmanager
async def heard(drone, key=KEY):
    clock = SteadyClock()
    link = MavlinkPosition(UdpAddress("127.0.0.1", 0), clock, key=key)
    async with link, OverUdp(drone, link.address):
        yield link, clock


async def test_both_ends_sign():
    drone = signed(FakeAutopilot())
    async with heard(drone) as (link, clock):
        await link.wait(20)
        assert link.claim(clock()).lat_e7 == LAT
        assert set(drone.rates) >= {33, 24, 2}, "it heard what it was asked, which was signed"


@pytest.mark.parametrize("drone", [FakeAutopilot(), signed(FakeAutopilot(), bytes(32))], ids=["unsigned", "other key"])
async def test_without_the_key_nobody_is_heard_and_that_is_said(drone):
    async with heard(drone) as (link, clock):
        async with asyncio.timeout(20):
            while "were not signed with this key" not in link.why_not(clock()):
                await asyncio.sleep(0.02)
        assert link.why_not(clock()).startswith("no heartbeat of an autopilot; ")
        assert link.navigator.sender is None


async def test_an_autopilot_that_signs_is_heard_by_who_has_no_key():
    drone = signed(FakeAutopilot())
    drone._reader.signing.secret_key = None
    async with heard(drone, None) as (link, _):
        await link.wait(20)


def wire():
    return Wire(Signing(KEY, lambda: NOW_MS, dialect))


def beat(now_ms, key=KEY, link=3, system=1):
    drone = signed(FakeAutopilot(system=system), key, now_ms, link)
    return drone.heartbeat()


def test_nothing_is_heard_twice_nor_from_long_ago():
    ours = wire()
    first = beat(NOW_MS)
    assert len(ours.read(first)) == 1
    assert ours.read(first) == []
    assert ours.read(beat(NOW_MS - 61_000, link=4)) == [], "a stream that nobody knows, of a minute ago"
    assert len(ours.read(beat(NOW_MS - 59_000, link=5))) == 1
    other = Wire(ours._signing)
    assert other.read(first, ("127.0.0.1", 9)) == [], "nor from another address"


def test_a_forged_packet_from_the_future_shuts_nobody_out():
    ours = wire()
    assert len(ours.read(beat(NOW_MS))) == 1
    assert ours.read(beat(NOW_MS + 10**9, bytes(32))) == []
    assert ours.read(beat(NOW_MS + 10**9, bytes(32), link=7)) == []
    assert len(ours.read(beat(NOW_MS + 1_000))) == 1, "the true one goes on"
    assert len(ours.read(beat(NOW_MS + 1_000, link=7))) == 1


def test_a_key_file_is_its_owners_alone(tmp_path):
    path = tmp_path / "mavlink.key"
    for text, mode, complaint in (
        (KEY.hex(), 0o644, "chmod 600"),
        ("xyz", 0o600, "openssl rand -hex 32"),
        ("00" * 31, 0o600, "not 62"),
    ):
        path.write_text(text)
        path.chmod(mode)
        with pytest.raises(PositionError, match=complaint):
            read_key(path)
    path.write_text(KEY.hex() + "\n")
    assert read_key(path) == KEY
    with pytest.raises(PositionError, match="cannot be read"):
        read_key(tmp_path / "none")


@pytest.mark.parametrize("position", ["mavlink:udp:0.0.0.0:0", "mavlink:tcp:192.0.2.1:5760"])
async def test_who_flies_by_permission_over_a_network_signs(position, tmp_path):
    boarded = []
    with pytest.raises(PositionError, match="could land and arm the drone; give --mavlink-key"):
        async with sources.open_position(position, SteadyClock(), wait=False, crew=boarded.append):
            pass
    assert boarded == []
    path = tmp_path / "mavlink.key"
    path.write_text(KEY.hex())
    path.chmod(0o600)
    async with sources.open_position(position, SteadyClock(), wait=False, crew=boarded.append, key_file=path):
        assert len(boarded) == 1


def test_damaged_messages_are_refused_whatever_the_environment_says():
    dialect.MAVLINK_IGNORE_CRC = 1
    packet = bytearray(FakeAutopilot().heartbeat())
    packet[12] ^= 0xFF
    ours = Wire()
    assert ours.read(bytes(packet)) == []
    assert ours.bad == 1
