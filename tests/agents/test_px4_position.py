"""A drone's claims from PX4's uORB topics: a peer that speaks as PX4's Zenoh module does, one that is none of ours, liars."""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.px4 import MARGIN, Px4Peer, gps_of, message, position_of
from kit.ros2 import SdkPeer, router

from wonderland.clock import SteadyClock
from wonderland_rmw_zenoh.errors import DefinitionError
from wonderland_uav_agent import sources
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.px4 import Px4
from wonderland_uav_agent.position.px4_messages import ATTITUDE, DEFINITIONS, GPS, POSITION
from wonderland_uav_agent.position.receiver import horizontal_95_mm, vertical_95_mm
from wonderland_uav_agent.position.ros2 import decoded, known_types

NOW = 1_790_000_000_000
BOOT_US = 120_000_000


class Sky:
    """A PX4's core, told messages of one moment."""

    def __init__(self, **settings):
        self.warned = []
        self.px4 = Px4(self.warned.append, **settings)
        self.boot_us = BOOT_US
        self.now_ms = NOW

    def after(self, ms):
        self.boot_us += ms * 1_000
        self.now_ms += ms
        return self

    def gps(self, **changed):
        self.px4.gps(message(gps_of(self.boot_us, self.now_ms * 1_000 - 80_000, **changed)), self.now_ms)
        return self

    def position(self, **changed):
        self.px4.position(message(position_of(self.boot_us, **changed)), self.now_ms)
        return self

    def claim(self):
        return self.px4.claim(self.now_ms)

    def why(self):
        return self.px4.why_not(self.now_ms)


def test_the_claim_has_the_worse_accuracy_the_receivers_geoid_and_its_time():
    sky = Sky().gps().after(20).position()
    found = sky.claim()
    assert (found.lat_e7, found.lon_e7) == (604_518_000, 222_666_000)
    assert found.height_mm == 12_500 + 18_500
    assert found.accuracy_mm == horizontal_95_mm(700)
    assert found.height_accuracy_mm == vertical_95_mm(800)
    assert found.t_ms == NOW - 80 + 20, "the receiver's UTC, not the moment of arrival"


def test_the_utc_of_a_receiver_is_of_the_moment_that_it_says():
    sky = Sky().gps(timestamp_time_relative=-50_000).position()
    assert sky.claim().t_ms == NOW - 80 + 50


def test_without_the_receivers_time_the_arrival_stands_in():
    assert Sky().gps(time_utc_usec=0).position().claim().t_ms == NOW


@pytest.mark.parametrize(
    ("gps", "position", "says"),
    [
        ({"fix_type": 2}, {}, "no 3-D fix"),
        ({"fix_type": 8}, {}, "no 3-D fix"),
        ({"eph": 0.0}, {}, "no accuracy stated"),
        ({"eph": math.nan}, {}, "no accuracy stated"),
        ({"epv": -1.0}, {}, "no accuracy stated"),
        ({"eph": 5_000.0}, {}, "no accuracy stated"),
        ({"eph": math.inf}, {}, "no accuracy stated"),
        ({}, {"eph": math.nan}, "no accuracy stated"),
        ({}, {"epv": 0.0}, "no accuracy stated"),
        ({"altitude_ellipsoid_m": 12.4}, {}, "no height above the ellipsoid"),
        ({"altitude_ellipsoid_m": math.nan}, {}, "no height above the ellipsoid"),
        ({"altitude_ellipsoid_m": 900.0}, {}, "no height above the ellipsoid"),
        ({}, {"lat_lon_valid": False}, "does not hold"),
        ({}, {"alt_valid": False}, "does not hold"),
        ({}, {"dead_reckoning": True}, "reckons without"),
        ({}, {"lat": math.nan}, "no number"),
        ({}, {"lon": 181.0}, "no number"),
        ({}, {"alt": math.inf}, "no number"),
        ({}, {"alt": 1e5}, "no position"),
        ({}, {"lat": 0.0, "lon": 0.0}, "does not know yet"),
    ],
)
def test_positions_on_which_no_claim_may_rest(gps, position, says):
    sky = Sky().gps(**gps).position(**position)
    assert sky.claim() is None
    assert says in sky.why()


def test_no_receiver_an_old_one_and_an_old_position():
    sky = Sky()
    assert "no vehicle_global_position has come" in sky.why()
    assert "no vehicle_gps_position has come" in sky.position().why()
    assert sky.after(100).gps().position().why() == ""
    for _ in range(21):
        sky.after(100).position()
    assert "no vehicle_gps_position for 2" in sky.why()
    sky.gps().after(100).position()
    assert sky.why() == ""
    assert "no vehicle_global_position for 1." in sky.after(1_001).why()


