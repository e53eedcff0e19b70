"""The way down by the ranges: the filter alone, and what an autopilot is told."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from kit.agents import commissioning

from wonderland.proofs.frame import to_wgs84
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.flight.guidance import MAX_REFUSED, Fix, Guidance
from wonderland_uav_agent.flight.precision import BODY_FRD, LOCAL_NED, PrecisionLanding
from wonderland_uav_agent.flight.vehicle import ARDUPILOT, PX4
from wonderland_uav_agent.position.mavlink.messages import Attitude, LocalPosition

PAD = commissioning(10**7)


def places(pad=PAD):
    return {a.mac: (a.east_mm / 1e3, a.north_mm / 1e3, a.up_mm / 1e3) for a in pad.anchors}


def descent(t_s, start=(1.5, -1.0, 6.0)):
    """Down within 12 s, and to the middle meanwhile, with a sway."""
    left = max(0.0, 1 - t_s / 12)
    return start[0] * left + 0.2 * math.sin(t_s), start[1] * left, start[2] * left + 0.1


def flown(guide, *, seconds=12.0, sigma_m=0.03, drop=0.0, lie_m=0.0, seed=1):
    """Errors (horizontal, vertical; m) at each round after the first second."""
    rng, errors = random.Random(seed), []
    guide.seed(tuple(x + 0.8 for x in descent(0)), 0)
    for round_number in range(int(seconds * 20)):
        t_ms = 50 * round_number
        truth = descent(t_ms / 1e3)
        if round_number % 2 == 0:
            guide.seed((truth[0] + 0.8, truth[1] + 0.8, truth[2] + 0.8), t_ms)
        for mac, place in places().items():
            if rng.random() >= drop:
                guide.range(mac, t_ms, round(1e3 * (math.dist(truth, place) + rng.gauss(0, sigma_m) + lie_m)))
        fix = guide.fix(t_ms)
        if fix is not None and t_ms > 1_000:
            east, north, up = (a - b for a, b in zip(fix.place_m, truth, strict=True))
            errors.append((math.hypot(east, north), abs(up)))
    return errors


@pytest.mark.parametrize("drop", [0.0, 0.4])
def test_it_follows_a_descent_to_the_ground(drop):
    errors = flown(Guidance(PAD), drop=drop)
    assert len(errors) > 200
    horizontal = sorted(error for error, _ in errors)
    assert horizontal[int(0.95 * len(horizontal))] < 0.15


@pytest.mark.parametrize("bearing_deg", range(0, 360, 30))
@pytest.mark.parametrize(("aside_m", "above_m"), [(3.5, 0.0), (6.0, 1.5), (3.5, -2.5)])
def test_an_autopilot_that_is_metres_off_leads_the_beginning_nowhere(bearing_deg, aside_m, above_m):
    """As an ordinary receiver is. One range after the other from a wrong place, it was sure of one 9 m from the drone."""
    bearing, truth = math.radians(bearing_deg), (-2.0, -2.7, 6.0)
    believed = (truth[0] + aside_m * math.sin(bearing), truth[1] + aside_m * math.cos(bearing), truth[2] + above_m)
    guide, rng = Guidance(PAD), random.Random(bearing_deg)
    for t_ms in range(0, 3_000, 50):
        guide.seed(believed, t_ms)
        for mac, place in places().items():
            guide.range(mac, t_ms, round(1e3 * (math.dist(truth, place) + rng.gauss(0, 0.02))))
        fix = guide.fix(t_ms)
        assert fix is None or t_ms < 500 or math.dist(fix.place_m[:2], truth[:2]) < 0.5
    assert fix is not None


def test_one_that_has_lost_its_way_begins_anew():
    """Every fourth range fits by chance, and keeps nobody where he is not."""
    guide = Guidance(PAD)
    flown(guide, seconds=3)
    stands, moved = descent(3), (4.0, 1.0, 6.0)
    first = PAD.anchors[0].mac
    for t_ms in range(3_000, 6_000, 50):
        guide.seed(moved, t_ms)
        for mac, place in places().items():
            guide.range(mac, t_ms, round(1e3 * math.dist(stands if mac == first and t_ms < 4_500 else moved, place)))
    assert math.dist(guide.fix(6_000).place_m[:2], moved[:2]) < 0.3


def test_a_round_that_does_not_fit_is_no_beginning():
    guide = Guidance(PAD)
    for t_ms in range(0, 1_000, 50):
        guide.seed((0.0, 0.0, 5.0), t_ms)
        for index, (mac, place) in enumerate(places().items()):
            guide.range(mac, t_ms, round(1e3 * math.dist((0, 0, 5), place)) + (3_000 if index % 2 else 0))
        assert guide.fix(t_ms) is None


def test_a_wild_range_changes_nothing():
    guide = Guidance(PAD)
    flown(guide, seconds=3)
    before = guide.fix(3_000)
    assert not guide.range(PAD.anchors[0].mac, 3_000, 40_000)
    assert guide.fix(3_000) == before


def test_ranges_that_fit_no_more_end_the_guidance_until_there_is_a_new_beginning():
    guide = Guidance(PAD)
    flown(guide, seconds=3)
    for _ in range(MAX_REFUSED):
        guide.range(PAD.anchors[0].mac, 3_000, 40_000)
    assert guide.fix(3_000) is None


def test_silence_of_the_anchors_ends_it_within_half_a_second():
    guide = Guidance(PAD)
    flown(guide, seconds=3)
    assert guide.fix(3_000) is not None
    assert guide.fix(3_500) is None


@pytest.mark.parametrize("range_mm", [0, -5])
def test_no_range_and_strangers_are_left_out(range_mm):
    guide = Guidance(PAD)
    guide.seed((0, 0, 5), 0)
    assert not guide.range(PAD.anchors[0].mac, 10, range_mm)
    assert not guide.range(0x7777, 10, 5_000)


@pytest.mark.parametrize(
    ("place_m", "sigma_m", "strays"),
    [
        ((1.4, 0.0, 0.1), 0.03, False),
        ((1.2, -1.2, 0.1), 0.03, True),
        ((1.2, -1.2, 0.1), 0.2, False),  # not surely
        ((4.0, 0.0, 6.0), 0.03, False),  # as a receiver has it at the gate
        ((4.0, 0.0, 2.0), 0.03, True),
        ((1.4, 0.0, -0.4), 0.03, False),  # a pad sees height badly
    ],
)
def test_what_would_come_down_beside_its_pad_strays(place_m, sigma_m, strays):
    covariance = tuple(tuple(sigma_m**2 if i == j else 0.0 for j in range(3)) for i in range(3))
    assert Fix(place_m, covariance).strays is strays


EAST = Attitude(0.0, 0.0, math.pi / 2)


def told(stack, *, antenna=(0.0, 0.0, 0.0), attitude=EAST, local=True, where=(2.0, 3.0, 5.0)):
    """The target after a second above that place; the nose to the east."""
    landing = PrecisionLanding(antenna)
    for t_ms in range(0, 1_000, 50):
        lat_e7, lon_e7, height_mm = to_wgs84(PAD.frame, *(round(1e3 * x) for x in where))
        claim = Claim(
            lat_e7=lat_e7, lon_e7=lon_e7, height_mm=height_mm, accuracy_mm=500, height_accuracy_mm=500, t_ms=t_ms
        )
        for mac, place in places().items():
            landing.range(PAD, mac, t_ms, round(1e3 * math.dist(where, place)))
        landing.believe(claim, t_ms)
        landing.take(attitude, t_ms)
        if local:
            landing.take(LocalPosition(10.0, 20.0, -30.0), t_ms)
    return landing.target(PAD.frame, stack, 1, 1_000)


def test_ardupilot_is_told_the_pad_as_seen_from_the_vehicle():
    target = told(ARDUPILOT)
    assert target.frame == BODY_FRD
    # The pad is 2 m west of it: behind; 3 m south of it: to the right; 5 m below.
    assert target.place_m == pytest.approx((-2.0, 3.0, 5.0), abs=0.15)
    assert target.distance_m == pytest.approx(math.hypot(2, 3, 5), abs=0.15)


def test_px4_is_told_a_place_of_its_own_filter():
    target = told(PX4)
    assert target.frame == LOCAL_NED
    assert target.place_m == pytest.approx((10 - 3, 20 - 2, -30 + 5), abs=0.15)
    assert told(PX4, local=False) is None


def test_the_antennas_arm_turns_with_the_vehicle():
    """The node a metre ahead (east): the autopilot's reference is a metre further west, nearer to the pad's middle."""
    target = told(ARDUPILOT, antenna=(1.0, 0.0, 0.0))
    assert target.place_m == pytest.approx((-1.0, 3.0, 5.0), abs=0.15)
    rolled = told(ARDUPILOT, antenna=(0.0, 0.0, 1.0), attitude=Attitude(math.radians(20), 0.0, 0.0))
    level = told(ARDUPILOT, antenna=(0.0, 0.0, 1.0), attitude=Attitude(0.0, 0.0, 0.0))
    assert math.hypot(*rolled.place_m) != pytest.approx(math.hypot(*level.place_m), abs=0.05)


def test_nothing_is_told_of_another_pad_or_without_attitude():
    landing = PrecisionLanding()
    for mac, place in places().items():
        landing.range(PAD, mac, 0, round(1e3 * math.dist((0, 0, 5), place)))
    assert landing.target(PAD.frame, ARDUPILOT, 1, 100) is None
    landing.take(Attitude(math.nan, 0.0, 0.0), 100)
    assert landing.target(PAD.frame, ARDUPILOT, 1, 100) is None
    assert landing.fix(replace(PAD.frame, lat_e7=1), 100) is None
