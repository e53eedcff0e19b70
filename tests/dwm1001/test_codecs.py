"""Both codecs: golden bytes of the vendors' guides, every value there and back, and whatever a line may bring."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fira_uci.dwm1001 import (
    AnchorDistance,
    BoardPosition,
    Dwm1001DecodeError,
    Dwm1001EncodeError,
    Dwm1001Error,
    Dwm1001StatusError,
    Generation,
    HeardPosition,
    LocationReport,
    Version,
    shell,
    tlv,
)
from wonderland_simulator.dwm1001_node.lines import WRITERS

OK = tlv.Tlv(tlv.STATUS, b"\0")
ENOUGH = settings(max_examples=150, deadline=None)

# From the API guides: x 121 mm, y 50 mm, z 251 mm, 100 %; then one anchor 0x8015, 4,567 mm, 100 %, at (1, 2, 3) mm.
POSITION = bytes.fromhex("410d 79000000 32000000 fb000000 64")
PANS = bytes.fromhex("400100") + POSITION + bytes.fromhex("4915 01 1580 d7110000 64 01000000 02000000 03000000 64")
LEAPS = (
    bytes.fromhex("400100")
    + POSITION
    + bytes.fromhex("491a 640a0100 01 01 1580 d7110000 5f 01000000 02000000 03000000 64")
)
VERSION = bytes.fromhex("400100 5004 01000101 5104 00070100 5204 2a00cade")


def answer(octets: bytes, command: int = tlv.LOC_GET) -> list[tlv.Tlv]:
    reader = tlv.AnswerReader()
    reader.begin(command)
    frames = reader.feed(octets)
    assert frames is not None
    return frames


def test_golden_pans():
    report, generation = tlv.decode_location(answer(PANS))
    assert generation is Generation.PANS_R2
    assert report == LocationReport(
        (AnchorDistance(0x8015, 4_567, 100, BoardPosition(1, 2, 3, 100)),), BoardPosition(121, 50, 251, 100)
    )
    assert tlv.encode_location(report, generation) == PANS
    assert tlv.location_request(generation).encode() == b"\x0c\x00"


def test_golden_leaps():
    report, generation = tlv.decode_location(answer(LEAPS), Generation.LEAPS)
    assert generation is Generation.LEAPS
    assert (report.device_us, report.moving) == (0x10A64, True)
    assert report.distances[0] == AnchorDistance(0x8015, 4_567, 0x5F, BoardPosition(1, 2, 3, 100))
    assert tlv.encode_location(report, generation) == LEAPS
    assert tlv.location_request(generation).encode() == b"\x0c\x01\x03"
    assert tlv.decode_location(answer(LEAPS))[1] is Generation.LEAPS, "told apart without knowing how one asked"


def test_four_anchors_have_the_length_of_the_guides():
    rows = tuple(AnchorDistance(n, 1_000, 100, BoardPosition(0, 0, 0, 100)) for n in range(4))
    for generation, length in ((Generation.PANS_R2, 0x51), (Generation.LEAPS, 0x56)):
        octets = tlv.encode_location(LocationReport(rows), generation)
        assert octets[3 + 15 : 3 + 15 + 2] == bytes((0x49, length))


def test_list_of_an_anchor_has_long_addresses():
    row = (0xDECA_0123_4567_8015).to_bytes(8, "little") + (2_345).to_bytes(4, "little") + b"\x5a"
    report, _ = tlv.decode_location([OK, tlv.Tlv(tlv.DISTANCES, b"\x02" + row + b"\x01" + row[1:])])
    assert [d.address & 0xFFFF for d in report.distances] == [0x8015, 0x8001]
    assert report.distances[0].range_mm == 2_345


def test_golden_version():
    version = tlv.decode_version(answer(VERSION, tlv.VER_GET))
    assert version == Version((1, 1, 0, 1), 0x00010700, 0xDECA002A)
    assert version.text == "1.1.0"
    assert tlv.encode_version(version) == VERSION


@pytest.mark.parametrize("status", range(1, 10))
def test_a_refusal_is_typed(status):
    with pytest.raises(Dwm1001StatusError, match="loc_get was answered by status") as caught:
        tlv.decode_location(answer(bytes((0x40, 1, status))))
    assert caught.value.status == status


@pytest.mark.parametrize(
    ("frames", "why"),
    [
        ([], "empty"),
        ([tlv.Tlv(0x41, bytes(13))], "begins with"),
        ([OK], "ends before"),
        ([OK, tlv.Tlv(0x41, bytes(12))], "12 octets"),
        ([OK, tlv.Tlv(0x41, bytes(13)), tlv.Tlv(0x41, bytes(13))], "no place"),
        ([OK, tlv.Tlv(0x49, b"")], "fit neither"),
        ([OK, tlv.Tlv(0x49, b"\x02" + bytes(20))], "fit neither"),
        ([OK, tlv.Tlv(0x49, b"\x02" + bytes(40))], "twice"),
        ([OK, tlv.Tlv(0x48, bytes((16,)) + b"".join(bytes((n, 0, 1, 0, 0, 0, 1)) for n in range(16)))], "at most 15"),
        ([OK, tlv.Tlv(0x48, b"\x00"), tlv.Tlv(0x48, b"\x00")], "no place"),
    ],
)
def test_malformed_answers(frames, why):
    with pytest.raises(Dwm1001DecodeError, match=why):
        tlv.decode_location(frames)


def test_what_does_not_fit_is_not_written():
    with pytest.raises(Dwm1001EncodeError):
        tlv.encode_location(LocationReport((AnchorDistance(1 << 16, 1),)), Generation.PANS_R2)
    with pytest.raises(Dwm1001EncodeError):
        tlv.Tlv(0x49, bytes(256)).encode()


@pytest.mark.parametrize("range_mm", [0, 1_000_001, 0xFFFFFFFF])
def test_absurd_ranges_are_none(range_mm):
    value = b"\x01" + b"\x01\xa0" + range_mm.to_bytes(4, "little") + b"\x64"
    report, _ = tlv.decode_location([OK, tlv.Tlv(tlv.DISTANCES, value)])
    assert report.distances == (AnchorDistance(0xA001, None, 100),)


coordinate = st.integers(-99_999_99, 99_999_99).map(lambda cm: cm * 10)
positions = st.builds(BoardPosition, coordinate, coordinate, coordinate, st.integers(1, 100))
distances = st.lists(
    st.builds(
        AnchorDistance,
        st.integers(0, 0xFFFF),
        st.integers(1, 99_999).map(lambda cm: cm * 10),
        st.integers(0, 100),
        positions,
    ),
    max_size=12,
    unique_by=lambda row: row.address,
).map(tuple)
reports = st.builds(LocationReport, distances, st.none() | positions)


@ENOUGH
@given(reports, st.sampled_from(Generation), st.binary(max_size=20), st.integers(1, 30))
def test_there_and_back_in_pieces_after_noise(report, generation, noise, piece):
    reader = tlv.AnswerReader()
    reader.begin(tlv.LOC_GET)
    noise = noise.replace(b"\x40", b"\x3f")
    octets = noise + tlv.encode_location(report, generation)
    frames = None
    for start in range(0, len(octets), piece):
        assert frames is None
        frames = reader.feed(octets[start : start + piece])
    assert frames is not None
    decoded, _ = tlv.decode_location(frames, generation)
    assert (decoded.distances, decoded.position) == (report.distances, report.position)
    assert reader.octets_dropped == len(noise)


@ENOUGH
@given(st.binary(max_size=300), st.sampled_from([tlv.LOC_GET, tlv.VER_GET]))
def test_any_octets_are_an_answer_or_a_typed_error(octets, command):
    reader = tlv.AnswerReader()
    reader.begin(command)
    frames = reader.feed(octets)
    if frames is not None:
        with_typed_errors(lambda: tlv.decode_location(frames))
        with_typed_errors(lambda: tlv.decode_version(frames))
    reader.begin(command)
    assert reader.feed(VERSION if command == tlv.VER_GET else PANS) is not None, "the next question is answered"


def with_typed_errors(call):
    with contextlib.suppress(Dwm1001Error):
        call()


# --- the shell -----------------------------------------------------------------------------------------------------


def test_golden_lines():
    report = shell.parse_line("1151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.00,2.25]=6.51 le_us=2576 est[2.57,1.98,1.68,100]")
    assert report == LocationReport(
        (
            AnchorDistance(0x1151, 6_480, None, BoardPosition(5_000, 8_000, 2_250)),
            AnchorDistance(0x0CA8, 6_510, None, BoardPosition(0, 8_000, 2_250)),
        ),
        BoardPosition(2_570, 1_980, 1_680, 100),
    )
    line = "DIST,2,AN0,1151,5.00,8.00,2.25,6.44,AN1,0CA8,0.00,8.00,-2.25,6.50,POS,2.55,-2.01,1.71,98"
    report = shell.parse_line(line)
    assert isinstance(report, LocationReport)
    assert [d.range_mm for d in report.distances] == [6_440, 6_500]
    assert report.position == BoardPosition(2_550, -2_010, 1_710, 98)
    assert not report.damaged
    assert shell.parse_line("POS,2.57,2.00,1.67,97") == LocationReport((), BoardPosition(2_570, 2_000, 1_670, 97))
    heard = HeardPosition(0x4CAD, BoardPosition(4_560, 3_290, 1_540, 90))
    assert shell.parse_line("POS,0,4CAD,4.56,3.29,1.54,90,x08") == heard
    assert shell.parse_line("lePOS,0,4CAD,4.56,3.29,1.54,90,x08") == heard


def test_a_spliced_line_gives_its_whole_parts():
    report = shell.parse_line(
        "DIST,4,AN0,0090,0.00,0.00,0.00,3.25,AN1,D91E,0.00,0.00,0.00,3.33,AN2,0487,0.00,0.00,0.00,0.18,"
        "AN3,15BA,0.00,0,AN3,15BA,0.00,0.00,0.00,0.00"
    )
    assert isinstance(report, LocationReport)
    assert report.damaged
    assert {d.address: d.range_mm for d in report.distances} == {0x90: 3_250, 0xD91E: 3_330, 0x487: 180, 0x15BA: None}


@pytest.mark.parametrize(
    ("line", "ranges"),
    [
        # A number cut short runs into the next line: 6.4 is not 6.44.
        ("DIST,1,AN0,1151,5.00,8.00,2.25,6.4DIST,1,AN0,1151,5.00,8.00,2.25,6.51", [6_510]),
        # Two different ranges of one anchor: neither is believed.
        ("DIST,1,AN0,1151,5.00,8.00,2.25,6.44,AN0,1151,5.00,8.00,2.25,9.44", []),
        ("1151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.001151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.00,2.25]=6.51", [6_480, 6_510]),
    ],
)
def test_cut_numbers_and_contradictions_are_left_out(line, ranges):
    try:
        report = shell.parse_line(line)
    except Dwm1001DecodeError:
        assert not ranges
    else:
        assert isinstance(report, LocationReport)
        assert report.damaged
        assert [d.range_mm for d in report.distances] == ranges


def test_nan_is_no_position_and_no_range():
    assert shell.parse_line("POS,nan,nan,nan,0") == LocationReport((), None)
    report = shell.parse_line("1151[5.00,8.00,2.25]=nan 0CA8[nan,nan,nan]=6.51 le_us=2576 est[nan,-nan,nan,0]")
    assert report == LocationReport(
        (AnchorDistance(0x1151, None, None, BoardPosition(5_000, 8_000, 2_250)), AnchorDistance(0x0CA8, 6_510)), None
    )


@pytest.mark.parametrize("line", ["dwm> ", "dwm> les", "lec", "[000044.980 INF] enc: off", "dwm> dwm> si"])
def test_chatter_says_nothing(line):
    assert shell.parse_line(line) is None


@pytest.mark.parametrize("line", ["@??", "DIST,", "AN0,ZZZZ", "]=[", "POS,1,2,3", "DIST,9,POS,1.00,1.00,1.00,50"])
def test_lines_without_sense_are_typed_errors(line):
    with pytest.raises(Dwm1001DecodeError):
        shell.parse_line(line)


@ENOUGH
@given(reports.filter(lambda report: report.distances), st.sampled_from(["les", "lec"]))
def test_lines_there_and_back(report, kind):
    parsed = shell.parse_line(WRITERS[kind](report))
    assert isinstance(parsed, LocationReport)
    assert not parsed.damaged
    assert parsed.position == report.position
    assert [(d.address, d.range_mm) for d in parsed.distances] == [(d.address, d.range_mm) for d in report.distances]


with_distances = reports.filter(lambda report: report.distances)


@ENOUGH
@given(with_distances, with_distances, st.sampled_from(["les", "lec"]), st.sampled_from(["", "?", "\x01"]), st.data())
def test_an_overwritten_line_invents_no_range(first, second, kind, noise, data):
    """The firmware begins a new line in the middle of another: each range that is read stands in one of the two."""
    line = WRITERS[kind](first)
    cut = data.draw(st.integers(0, len(line)))
    spliced = line[:cut] + noise + WRITERS[kind](second)
    try:
        parsed = shell.parse_line(spliced)
    except Dwm1001DecodeError:
        return
    assert isinstance(parsed, LocationReport)
    true = {(d.address, d.range_mm) for report in (first, second) for d in report.distances}
    assert {(d.address, d.range_mm) for d in parsed.distances} <= true
    # Cut between two entries, a line of them goes on in another: nothing in it tells.
    between_entries = noise == "" and line[:cut].endswith(" ")
    assert parsed.damaged or cut == 0 or line[:cut].isspace() or between_entries


@ENOUGH
@given(
    st.lists(st.binary(max_size=200) | st.sampled_from([b"DIST,", b"\r\n", b"AN0,1151,5.00,8.00,2.25,6.44", b"dwm> "]))
)
def test_any_octets_are_lines_or_a_typed_error(pieces):
    reader = shell.LineReader()
    for piece in pieces:
        for line in reader.feed(piece):
            assert line.isprintable()
            with_typed_errors(lambda line=line: shell.parse_line(line))
    assert len(reader.pending) <= shell.MAX_LINE_OCTETS
    [*_, last] = ["", *reader.feed(b"\nPOS,2.57,2.00,1.67,97\n")]
    assert last == "POS,2.57,2.00,1.67,97"


def test_a_line_without_end_is_dropped_and_the_next_is_read():
    reader = shell.LineReader()
    assert list(reader.feed(b"x" * 5_000)) == []
    assert list(reader.feed(b"yyy\r\nPOS,1.00,1.00,1.00,50\r\n")) == ["POS,1.00,1.00,1.00,50"]
    assert reader.octets_dropped == 5_003


def test_a_group_twice_is_damage_though_both_agree():
    report = shell.parse_line("DIST,1,AN0,1151,5.00,8.00,2.25,6.44,AN0,1151,5.00,8.00,2.25,6.44")
    assert isinstance(report, LocationReport)
    assert report.damaged
    assert len(report.distances) == 1