def test_a_position_that_comes_again_makes_nothing_fresh():
    sky = Sky().gps().position()
    sky.now_ms += 1_001
    assert sky.position().claim() is None


def test_a_restart_forgets_what_was_before():
    sky = Sky().gps().position()
    sky.after(100)
    sky.boot_us = 3_000_000
    sky.position()
    assert sky.claim() is None
    assert "no vehicle_gps_position" in sky.why()
    assert "jumped" in sky.warned[-1]


def test_messages_that_were_held_up_are_no_position_of_now():
    sky = Sky().gps().position()
    sky.now_ms += 2_500
    sky.boot_us += 100_000
    assert sky.position().claim() is None


def test_the_antenna_is_turned_by_the_attitude():
    sky = Sky(antenna_m=(2.0, 0.0, 0.5)).gps().position()
    assert "no vehicle_attitude" in sky.why()
    half = math.sqrt(0.5)
    sky.after(20)
    sky.px4.attitude(message({"q": (half, 0.0, 0.0, half)}), sky.now_ms)  # its nose to the east
    found = sky.position().claim()
    assert found.lat_e7 == pytest.approx(604_518_000, abs=1)
    assert (found.lon_e7 - 222_666_000) * 1e-7 * 111_320 * math.cos(math.radians(60.4518)) == pytest.approx(2, abs=0.02)
    assert found.height_mm == 31_000 - 500
    sky.after(20)
    sky.px4.attitude(message({"q": (math.nan,) * 4}), sky.now_ms)
    sky.px4.attitude(message({"q": (0.0,) * 4}), sky.now_ms)
    assert sky.position().claim().lon_e7 == found.lon_e7, "what is no attitude turns nothing"
    assert "no vehicle_attitude" in sky.after(501).gps().position().why()


numbers = st.floats(width=32) | st.floats()


