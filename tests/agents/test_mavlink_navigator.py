"""An autopilot's messages become a claim, or a reason why there is none: the core, with messages and time handed in."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kit.fake_autopilot import FakeAutopilot, dialect
from kit.geoids import write_geoid

from wonderland.geoid import Geoid
from wonderland.proofs.records.sessions import Claim
from wonderland_uav_agent.position import PositionError
from wonderland_uav_agent.position.mavlink import SerialAddress, TcpAddress, UdpAddress, parse_address
from wonderland_uav_agent.position.mavlink.messages import (
    Acknowledged,
    AskFor,
    GlobalPosition,
    Heartbeat,
    OutOfStep,
    SayAlive,
    Sender,
    SystemTime,
)
from wonderland_uav_agent.position.mavlink.navigator import Navigator
from wonderland_uav_agent.position.mavlink.wire import Wire
from wonderland_uav_agent.position.receiver import GpsRaw, horizontal_95_mm, vertical_95_mm

NOW = 1_800_000_000_000
DRONE, OTHER = Sender(1, 1), Sender(7, 1)
COPTER, STATION = Heartbeat(2, 3), Heartbeat(6, 8)
GPS = GpsRaw(3, 12_000, 31_400, 200, 400)
HERE = GlobalPosition(30_000, 604_518_000, 222_666_000, 13_000)
UTC = SystemTime((NOW + 40) * 1_000, 30_000)
NO_TIME = SystemTime(0, 30_000)
UINT32_MAX = 0xFFFFFFFF


@pytest.fixture(scope="module")
def geoid(tmp_path_factory):
    return Geoid(write_geoid(tmp_path_factory.mktemp("geoid") / "WW15MGH.DAC"))


class Told:
    """A navigator, and what it warned of."""

    def __init__(self, *messages, now=NOW, geoid=None, time=NO_TIME):
        self.warned = []
        self.navigator = Navigator(self.warned.append, geoid)
        for message in messages:
            self.take(message, now)
            if message is COPTER and time is not None:
                self.take(time, now)

    def take(self, message, now, sender=DRONE):
        self.navigator.take(message, sender, now)

    def claim(self, now=NOW):
        return self.navigator.claim(now)

    def why(self, now=NOW):
        assert (self.navigator.claim(now) is None) == bool(self.navigator.why_not(now))
        return self.navigator.why_not(now)


def test_a_claim_has_the_filters_place_the_receivers_accuracy_and_the_autopilots_time():
    told = Told(COPTER, GPS, UTC, replace(HERE, boot_ms=30_100), now=NOW)
    assert told.claim() == Claim(
        lat_e7=604_518_000,
        lon_e7=222_666_000,
        height_mm=13_000 + 19_400,
        accuracy_mm=490,
        height_accuracy_mm=784,
        t_ms=NOW + 140,
    )
    assert told.navigator.skew_ms == 40
    assert told.warned == []


def test_accuracies_hold_95_percent_and_are_rounded_outwards():
    assert (horizontal_95_mm(1), horizontal_95_mm(1_000)) == (3, 2_450)
    assert (vertical_95_mm(1), vertical_95_mm(1_000)) == (2, 1_960)


def test_a_time_that_is_about_to_come_is_waited_for_and_no_claim_goes_back():
    """SYSTEM_TIME comes once a second; this autopilot is 204 ms behind."""
    navigator = Navigator([].append, None)
    times = []
    for tenth in range(60):
        boot_ms, now = 30_000 + 100 * tenth, NOW + 100 * tenth
        for message in (COPTER, GPS, replace(HERE, boot_ms=boot_ms)):
            navigator.take(message, DRONE, now)
        if tenth % 10 == 7:
            navigator.take(SystemTime((now - 204) * 1_000, boot_ms), DRONE, now)
        times.append(navigator.claim(now))
    assert times[:8] == [None] * 8
    assert [claim.t_ms for claim in times[8:]] == [NOW + 100 * tenth - 204 for tenth in range(8, 60)]


def test_where_no_time_ever_comes_the_arrival_stands_in():
    navigator = Navigator([].append, None)
    for tenth in range(31):
        for message in (COPTER, GPS, replace(HERE, boot_ms=30_000 + 100 * tenth)):
            navigator.take(message, DRONE, NOW + 100 * tenth)
        assert (navigator.claim(NOW + 100 * tenth) is None) == (tenth < 30)
    assert navigator.claim(NOW + 3_000).t_ms == NOW + 3_000


def test_before_the_autopilot_knows_the_time_the_arrival_stands_in():
    told = Told(COPTER, GPS, SystemTime(0, 30_000), HERE)
    assert told.claim().t_ms == NOW
    told.take(SystemTime(86_400 * 1_000_000, 30_100), NOW + 100)  # 1970
    told.take(replace(HERE, boot_ms=30_100), NOW + 100)
    assert told.claim(NOW + 100).t_ms == NOW + 100


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        ([], "no heartbeat"),
        ([STATION, GPS, HERE], "no heartbeat"),
        ([Heartbeat(2, 8), GPS, HERE], "no heartbeat"),
        ([Heartbeat(6, 3), GPS, HERE], "no heartbeat"),
        ([COPTER], "no GLOBAL_POSITION_INT from the autopilot"),
        ([COPTER, HERE], "no GPS_RAW_INT from the autopilot"),
        ([COPTER, replace(GPS, fix_type=2), HERE], "no 3-D fix .fix type 2"),
        ([COPTER, replace(GPS, fix_type=7), HERE], "no 3-D fix"),
        ([COPTER, replace(GPS, fix_type=255), HERE], "no 3-D fix"),
        ([COPTER, replace(GPS, h_acc_mm=0), HERE], "no accuracy stated"),
        ([COPTER, replace(GPS, v_acc_mm=0), HERE], "no accuracy stated"),
        ([COPTER, replace(GPS, h_acc_mm=UINT32_MAX), HERE], "no accuracy stated"),
        ([COPTER, replace(GPS, v_acc_mm=UINT32_MAX), HERE], "no accuracy stated"),
        ([COPTER, replace(GPS, alt_ellipsoid_mm=0), HERE], "no height above the ellipsoid"),
        ([COPTER, replace(GPS, alt_ellipsoid_mm=12_000), HERE], "no height above the ellipsoid"),
        ([COPTER, replace(GPS, alt_ellipsoid_mm=12_000 + 120_001), HERE], "no height above the ellipsoid"),
        ([COPTER, GPS, replace(HERE, lat_e7=0, lon_e7=0)], "does not know yet where it is"),
        ([COPTER, GPS, replace(HERE, lat_e7=900_000_001)], "no position: .*lat_e7"),
        ([COPTER, GPS, replace(HERE, lat_e7=2**31 - 1, lon_e7=2**31 - 1)], "no position"),
        ([COPTER, GPS, replace(HERE, lon_e7=-(2**31))], "no position: .*lon_e7"),
        ([COPTER, GPS, replace(HERE, alt_mm=2**31 - 1)], "no position: .*height_mm"),
    ],
)
def test_what_is_missing_is_said(messages, reason):
    import re

    assert re.search(reason, Told(*messages).why())


@pytest.mark.parametrize("ellipsoidal_mm", [0, 12_000, 12_000 + 120_001])
def test_a_geoids_grid_stands_in_for_a_receiver_without_a_geoid(geoid, ellipsoidal_mm):
    claim = Told(COPTER, replace(GPS, alt_ellipsoid_mm=ellipsoidal_mm), HERE, geoid=geoid).claim()
    assert (claim.height_mm, claim.height_accuracy_mm) == (13_000 + 60_452, 784 + 1_000)


def test_the_receivers_own_geoid_goes_before_the_grid(geoid):
    claim = Told(COPTER, GPS, HERE, geoid=geoid).claim()
    assert (claim.height_mm, claim.height_accuracy_mm) == (13_000 + 19_400, 784)


def test_the_equator_and_greenwich_are_places():
    assert Told(COPTER, GPS, replace(HERE, lat_e7=0)).claim().lat_e7 == 0
    assert Told(COPTER, GPS, replace(HERE, lon_e7=0)).claim().lon_e7 == 0


def test_a_bad_position_ends_the_good_one():
    told = Told(COPTER, GPS, HERE)
    told.take(replace(HERE, boot_ms=30_100, lat_e7=0, lon_e7=0), NOW + 100)
    assert told.claim(NOW + 100) is None


def test_it_is_stale_after_a_second_and_so_is_the_receiver_after_two():
    told = Told(COPTER, GPS, HERE)
    assert told.claim(NOW + 1_000) is not None
    assert told.why(NOW + 1_001) == "no GLOBAL_POSITION_INT for 1.0 s"
    told.take(replace(HERE, boot_ms=32_000), NOW + 2_000)
    assert told.claim(NOW + 2_000) is not None
    told.take(replace(HERE, boot_ms=32_001), NOW + 2_001)
    assert told.why(NOW + 2_001) == "no GPS_RAW_INT for 2.0 s"


def test_the_same_message_again_or_an_overtaken_one_makes_nothing_fresh():
    told = Told(COPTER, GPS, HERE)
    for later in range(100, 1_500, 100):
        told.take(replace(HERE, boot_ms=29_950 + later % 200 // 2, lat_e7=1), NOW + later)
    assert told.claim(NOW + 1_000).lat_e7 == HERE.lat_e7
    assert told.claim(NOW + 1_001) is None


def test_a_second_autopilot_is_left_out_while_the_first_is_alive():
    told = Told(COPTER, GPS, HERE)
    for beat in range(10):
        told.take(COPTER, NOW + beat, OTHER)
        told.take(COPTER, NOW + beat, Sender(1, 1, ("10.0.0.9", 14_550)))  # the same number from elsewhere
    told.take(replace(HERE, boot_ms=30_100, lat_e7=1), NOW + 100, OTHER)
    told.take(replace(HERE, boot_ms=30_100, lat_e7=1), NOW + 100, Sender(1, 154))  # a gimbal of the drone
    assert told.claim(NOW + 100).lat_e7 == HERE.lat_e7
    assert told.navigator.sender == DRONE
    assert told.navigator.strangers == 21
    assert [text for text in told.warned if "another system" in text] == told.warned
    assert len(told.warned) == 1


def test_there_is_no_position_while_two_speak_in_the_autopilots_name():
    told = Told(COPTER, GPS, HERE)
    for back in (0, 2_000, 5_001):
        told.take(OutOfStep(), NOW + back)
        told.take(OutOfStep(), NOW + back, OTHER)
    told.take(GPS, NOW + 5_001)
    told.take(replace(HERE, boot_ms=35_000), NOW + 5_001)
    assert told.claim(NOW + 5_001), "three, but not within five seconds"
    told.take(OutOfStep(), NOW + 5_002)
    assert told.why(NOW + 5_002).startswith("two speak as the autopilot")
    told.take(GPS, NOW + 10_000)
    told.take(replace(HERE, boot_ms=40_000), NOW + 10_000)
    assert told.claim(NOW + 10_000), "and it is over"
    assert len(told.warned) == 1


def test_a_silent_autopilot_is_given_up_for_the_next():
    told = Told(COPTER, GPS, HERE)
    told.take(COPTER, NOW + 5_000, OTHER)
    assert told.navigator.sender == DRONE
    told.take(STATION, NOW + 5_001, OTHER)
    told.take(HERE, NOW + 5_001, OTHER)
    assert told.navigator.sender == DRONE
    told.take(COPTER, NOW + 5_001, OTHER)
    assert told.navigator.sender == OTHER
    assert told.why(NOW + 5_001).startswith("no GLOBAL_POSITION_INT")
    assert "silent" in told.warned[-1]


def test_another_boot_forgets_the_time_and_the_fix_of_the_one_before():
    told = Told(COPTER, GPS, UTC, HERE)
    told.take(replace(HERE, boot_ms=500), NOW + 900)
    assert told.why(NOW + 900).startswith("no GPS_RAW_INT")
    told.take(GPS, NOW + 950)
    told.take(replace(HERE, boot_ms=600), NOW + 1_000)
    assert told.why(NOW + 1_000) == "the autopilot has not said its time yet"
    told.take(SystemTime((NOW + 1_200) * 1_000, 700), NOW + 1_100)
    told.take(replace(HERE, boot_ms=710), NOW + 1_110)
    assert told.claim(NOW + 1_110).t_ms == NOW + 1_210
    assert len([text for text in told.warned if "jumped" in text]) == 1


def test_a_jump_ahead_is_another_boot_as_well():
    told = Told(COPTER, GPS, UTC, HERE)
    told.take(GPS, NOW + 50)
    told.take(replace(HERE, boot_ms=33_000), NOW + 100)
    assert told.claim(NOW + 100) is None
    assert "jumped" in told.warned[-1]


def test_a_boot_time_that_creeps_is_found():
    told = Told(COPTER, GPS, HERE)
    for step in range(1, 60):
        told.take(GPS, NOW + 100 * step)
        told.take(replace(HERE, boot_ms=30_000 + 50 * step), NOW + 100 * step)
    assert "jumped" in told.warned[0]


def test_crystals_that_drift_apart_are_no_other_boot_while_the_autopilot_says_the_time():
    told = Told(COPTER, GPS, UTC, HERE)
    for second in range(1, 61):
        boot_ms, now = 30_000 + 950 * second, NOW + 1_000 * second
        told.take(GPS, now)
        told.take(SystemTime((now + 40) * 1_000, boot_ms), now)
        told.take(replace(HERE, boot_ms=boot_ms), now)
        assert told.claim(now).t_ms == now + 40


def test_an_autopilot_whose_time_is_wrong_is_told_of_once():
    told = Told(COPTER, GPS, SystemTime((NOW - 3_000) * 1_000, 30_000), HERE)
    told.take(SystemTime((NOW - 2_000) * 1_000, 31_000), NOW + 1_000)
    assert told.navigator.skew_ms == -3_000
    assert len(told.warned) == 1
    assert "3000 ms behind" in told.warned[0]


def test_it_asks_for_what_does_not_come_ever_more_rarely():
    told = Told(COPTER, time=None)
    assert told.navigator.outgoing(NOW) == [SayAlive(1)]
    asked = {33: [], 24: [], 2: []}
    for at in range(0, 20_000, 100):
        for each in told.navigator.outgoing(NOW + at):
            if isinstance(each, AskFor):
                asked[each.message_id].append(at)
    assert asked[33] == asked[24] == asked[2] == [600, 1_100, 2_100, 4_100, 8_100, 16_100]


def test_it_leaves_an_autopilot_alone_that_sends_by_itself_and_asks_one_that_sends_too_seldom():
    often, seldom = Told(COPTER), Told(COPTER)
    asked = {"often": set(), "seldom": set()}
    for at in range(0, 6_000, 100):
        for name, told in (("often", often), ("seldom", seldom)):
            if name == "often" or at % 1_000 == 0:
                told.take(replace(HERE, boot_ms=30_000 + at), NOW + at)
            told.take(GPS, NOW + at)
            told.take(SystemTime((NOW + at) * 1_000, 30_000 + at), NOW + at)
            asked[name] |= {each.message_id for each in told.navigator.outgoing(NOW + at) if isinstance(each, AskFor)}
    assert asked == {"often": set(), "seldom": {33}}


def test_refusals_are_counted_and_said():
    told = Told(COPTER, time=None)
    told.navigator.outgoing(NOW + 600)
    for result in (0, 5, 3, 2):
        told.take(Acknowledged(511, result), NOW + 700)
    told.take(Acknowledged(400, 4), NOW + 700)
    told.take(Acknowledged(511, 4), NOW + 700, OTHER)
    assert told.navigator.refused == 2
    assert told.why(NOW + 700).endswith("; the autopilot refused 2 of 3 requests")


U8, U32, I32 = st.integers(0, 255), st.integers(0, UINT32_MAX), st.integers(-(2**31), 2**31 - 1)
SENDERS = st.builds(Sender, st.integers(0, 3), st.integers(0, 2), st.sampled_from([None, ("127.0.0.1", 5)]))
MESSAGES = st.one_of(
    st.builds(Heartbeat, U8, U8),
    st.builds(SystemTime, st.integers(0, 2**64 - 1), U32),
    st.builds(GpsRaw, U8, I32, I32, U32, U32),
    st.builds(GlobalPosition, U32, I32, I32, I32),
    st.builds(Acknowledged, st.integers(0, 65_535), U8),
    st.just(OutOfStep()),
    st.sampled_from([COPTER, GPS, UTC, HERE]),
)


@settings(deadline=None)  # a busy machine is no bug
@given(st.lists(st.tuples(MESSAGES, st.one_of(SENDERS, st.just(DRONE)), st.integers(-5_000, 5_000)), max_size=30))
def test_whatever_an_autopilot_says_every_claim_is_a_whole_one(geoid, heard):
    told, now = Told(geoid=geoid), NOW
    for message, sender, waited in heard:
        now += waited
        told.take(message, now, sender)
        told.navigator.outgoing(now)
        claim = told.claim(now)
        assert (claim is None) == bool(told.why(now))
        if claim is not None:
            assert Claim.decode(claim.encode(), max_bytes=1_024) == claim


@given(st.lists(st.binary(max_size=400), max_size=8))
def test_bytes_that_are_no_mavlink_raise_nothing_and_claim_nothing(pieces):
    told, wire = Told(), Wire()
    for piece in pieces:
        for message, sender in wire.read(piece):
            told.take(message, NOW, sender)
    assert told.claim() is None


@given(st.data())
def test_damaged_messages_raise_nothing(data):
    drone, wire = FakeAutopilot(), Wire()
    stream = bytearray(drone.heartbeat() + drone.message(24) + drone.message(2) + drone.message(33))
    for _ in range(data.draw(st.integers(1, 4))):
        stream[data.draw(st.integers(0, len(stream) - 1))] = data.draw(U8)
    told = Told()
    for message, sender in wire.read(bytes(stream)):
        told.take(message, NOW, sender)
    claim = told.claim()
    assert claim is None or (claim.lat_e7, claim.lon_e7, claim.accuracy_mm) == (drone.lat, drone.lon, 490)


def test_a_message_may_come_in_pieces_and_after_noise():
    drone, wire = FakeAutopilot(), Wire()
    heard = []
    for _ in range(50):
        stream = b"\x00\x11" + drone.message(33)
        for start in range(0, len(stream), 7):
            heard += wire.read(stream[start : start + 7])
    assert len(heard) == wire.bad == 50


def test_messages_numbers_say_when_two_speak_in_one_name():
    def out_of_step(numbers):
        drone, wire = FakeAutopilot(), Wire()
        heard = []
        for number in numbers:
            drone._mav.seq = number - 1
            heard += wire.read(drone.message(33))
        return sum(isinstance(message, OutOfStep) for message, _ in heard)

    assert out_of_step([*range(1, 256), *range(256)]) == 0
    assert out_of_step([1, 2, 100, 227, 20]) == 0, "losses"
    assert out_of_step([1, 2, 4, 3, 20, 5, 21, 21]) == 0, "overtaking, repeating"
    assert out_of_step([100, 1, 2, 3]) == 1, "a restart"
    assert out_of_step([1, 90, 2, 91, 3, 92, 4]) == 3, "two"


def test_each_component_counts_for_itself():
    drone, wire = FakeAutopilot(), Wire()
    heard = []
    for number in range(100):
        for component, ahead in ((1, 0), (154, 90)):
            drone._mav.seq = number + ahead
            heard += wire.read(drone.pack(dialect.MAVLink_system_time_message(0, 0), component))
    assert len(heard) == 200


def test_whoever_never_ends_a_message_fills_no_memory():
    drone, wire = FakeAutopilot(), Wire()
    whole = drone.heartbeat()
    wire.read(whole[:5])
    for _ in range(500):
        wire.read(whole[5:] + whole[:5])
    assert wire.bad == 0
    assert len(wire._parser.buf) == 5


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udp:127.0.0.1:14540", UdpAddress("127.0.0.1", 14_540)),
        ("udp:[::1]:14540", UdpAddress("::1", 14_540)),
        ("tcp:10.0.0.2:5760", TcpAddress("10.0.0.2", 5_760)),
        ("serial:/dev/ttyACM0", SerialAddress("/dev/ttyACM0")),
        ("serial:/dev/ttyS1:57600", SerialAddress("/dev/ttyS1", 57_600)),
        ("serial:/dev/serial/by-path/usb-0:1:1.0", SerialAddress("/dev/serial/by-path/usb-0:1:1.0")),
    ],
)
def test_addresses(text, address):
    assert parse_address(text) == address
    assert parse_address(str(address).removeprefix("mavlink:")) == address


@pytest.mark.parametrize(
    "text", ["", "udp", "udp:1", "udp::5", "udp:a:70000", "tcp:a:0", "tcp:a:x", "serial:", "i2c:1:2"]
)
def test_what_is_no_address_is_told_how_to_be_one(text):
    with pytest.raises(PositionError, match="give mavlink:udp:HOST:PORT"):
        parse_address(text)
