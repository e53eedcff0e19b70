"""A drone's claims from an odometry in a frame whose place is given: geodesy, what no claim may rest on, and liars."""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import asynccontextmanager
from types import SimpleNamespace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.ros2 import TYPES, SdkPeer, parts_of, router
from pyproj import Transformer

from wonderland.clock import SteadyClock
from wonderland.toml_settings import SettingsError
from wonderland_rmw_zenoh.node import Node
from wonderland_uav_agent import sources
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.fixes import HORIZONTAL_95, FixError
from wonderland_uav_agent.position.odometry import Odometry, OdometrySettings, geodetic
from wonderland_uav_agent.settings import load

NOW = 1_790_000_000_000
TYPE = "nav_msgs/msg/Odometry"
GIVEN = {
    "frame": "map",
    "lat": 60.4518,
    "lon": 22.2666,
    "height_m": 30.5,
    "yaw_deg": 0.0,
    "accuracy_m": 0.3,
    "yaw_accuracy_deg": 0.5,
}
ORIGIN = (60.4518, 22.2666, 30.5)


def given_by(**changed):
    return OdometrySettings(**(GIVEN | changed))


def variances(east=0.01, north=0.01, up=0.04, **others):
    found = [0.0] * 36
    found[0], found[7], found[14] = east, north, up
    for index, value in others.items():
        found[int(index[1:])] = value
    return found


