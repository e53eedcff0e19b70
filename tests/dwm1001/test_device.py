"""The state machine alone: time and octets by hand."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fira_uci.dwm1001 import (
    AnchorDistance,
    BoardLost,
    BoardReady,
    Configuration,
    Dwm1001Device,
    Generation,
    LocationReport,
    Mode,
    Reported,
    Version,
    tlv,
)

VERSION = Version((1, 3, 0, 1), 1, 2)
LINE = b"DIST,1,AN0,1151,5.00,8.00,2.25,6.44\r\n"


def location(range_mm: int, generation: Generation = Generation.PANS_R2, device_us: int = 1) -> bytes:
    return tlv.encode_location(LocationReport((AnchorDistance(0xA001, range_mm, 100),), None, device_us), generation)


def ranges(device: Dwm1001Device) -> list[int | None]:
    return [
        distance.range_mm
        for event in device.events()
        if isinstance(event, Reported) and isinstance(event.report, LocationReport)
        for distance in event.report.distances
    ]


@pytest.fixture
def tlv_device() -> Dwm1001Device:
    device = Dwm1001Device()
    device.port_up(0)
    assert device.data_to_send() == b"\x15\x00"
    device.receive_data(tlv.encode_version(VERSION), 5)
    assert device.data_to_send() == b"\x08\x00"
    device.receive_data(b"\x40\x01\x00\x46\x02\xb2\x00", 5)  # a tag, as the API guide has it
    assert device.data_to_send() == b"\x0c\x00"
    return device


@pytest.mark.parametrize(
    ("configuration", "why"),
    [(b"\xb2\x20", "an anchor"), (b"\xb2\x30", "an anchor"), (b"\xb1\x00", "passive"), (b"\xb0\x00", "switched off")],
)
def test_a_board_in_another_role_is_not_ready_until_it_has_the_right_one(configuration, why):
    device = Dwm1001Device()
    device.port_up(0)
    device.receive_data(tlv.encode_version(VERSION), 5)
    device.receive_data(b"\x40\x01\x00\x46\x02" + configuration, 5)
    (lost,) = device.events()
    assert isinstance(lost, BoardLost)
    assert why in lost.detail
    assert "uwb prepare" in lost.detail
    device.data_to_send()
    due_ms = device.next_timeout_ms()
    device.advance(due_ms)
    assert device.data_to_send() == b"\x08\x00"  # it is asked again, and no range of it is believed before
    device.receive_data(b"\x40\x01\x00\x46\x02\xb2\x00", due_ms + 5)
    device.receive_data(location(5_000), due_ms + 10)
    assert device.is_ready


def test_a_tag_where_an_anchor_is_wanted_is_not_ready_either():
    device = Dwm1001Device(as_anchor=True)
    device.port_up(0)
    device.receive_data(tlv.encode_version(VERSION), 5)
    device.receive_data(tlv.encode_configuration(Configuration(is_anchor=False)), 5)
    (lost,) = device.events()
    assert "a tag" in lost.detail


def test_firmware_that_does_not_tell_its_role_is_asked_for_ranges():
    device = Dwm1001Device()
    device.port_up(0)
    device.receive_data(tlv.encode_version(VERSION), 5)
    device.receive_data(tlv.encode_status(1), 6)
    device.receive_data(location(5_000), 10)
    assert device.is_ready


def test_asks_at_a_steady_pace_and_no_round_counts_twice(tlv_device):
    tlv_device.receive_data(location(5_000), 10)
    assert tlv_device.events()[0] == BoardReady(VERSION, Generation.PANS_R2)
    assert tlv_device.next_timeout_ms() == 105
    tlv_device.advance(104)
    assert tlv_device.data_to_send() == b""
    for now_ms, range_mm in ((105, 5_000), (205, 5_010), (305, 5_010), (405, 5_000)):
        tlv_device.advance(now_ms)
        assert tlv_device.data_to_send() == b"\x0c\x00"
        tlv_device.receive_data(location(range_mm), now_ms + 1)
    assert ranges(tlv_device) == [5_010, 5_000]


def test_leaps_is_found_out_and_its_time_stamp_tells_rounds_apart(tlv_device):
    tlv_device.receive_data(b"\x40\x01\x03", 10)
    tlv_device.advance(105)
    assert tlv_device.data_to_send() == b"\x0c\x01\x03"
    tlv_device.receive_data(location(5_000, Generation.LEAPS, 7), 110)
    tlv_device.advance(205)
    tlv_device.receive_data(location(5_000, Generation.LEAPS, 8), 210)
    assert tlv_device.is_ready
    events = tlv_device.events()
    assert events[0] == BoardReady(VERSION, Generation.LEAPS)
    assert len(events) == 3


@pytest.mark.parametrize("status", [1, 4])
def test_a_board_that_refuses_for_long_is_named_once_and_may_come_round(tlv_device, status):
    for now_ms in range(10, 1_000, 100):
        tlv_device.receive_data(bytes((0x40, 1, status)), now_ms)
        tlv_device.advance(now_ms + 99)
    lost = [event for event in tlv_device.events() if isinstance(event, BoardLost)]
    assert len(lost) == 1
    assert "configured as a tag" in lost[0].detail
    tlv_device.receive_data(location(5_000), 1_010)
    assert tlv_device.is_ready


def test_busy_is_asked_again_and_nonsense_is_counted(tlv_device):
    tlv_device.receive_data(b"\x40\x01\x04", 10)
    tlv_device.advance(105)
    tlv_device.receive_data(b"\x40\x01\x00\x49\x02\x01\x00", 110)
    tlv_device.advance(205)
    tlv_device.receive_data(location(5_000), 210)
    assert ranges(tlv_device) == [5_000]
    assert tlv_device.reports_bad == 1


def test_a_lost_answer_is_asked_again_three_and_the_board_is_lost(tlv_device):
    tlv_device.receive_data(location(5_000), 10)
    tlv_device.events()
    now_ms, asked = 105, b""
    for _ in range(4):
        tlv_device.advance(now_ms)
        asked += tlv_device.data_to_send()
        assert tlv_device.next_timeout_ms() is not None
        now_ms = tlv_device.next_timeout_ms() or 0
    assert asked == b"\x0c\x00" * 3
    assert [type(event) for event in tlv_device.events()] == [BoardLost]
    tlv_device.advance(now_ms)
    assert tlv_device.data_to_send() == b"\x15\x00", "begins anew: it may be another board"
    tlv_device.receive_data(tlv.encode_version(VERSION) + b"\xff", now_ms + 1)
    tlv_device.receive_data(tlv.encode_configuration(Configuration(is_anchor=False)), now_ms + 1)
    tlv_device.receive_data(location(4_000), now_ms + 2)
    assert ranges(tlv_device) == [4_000]


def test_a_board_left_in_its_shell_is_told_to_leave_it(tlv_device):
    for now_ms in (255, 505, 755):
        tlv_device.receive_data(b"\r\nunknown command\r\ndwm> ", now_ms - 10)
        tlv_device.advance(now_ms)
    assert b"\rquit\r" in tlv_device.data_to_send()
    assert "shell mode" in tlv_device.events()[-1].detail


def test_a_port_that_goes_is_said_and_nothing_more_is_done(tlv_device):
    tlv_device.port_down("pulled out")
    assert tlv_device.events() == [BoardLost("pulled out")]
    tlv_device.receive_data(location(5_000), 20)
    tlv_device.advance(10_000)
    assert (tlv_device.events(), tlv_device.data_to_send(), tlv_device.next_timeout_ms()) == ([], b"", None)


def test_shell_does_not_toggle_a_stream_that_runs():
    device = Dwm1001Device(Mode.LEC)
    device.port_up(0)
    device.receive_data(b"51,5.00,8.00\r\n" + LINE, 100)
    assert ranges(device) == [6_440]
    device.advance(400)
    assert device.data_to_send() == b""


def test_shell_enters_asks_once_and_resets_a_silent_board():
    device = Dwm1001Device(Mode.LEC)
    device.port_up(0)
    device.advance(400)
    assert device.data_to_send() == b"\r\r"
    device.receive_data(b"@\x01\x01\r\n DWM1001 TWR\r\n\r\ndwm> ", 500)
    assert device.data_to_send() == b"lec\r"
    device.receive_data(b"lec\r\ndwm> " + LINE, 600)
    assert device.data_to_send() == b""
    assert isinstance(device.events()[0], BoardReady)
    silences = []
    now_ms = 600
    for _ in range(3):
        silences.append((device.next_timeout_ms() or 0) - now_ms)
        now_ms += silences[-1]
        device.advance(now_ms)
        assert device.data_to_send() == b"\rreset\r"
        now_ms += 1_500
        device.advance(now_ms)
        assert device.data_to_send() == b"\r\r"
        device.receive_data(b"dwm> ", now_ms)
        assert device.data_to_send() == b"lec\r"
    assert silences == [5_000, 10_000, 20_000]
    device.receive_data(LINE, now_ms + 1)
    assert device.is_ready


def test_no_prompt_is_said_once_and_tried_again():
    device = Dwm1001Device(Mode.LES)
    device.port_up(0)
    for now_ms in (400, 1_900, 3_400):
        device.advance(now_ms)
        assert device.data_to_send() == b"\r\r"
    assert [type(event) for event in device.events()] == [BoardLost]


@settings(max_examples=100, deadline=None)
@given(
    st.sampled_from(Mode),
    st.lists(
        st.tuples(
            st.integers(0, 400),
            st.binary(max_size=60)
            | st.sampled_from([LINE, b"dwm> ", location(5_000), tlv.encode_version(VERSION), b"\x40\x01\x01"]),
        ),
        max_size=30,
    ),
)
def test_whatever_comes_the_machine_goes_on(mode, happenings):
    device = Dwm1001Device(mode)
    device.port_up(0)
    now_ms = 0
    for wait_ms, octets in happenings:
        now_ms += wait_ms
        device.receive_data(octets, now_ms)
        device.advance(now_ms)
        assert len(device.data_to_send()) < 64
        device.events()
        due_ms = device.next_timeout_ms()
        assert due_ms is not None
        assert due_ms <= now_ms + 60_000