@given(numbers, numbers, numbers, numbers, numbers, numbers, st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
def test_any_numbers_are_a_claim_or_refused(lat, lon, alt, eph, epv, ellipsoid, boot_us, utc_us):
    px4 = Px4(lambda _: None)
    px4.gps(message(gps_of(boot_us, utc_us, eph=eph, altitude_ellipsoid_m=ellipsoid)), NOW)
    px4.position(message(position_of(boot_us, lat=lat, lon=lon, alt=alt, epv=epv)), NOW)
    found = px4.claim(NOW)
    assert (found is None) == bool(px4.why_not(NOW))
    assert found is None or found.accuracy_mm >= 1


HASHES = {
    POSITION: ("cf9a06f6a8c328f7200984e3aabc0fb76fde3b1fa693baff68ebaf162d2fdc60",),
    GPS: (
        "fbef1acd7734fab29377906ae90f6493e9a07724a6a21997fb8fd51d6771b958",
        "0b0f92e680bbcad0c9d0e651868c0443b9d38fb8d50c21d4a8a532d3e90cf21a",
        "ee66c86474c0b31c6fc77453a139b217818a067e29d6837df7075e18fce827d7",
    ),
    ATTITUDE: ("9af74ac6c01335f3a8612e3579d4eaa89a9d81550d933ed057f5d6252dc7e50c",),
}
"""What PX4's own build (its idl2rihs01.py, of rosidl) makes of its messages: May 2026; SensorGps of three states."""
GPS_BYTES = bytes.fromhex(
    "0001000015cd5b070000000000000000000000000000000000000000992a1895d4394e40151dc9e53f443640cdcccccccccc"
    "28406666666666e63e400000000000000000030000003333333f9a99193f0000000000000000000000000000000000000000"
    "00000000000000000000000000000000000000000000000000000000b03cffff00e025dafe5b060011000000000000000000"
    "0000000000000000000000000000000002000000000000000000000080be"
)
POSITION_BYTES = bytes.fromhex(
    "0001000001000000000000000200000000000000992a1895d4394e40151dc9e53f443640000048410000f841010100000000"
    "000000000000000900000000003fcdcc4c3f0000e0400001"
)
"""What PX4's own serialiser (its cdrstream, May 2026) makes of two messages."""


def test_type_hashes_are_those_of_px4s_own_build():
    found = {}
    for name, type_hash in known_types():
        found.setdefault(name, []).append(type_hash.removeprefix("RIHS01_"))
    assert {name: tuple(each) for name, each in found.items()} == HASHES


def test_bytes_are_read_as_px4s_own_serialiser_writes_them_whatever_lies_behind():
    kinds = {}
    for (name, _), kind in known_types().items():
        kinds.setdefault(name, kind)
    for tail in (b"", b"\xaa" * MARGIN):
        gps = decoded(kinds[GPS], GPS_BYTES + tail)
        assert (gps.timestamp, gps.latitude_deg, gps.longitude_deg) == (123_456_789, 60.4518, 22.2666)
        assert (gps.altitude_msl_m, gps.altitude_ellipsoid_m, gps.fix_type) == (12.4, 30.9, 3)
        assert (gps.eph, gps.epv) == (pytest.approx(0.7), pytest.approx(0.6))
        assert (gps.timestamp_time_relative, gps.time_utc_usec) == (-50_000, 1_790_000_000_000_000)
        assert (gps.satellites_used, gps.rtcm_msg_used, gps.antenna_offset_z) == (17, 2, -0.25)
        place = decoded(kinds[POSITION], POSITION_BYTES + tail)
        assert (place.timestamp, place.timestamp_sample, place.lat, place.lon) == (1, 2, 60.4518, 22.2666)
        assert (place.alt, place.alt_ellipsoid, place.lat_lon_valid, place.alt_valid) == (12.5, 31.0, True, True)
        assert (place.eph, place.epv, place.dead_reckoning) == (0.5, pytest.approx(0.8), True)
        assert (place.alt_reset_counter, place.terrain_alt, place.terrain_alt_valid) == (9, 7.0, False)
    with pytest.raises(DefinitionError):
        decoded(kinds[GPS], GPS_BYTES[:-1])


# --- on the wire -----------------------------------------------------------------------------------------------


@asynccontextmanager
async def position(where, text="px4", **settings):
    opened = sources.open_position(f"ros2:{text}@{where.endpoint}", SteadyClock(), wait=False, **settings)
    async with opened as found:
        yield found


@asynccontextmanager
async def px4(where, **settings):
    peer = await asyncio.to_thread(lambda: Px4Peer(where.endpoint, **settings))
    try:
        yield peer
    finally:
        await asyncio.to_thread(peer.close)


def now_ms():
    return time.time_ns() // 1_000_000


def boot_us():
    return time.monotonic_ns() // 1_000


def fly(peer, **changed):
    """A moment's messages."""
    peer.put(GPS, gps_of(boot_us(), time.time_ns() // 1_000))
    peer.put(POSITION, position_of(boot_us(), **changed))


async def until(condition, act=lambda: None, limit_s=10):
    async with asyncio.timeout(limit_s):
        while not condition():
            act()
            await asyncio.sleep(0.05)


@pytest.mark.parametrize("release", [0, 1, 2])
async def test_claims_come_from_px4_of_each_release_with_its_buffers_tail(release):
    async with router() as where, position(where) as source, px4(where, release=release) as peer:
        assert "no vehicle_global_position has come" in source.why_not(now_ms())
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer))
        found = source.claim(now_ms())
        assert (found.lat_e7, found.height_mm) == (604_518_000, 31_000)
        assert abs(found.t_ms - now_ms()) < 1_000
        await until(lambda: source.claim(now_ms()) is None)
        assert "no vehicle_global_position for" in source.why_not(now_ms())


async def test_a_namespace_and_no_other():
    async with (
        router() as where,
        position(where, "px4:/uav_1") as source,
        px4(where) as other,
        px4(where, space="/uav_1") as own,
    ):
        await asyncio.sleep(0.5)
        for _ in range(5):
            fly(other, lat=61.0)
            await asyncio.sleep(0.05)
        assert source.claim(now_ms()) is None
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(own))
        assert source.claim(now_ms()).lat_e7 == 604_518_000


async def test_two_px4_are_none_also_in_one_name():
    async with router() as where, position(where) as source, px4(where) as peer, px4(where) as liar:
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer))

        def both():
            fly(peer)
            fly(liar, lat=61.0)

        await until(lambda: "two publish" in source.why_not(now_ms()), both)
        assert source.claim(now_ms()) is None
    async with router() as where, position(where) as source, px4(where) as peer, px4(where, guid=peer.guid) as twin:
        for _ in range(30):
            fly(peer)
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer))

        def same_name():
            fly(peer)
            fly(twin, lat=61.0)

        await until(lambda: "in one name" in source.why_not(now_ms()), same_name)
        assert source.claim(now_ms()) is None


async def test_bytes_that_are_no_message_take_nothing_away():
    async with router() as where, position(where) as source, px4(where) as peer:
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer))
        for data in (b"", b"\x00\x01\x00\x00", b"\xff" * 300, bytes(4_097), bytes(1 << 20), bytes(100 << 20)):
            peer.put(POSITION, {}, data=data)
            peer.put(GPS, {}, data=data)
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer, lat=60.4519), limit_s=30)
        await until(
            lambda: (claim := source.claim(now_ms())) is not None and claim.lat_e7 == 604_519_000,
            lambda: fly(peer, lat=60.4519),
        )