def odom(x=0.0, y=0.0, z=0.0, *, t_ms=NOW, frame="map", covariance=None, turn=(0.0, 0.0, 0.0, 1.0)):
    return SimpleNamespace(
        header=SimpleNamespace(
            frame_id=frame, stamp=SimpleNamespace(sec=t_ms // 1_000, nanosec=t_ms % 1_000 * 1_000_000)
        ),
        pose=SimpleNamespace(
            pose=SimpleNamespace(
                position=SimpleNamespace(x=x, y=y, z=z),
                orientation=SimpleNamespace(**dict(zip("xyzw", turn, strict=True))),
            ),
            covariance=variances() if covariance is None else covariance,
        ),
    )


def claim(message, *, gid=b"a", now_ms=NOW, after_ms=0, antenna_m=(0.0, 0.0, 0.0), **changed):
    return Odometry(given_by(**changed), antenna_m).claim_of(message, gid, now_ms, after_ms)


@given(st.floats(-89, 89), st.floats(-180, 180), st.floats(-100, 5_000), *[st.floats(-5_000, 5_000)] * 3)
def test_places_are_those_of_proj(lat, lon, height_m, east, north, up):
    cartesian = Transformer.from_pipeline("+proj=cart +ellps=WGS84")
    local = Transformer.from_pipeline(f"+proj=topocentric +ellps=WGS84 +lon_0={lon} +lat_0={lat} +h_0={height_m}")
    found = geodetic((lat, lon, height_m), (east, north, up))
    back = local.transform(*cartesian.transform(found[1], found[0], found[2]))
    assert back == pytest.approx((east, north, up), abs=1e-3)


def test_a_pose_is_a_claim_with_what_the_frame_leaves_open():
    found = claim(odom(0.0, 0.0, 2.0))
    assert (found.lat_e7, found.lon_e7, found.height_mm, found.t_ms) == (604_518_000, 222_666_000, 32_500, NOW)
    assert found.accuracy_mm == math.ceil(math.hypot(HORIZONTAL_95 * 0.1, 0.3) * 1_000)
    assert found.height_accuracy_mm == math.ceil(math.hypot(1.96 * 0.2, 0.3) * 1_000)


def test_a_direction_that_is_known_badly_costs_accuracy_with_the_way():
    near, far = claim(odom(1.0)), claim(odom(100.0))
    assert far.accuracy_mm - near.accuracy_mm > 500
    assert far.accuracy_mm == pytest.approx(
        math.hypot(HORIZONTAL_95 * 0.1, 0.3, 100 * math.radians(0.5)) * 1_000, abs=1
    )


def test_the_frame_is_turned_from_east_counter_clockwise():
    north = claim(odom(100.0), yaw_deg=90.0)
    assert north.lon_e7 == pytest.approx(222_666_000, abs=1)
    assert (north.lat_e7 - 604_518_000) * 1e-7 * 111_412 == pytest.approx(100, abs=0.1)
    assert claim(odom(0.0, 100.0), yaw_deg=-90.0).lon_e7 > 222_666_000


def test_the_antenna_is_forward_right_down_of_what_the_pose_is_of():
    level = claim(odom(), antenna_m=(1.0, 2.0, 0.5))
    assert level.height_mm == 30_000
    assert level.lon_e7 > 222_666_000, "forward is along x"
    assert level.lat_e7 < 604_518_000, "right is against y"
    half = math.sqrt(0.5)
    turned = claim(odom(turn=(0.0, 0.0, half, half)), antenna_m=(1.0, 0.0, 0.0))
    assert turned.lat_e7 > 604_518_000
    with pytest.raises(FixError, match="orientation"):
        claim(odom(turn=(0.0, 0.0, 0.0, 0.0)), antenna_m=(1.0, 0.0, 0.0))
    with pytest.raises(FixError, match="orientation"):
        claim(odom(turn=(math.nan,) * 4), antenna_m=(1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (odom(frame="odom"), "its frame is 'odom'"),
        (odom(frame=""), "its frame is ''"),
        (odom(t_ms=NOW - 1_001), "s old"),
        (odom(t_ms=NOW + 501), "ahead"),
        (odom(t_ms=0), "not after"),
        (odom(math.nan), "no number"),
        (odom(0.0, math.inf), "no number"),
        (odom(10_001.0), "more than 10000 m"),
        (odom(covariance=[0.0] * 36), "no covariance"),
        (odom(covariance=variances(east=0.0)), "its covariance is none"),
        (odom(covariance=variances(up=-1.0)), "its covariance is none"),
        (odom(covariance=variances(north=math.nan)), "its covariance is none"),
        (odom(covariance=variances(_1=0.5, _6=0.5)), "its covariance is none"),
        (odom(covariance=variances(east=1e11, north=1e11)), "accuracy_mm"),
        (odom(covariance=variances(east=1e13)), "its covariance is none"),
    ],
)
def test_poses_on_which_no_claim_may_rest(bad, says):
    with pytest.raises(FixError, match=says):
        claim(bad)


def test_an_odometry_that_leaps_or_is_anothers_is_done_with():
    made = Odometry(given_by())
    made.claim_of(odom(30.0), b"a", NOW, 0)
    made.claim_of(odom(35.5, t_ms=NOW + 100), b"a", NOW + 100, 0)  # 50 m/s, and half a metre
    with pytest.raises(FixError, match=r"it leapt by 35\.5 m"):
        made.claim_of(odom(t_ms=NOW + 200), b"a", NOW + 200, 0)
    with pytest.raises(FixError, match="start the agent again"):
        made.claim_of(odom(35.5, t_ms=NOW + 300), b"a", NOW + 300, 0)
    made = Odometry(given_by())
    made.claim_of(odom(30.0), b"a", NOW, 0)
    with pytest.raises(FixError, match="another publishes it now"):
        made.claim_of(odom(30.0, t_ms=NOW + 100), b"b", NOW + 100, 0)


numbers = st.floats() | st.integers(-(2**31), 2**31).map(float)


@given(numbers, numbers, numbers, st.lists(numbers, min_size=36, max_size=36), st.tuples(*[numbers] * 4))
def test_any_numbers_are_a_claim_or_refused(x, y, z, covariance, turn):
    try:
        found = claim(odom(x, y, z, covariance=covariance, turn=turn), antenna_m=(1.0, 0.0, 0.0))
    except FixError:
        return
    assert found.accuracy_mm >= 300


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('frame = ""', "odometry.frame"),
        ("lat = 91.0", "odometry.lat"),
        ("accuracy_m = 0.0", "odometry.accuracy_m"),
        ("yaw = 1.0", "odometry.yaw"),
    ],
)
def test_settings_that_are_none_name_the_field(tmp_path, line, says):
    rest = {name: value for name, value in GIVEN.items() if name != line.partition(" ")[0]}
    text = "\n".join(f"{name} = {msgspec.json.encode(value).decode()}" for name, value in rest.items())
    (tmp_path / "uav.toml").write_text(f"[odometry]\n{text}\n{line}\n")
    with pytest.raises(SettingsError, match=says):
        load(tmp_path / "uav.toml")


# --- on the wire -----------------------------------------------------------------------------------------------


def now_ms():
    return time.time_ns() // 1_000_000


