"""A drone's claims from a topic of ROS 2, published by a peer that is none of ours; and fixes that are none."""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.ros2 import TYPES, SdkPeer, parts_of, router

from wonderland.clock import SteadyClock
from wonderland_rmw_zenoh.node import Node
from wonderland_uav_agent import sources
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.fixes import FixError, accuracies_m, claim_of

NOW = 1_790_000_000_000
KIND = TYPES.message("sensor_msgs/msg/NavSatFix")
COVARIANCE = [0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.0]


def stamp(t_ms):
    return SimpleNamespace(sec=t_ms // 1_000, nanosec=t_ms % 1_000 * 1_000_000)


def fix(t_ms=NOW, **changed):
    return SimpleNamespace(
        **{
            "header": SimpleNamespace(stamp=stamp(t_ms), frame_id="gps"),
            "status": SimpleNamespace(status=0),
            "latitude": 60.4518,
            "longitude": 22.2666,
            "altitude": 30.5,
            "position_covariance": COVARIANCE,
            "position_covariance_type": 2,
        }
        | changed
    )


def test_a_fix_is_a_claim_of_its_own_time_and_accuracy():
    found = claim_of(fix(), NOW + 100, 0)
    assert (found.lat_e7, found.lon_e7, found.height_mm, found.t_ms) == (604_518_000, 222_666_000, 30_500, NOW)
    assert found.accuracy_mm == math.ceil(0.5 * math.sqrt(5.991) * 1000)
    assert found.height_accuracy_mm == 1960


def test_the_worse_direction_counts_whatever_way_it_lies():
    along_east = accuracies_m(3, [4.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0])
    aslant = accuracies_m(3, [2.5, 1.5, 0, 1.5, 2.5, 0, 0, 0, 1.0])
    assert along_east == pytest.approx(aslant)


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        (fix(status=SimpleNamespace(status=-1)), "no fix"),
        (fix(NOW - 1_001), "old"),
        (fix(NOW + 501), "ahead"),
        (fix(0), "not after"),
        (fix(latitude=math.nan), "no number"),
        (fix(altitude=math.inf), "no number"),
        (fix(latitude=91.0), "lat_e7"),
        (fix(longitude=181.0), "lon_e7"),
        (fix(altitude=1e9), "height_mm"),
        (fix(position_covariance_type=0), "no covariance"),
        (fix(position_covariance=[math.nan] * 9), "its covariance"),
        (fix(position_covariance=[0.0] * 9), "its covariance"),
        (fix(position_covariance=[-1.0] * 9), "its covariance"),
        (fix(position_covariance=[1.0, 5.0, 0, 5.0, 1.0, 0, 0, 0, 1.0]), "its covariance"),
        (fix(position_covariance=[1e12, 0, 0, 0, 1e12, 0, 0, 0, 1.0]), "accuracy_mm"),
    ],
)
def test_fixes_on_which_no_claim_may_rest(bad, says):
    with pytest.raises(FixError, match=says):
        claim_of(bad, NOW, 0)


def test_time_does_not_run_backwards():
    with pytest.raises(FixError, match="not after"):
        claim_of(fix(NOW - 10), NOW, NOW - 10)


numbers = st.floats() | st.integers(-(2**31), 2**31).map(float)


@given(numbers, numbers, numbers, st.lists(numbers, min_size=9, max_size=9), st.integers(0, 255))
def test_any_numbers_are_a_claim_or_refused(lat, lon, height, covariance, kind):
    changed = {"latitude": lat, "longitude": lon, "altitude": height, "position_covariance": covariance}
    try:
        found = claim_of(fix(**changed, position_covariance_type=kind), NOW, 0)
    except FixError:
        return
    assert found.accuracy_mm >= 1


@asynccontextmanager
async def position(where):
    async with sources.open_position(f"ros2:/fix@{where.endpoint}", SteadyClock(), wait=False) as found:
        yield found


def now_ms():
    return time.time_ns() // 1_000_000


def message(**changed):
    at = stamp(now_ms())
    return {
        "header": {"frame_id": "gps", "stamp": {"sec": at.sec, "nanosec": at.nanosec}},
        "latitude": 60.4518,
        "longitude": 22.2666,
        "altitude": 30.5,
        "position_covariance": COVARIANCE,
        "position_covariance_type": 2,
    } | changed


async def until(condition, limit_s=10):
    async with asyncio.timeout(limit_s):
        while not condition():
            await asyncio.sleep(0.02)


async def test_claims_come_from_a_peer_and_end_with_it():
    async with router() as where, position(where) as source, Node("/receiver", where.link) as receiver:
        assert "no fix has come" in source.why_not(now_ms())
        sends = receiver.advertise("/fix", KIND)
        await receiver.wait_for("MS", "/fix", 5)
        await asyncio.sleep(0.3)
        await sends.publish(message())
        await until(lambda: source.claim(now_ms()) is not None)
        assert source.claim(now_ms()).lat_e7 == 604_518_000
        await until(lambda: source.claim(now_ms()) is None)
        assert "s old" in source.why_not(now_ms())
        await sends.publish(message(latitude=math.nan))
        await until(lambda: "no number" in source.why_not(now_ms()))
        async with Node("/liar", where.link) as liar:
            lies = liar.advertise("/fix", KIND)
            await asyncio.sleep(0.3)
            for _ in range(3):
                await sends.publish(message())
                await lies.publish(message(latitude=61.0))
            await until(lambda: "two publish" in source.why_not(now_ms()))
            assert source.claim(now_ms()) is None


async def test_another_type_and_another_implementation():
    async with router() as where, position(where) as source, SdkPeer.at(where) as peer:
        await peer.asked("advertise", topic="/fix", **parts_of("std_msgs/msg/String"))
        await asyncio.sleep(0.5)
        await peer.asked("publish", topic="/fix", message={"data": "x"})
        await until(lambda: "has std_msgs/msg/String" in source.why_not(now_ms()))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ros2:", "no topic"),
        ("ros2:fix", "no topic"),
        ("ros2:/fix@tcp/10.0.0.1:7447", "another machine's"),
        ("ros2:/fix@nonsense", "no address"),
    ],
)
async def test_what_is_no_source_says_what_to_give(text, says):
    with pytest.raises(PositionError, match=says):
        async with sources.open_position(text, SteadyClock(), wait=False):
            pass