async def test_a_flood_of_ten_thousand_a_second_leaves_the_agent_its_time():
    async with router() as where, position(where) as source, px4(where) as peer:
        await until(lambda: source.claim(now_ms()) is not None, lambda: fly(peer))
        stop = asyncio.Event()

        def flood():
            sent, begun = 0, time.monotonic()
            while not stop.is_set():
                peer.put(POSITION, position_of(boot_us()))
                sent += 1
                if (ahead := begun + sent / 10_000 - time.monotonic()) > 0.001:
                    time.sleep(ahead)
            return sent

        flooding = asyncio.create_task(asyncio.to_thread(flood))
        late_s, claims = 0.0, 0
        for _ in range(100):
            peer.put(GPS, gps_of(boot_us(), time.time_ns() // 1_000))
            begun = time.monotonic()
            await asyncio.sleep(0.02)
            late_s = max(late_s, time.monotonic() - begun - 0.02)
            claims += source.claim(now_ms()) is not None
        stop.set()
        sent = await flooding
        print(f"{sent} sent in about 2 s, the loop at most {late_s * 1000:.0f} ms late, {claims} of 100 looks a claim")
        assert sent > 2_000
        assert claims > 80
        assert late_s < 1.0


async def test_an_implementation_that_is_none_of_ours_has_the_same_hash_and_wire():
    hashes = {name: made.hash for (name, _), made in reversed(known_types().items())}
    async with router() as where, position(where) as source, SdkPeer.at(where) as peer:
        topics = {POSITION: "/fmu/out/vehicle_global_position", GPS: "/fmu/out/vehicle_gps_position"}
        for kind, topic in topics.items():
            said = await peer.asked("advertise", topic=topic, type=kind, text=DEFINITIONS[kind][0], parts={})
            assert said["hash"] == hashes[kind]
        fields = {kind: [line.split()[1] for line in DEFINITIONS[kind][0].splitlines()] for kind in topics}

        async def publish():
            for kind, made in ((GPS, gps_of(boot_us(), time.time_ns() // 1_000)), (POSITION, position_of(boot_us()))):
                await peer.asked("publish", topic=topics[kind], message=dict.fromkeys(fields[kind], 0) | made)

        async with asyncio.timeout(20):
            while source.claim(now_ms()) is None:
                await publish()
                await asyncio.sleep(0.1)
        assert source.claim(now_ms()).lat_e7 == 604_518_000


async def test_a_px4_of_another_release_is_named_and_read_where_its_messages_are_given(tmp_path):
    text = DEFINITIONS[GPS][0] + "uint8 quality_corrections\n"
    (tmp_path / "px4_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "px4_msgs" / "msg" / "SensorGps.msg").write_text(text)
    async with router() as where, SdkPeer.at(where) as peer, px4(where) as own:
        await peer.asked("advertise", topic="/fmu/out/vehicle_gps_position", type=GPS, text=text, parts={})
        fields = [line.split()[1] for line in text.splitlines()]

        async def publish():
            own.put(POSITION, position_of(boot_us()))
            await peer.asked(
                "publish",
                topic="/fmu/out/vehicle_gps_position",
                message=dict.fromkeys(fields, 0) | gps_of(boot_us(), time.time_ns() // 1_000),
            )

        async with position(where) as source, asyncio.timeout(20):
            while "--interfaces" not in source.why_not(now_ms()):
                await publish()
                await asyncio.sleep(0.1)
            assert source.claim(now_ms()) is None
        async with position(where, interfaces=(tmp_path,)) as source, asyncio.timeout(20):
            while source.claim(now_ms()) is None:
                await publish()
                await asyncio.sleep(0.1)


async def test_what_is_no_source_says_what_to_give(tmp_path):
    for text, settings, says in (
        ("ros2:px4:uav", {}, "no topic"),
        ("ros2:px4:/uav@tcp/10.0.0.1:7447", {}, "another machine's"),
        ("ros2:/fix", {"antenna_m": (1.0, 0.0, 0.0)}, "--antenna"),
        ("udp:127.0.0.1:0", {"interfaces": (tmp_path,)}, "--interfaces"),
    ):
        with pytest.raises(PositionError, match=says):
            async with sources.open_position(text, SteadyClock(), wait=False, **settings):
                pass
    assert ATTITUDE in DEFINITIONS