def message(x=0.0, **changed):
    at = now_ms()
    return {
        "header": {"frame_id": "map", "stamp": {"sec": at // 1_000, "nanosec": at % 1_000 * 1_000_000}},
        "child_frame_id": "base_link",
        "pose": {
            "pose": {"position": {"x": x, "y": 0.0, "z": 1.0}, "orientation": {"w": 1.0}},
            "covariance": variances(),
        },
    } | changed


@asynccontextmanager
async def position(where, **settings):
    text = f"ros2:/odom@{where.endpoint}"
    async with sources.open_position(text, SteadyClock(), wait=False, **settings) as found:
        yield found


async def until(condition, act=None, limit_s=15):
    async with asyncio.timeout(limit_s):
        while not condition():
            if act is not None:
                await act()
            await asyncio.sleep(0.05)


async def test_claims_come_from_a_peer_and_not_from_a_liar_beside_it():
    async with (
        router() as where,
        position(where, odometry=given_by()) as source,
        Node("/localiser", where.link) as localiser,
        Node("/liar", where.link) as liar,
    ):
        assert "no fix has come" in source.why_not(now_ms())
        sends = localiser.advertise("/odom", TYPES.message(TYPE))
        await until(lambda: source.claim(now_ms()) is not None, lambda: sends.publish(message()))
        assert source.claim(now_ms()).height_mm == 31_500
        lies = liar.advertise("/odom", TYPES.message(TYPE))

        async def both():
            await sends.publish(message())
            await lies.publish(message(40.0))

        await until(lambda: "two publish" in source.why_not(now_ms()), both)
        assert source.claim(now_ms()) is None
        lies.close()
        await asyncio.sleep(5.1)
        await sends.publish(message())
        await until(lambda: "start the agent again" in source.why_not(now_ms()), lambda: sends.publish(message()))


async def test_another_hash_and_bytes_that_are_none_are_named_and_take_nothing_away():
    async with (
        router() as where,
        position(where, odometry=given_by()) as source,
        SdkPeer.at(where) as peer,
        Node("/localiser", where.link) as localiser,
    ):
        await peer.asked("advertise", topic="/odom", type=TYPE, text="float64 x\n", parts={})

        async def lie():
            await peer.asked("publish", topic="/odom", message={"x": 1.0})

        await until(lambda: "type hash" in source.why_not(now_ms()), lie)
        assert source.claim(now_ms()) is None
        await asyncio.sleep(5.1)
        sends = localiser.advertise("/odom", TYPES.message(TYPE))
        await until(lambda: source.claim(now_ms()) is not None, lambda: sends.publish(message()))
        for data in (b"", b"\xff" * 700, bytes(4_097), bytes(100 << 20)):
            await sends.publish_bytes(data)
        await until(
            lambda: (claim := source.claim(now_ms())) is not None and claim.lon_e7 > 222_666_000,
            lambda: sends.publish(message(1.0)),
            limit_s=30,
        )


async def test_an_implementation_that_is_none_of_ours_is_heard():
    async with router() as where, position(where, odometry=given_by()) as source, SdkPeer.at(where) as peer:
        said = await peer.asked("advertise", topic="/odom", **parts_of(TYPE))
        assert said["hash"] == TYPES.message(TYPE).hash

        async def publish():
            twist = {"twist": {"linear": dict.fromkeys("xyz", 0.0), "angular": dict.fromkeys("xyz", 0.0)}}
            made = message(twist=twist | {"covariance": [0.0] * 36})
            made["pose"]["pose"]["orientation"] = dict.fromkeys("xyz", 0.0) | {"w": 1.0}
            await peer.asked("publish", topic="/odom", message=made)

        await until(lambda: source.claim(now_ms()) is not None, publish)


async def test_odometry_without_its_table_and_the_table_without_odometry():
    async with router() as where, Node("/localiser", where.link) as localiser:
        sends = localiser.advertise("/odom", TYPES.message(TYPE))
        async with position(where) as source:
            await until(lambda: r"[odometry]" in source.why_not(now_ms()), lambda: sends.publish(message()))
    for text in ("ros2:px4", "udp:127.0.0.1:0"):
        with pytest.raises(PositionError, match="odometry"):
            async with sources.open_position(text, SteadyClock(), wait=False, odometry=given_by()):
                pass
