"""Ranges are to the antenna of the node; the autopilot tells another place, and the attitude turns what is between."""

from __future__ import annotations

import math

import pytest

from wonderland.proofs.frame import to_local
from wonderland_edge_agent.geodesy import frame_at
from wonderland_uav_agent.position.mavlink.attitude import moved
from wonderland_uav_agent.position.mavlink.messages import (
    ATTITUDE,
    AskFor,
    Attitude,
    GlobalPosition,
    Heartbeat,
    Sender,
    SystemTime,
)
from wonderland_uav_agent.position.mavlink.navigator import Navigator
from wonderland_uav_agent.position.receiver import GpsRaw

LAT, LON = 604_518_000, 222_666_000
FRAME = frame_at(LAT, LON, 30_000)
UTC_MS = 1_800_000_000_000
AUTOPILOT = Sender(1, 1)
EAST = math.pi / 2


def told(antenna_m, attitude, *, old=False):
    """The navigator after a place at the frame's origin."""
    navigator = Navigator(lambda _: None, None, antenna_m)
    navigator.take(Heartbeat(2, 3), AUTOPILOT, UTC_MS)
    navigator.take(SystemTime(1_000 * UTC_MS, 5_000), AUTOPILOT, UTC_MS)
    navigator.take(GpsRaw(3, 12_000, 30_000, 300, 500), AUTOPILOT, UTC_MS)
    if attitude is not None:
        navigator.take(attitude, AUTOPILOT, UTC_MS - (2_000 if old else 0))
    navigator.take(GlobalPosition(5_000, LAT, LON, 12_000), AUTOPILOT, UTC_MS)
    return navigator


def place_m(navigator):
    claim = navigator.claim(UTC_MS)
    return tuple(mm / 1e3 for mm in to_local(FRAME, claim.lat_e7, claim.lon_e7, claim.height_mm))


@pytest.mark.parametrize(
    ("antenna_m", "attitude", "east_north_up_m"),
    [
        ((0.0, 0.0, 0.0), None, (0.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0), Attitude(0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((1.0, 0.5, 0.0), Attitude(0.0, 0.0, EAST), (1.0, -0.5, 0.0)),
        ((0.0, 0.0, 0.4), Attitude(0.0, 0.0, EAST), (0.0, 0.0, -0.4)),
        ((0.0, 0.0, 1.0), Attitude(math.radians(90), 0.0, 0.0), (-1.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0), Attitude(0.0, math.radians(30), 0.0), (0.0, math.cos(math.radians(30)), 0.5)),
    ],
)
def test_the_claim_is_of_the_antenna(antenna_m, attitude, east_north_up_m):
    assert place_m(told(antenna_m, attitude)) == pytest.approx(east_north_up_m, abs=0.02)


@pytest.mark.parametrize("attitude", [None, Attitude(math.nan, 0.0, 0.0)])
def test_without_an_attitude_there_is_no_claim_and_it_says_why(attitude):
    navigator = told((1.0, 0.0, 0.0), attitude)
    assert navigator.claim(UTC_MS) is None
    assert "ATTITUDE" in navigator.why_not(UTC_MS)
    assert "--antenna" in navigator.why_not(UTC_MS)


def test_an_old_attitude_is_none():
    assert told((1.0, 0.0, 0.0), Attitude(0.0, 0.0, 0.0), old=True).claim(UTC_MS) is None


def test_the_attitude_is_asked_for_where_it_is_needed_alone():
    def asked(navigator):
        wanted = {each.message_id for each in navigator.outgoing(UTC_MS + 3_000) if isinstance(each, AskFor)}
        return ATTITUDE in wanted

    assert asked(told((1.0, 0.0, 0.0), None))
    assert not asked(told((0.0, 0.0, 0.0), None))


@pytest.mark.parametrize("latitude", [-60.0, 0.0, 45.0, 80.0])
def test_metres_along_the_ellipsoid(latitude):
    frame = frame_at(round(latitude * 1e7), 222_666_000, 0)
    lat_e7, lon_e7 = moved(frame.lat_e7, frame.lon_e7, 3.0, -4.0)
    east_mm, north_mm, _ = to_local(frame, lat_e7, lon_e7, 0)
    assert (east_mm, north_mm) == pytest.approx((-4_000, 3_000), abs=15)
