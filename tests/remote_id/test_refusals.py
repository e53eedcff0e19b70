"""Frames that are wrong: each refused with the byte at fault, and garbage with nothing but this package's errors."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wonderland_remote_id import (
    BasicId,
    FieldError,
    FrameLengthError,
    FramingError,
    Location,
    Message,
    MessageTypeError,
    OperatorId,
    Pack,
    PackError,
    ProtocolVersionError,
    RemoteIdError,
    SelfId,
    System,
    decode,
    encode,
)
from wonderland_remote_id.framings.hex_lines import parse_line

LOCATION = encode(Location(lat_e7=601_700_000, lon_e7=249_400_000, track_cdeg=9_000, speed_mm_s=0, vertical_mm_s=0))
BASIC = encode(BasicId(uas_id="1581F5FKD229400A1234"))
SYSTEM = encode(System(operator_lat_e7=601_700_000, operator_lon_e7=249_400_000))
OPERATOR = encode(OperatorId(operator_id="FIN87astrdge12k8"))
PAGE = bytes([0x22, 0x10, 3, 70]) + bytes(21)


def changed(frame: bytes, at: int, value: int | bytes) -> bytes:
    piece = bytes([value]) if isinstance(value, int) else value
    return frame[:at] + piece + frame[at + len(piece) :]


@pytest.mark.parametrize(
    ("frame", "offset", "says"),
    [
        (changed(LOCATION, 5, (910_000_000).to_bytes(4, "little", signed=True)), 5, "91.0"),
        (changed(LOCATION, 5, (-900_000_001).to_bytes(4, "little", signed=True)), 5, "latitude"),
        (changed(LOCATION, 9, (1_800_000_001).to_bytes(4, "little", signed=True)), 9, "longitude"),
        (changed(changed(LOCATION, 1, 0x02), 2, 255), 2, "435"),
        (changed(changed(LOCATION, 1, 0x02), 2, 180), 2, "360"),
        (changed(LOCATION, 1, 0x50), 1, "status"),
        (changed(LOCATION, 4, 0x7F), 4, "63.5"),
        (changed(LOCATION, 4, 0x80), 4, "-64"),
        (changed(LOCATION, 19, 0x0D), 19, "horizontal accuracy"),
        (changed(LOCATION, 19, 0x70), 19, "vertical accuracy"),
        (changed(LOCATION, 20, 0x05), 20, "speed accuracy"),
        (changed(LOCATION, 20, 0x70), 20, "pressure altitude accuracy"),
        (changed(LOCATION, 21, (36_001).to_bytes(2, "little")), 21, "3600.1"),
        (changed(BASIC, 1, 0x50), 1, "id type"),
        (changed(BASIC, 2, 0x07), 2, "0x07"),
        (changed(BASIC, 10, 0x00), 10, "0x00"),
        (changed(BASIC, 1, 0x30), 18, "UUID"),
        (changed(changed(BASIC, 1, 0x40), 2, 0x00), 2, "type 0"),
        (changed(SYSTEM, 1, 0x03), 1, "operator location"),
        (changed(SYSTEM, 1, 0x08), 1, "classification"),
        (changed(SYSTEM, 17, 0x40), 17, "category"),
        (changed(SYSTEM, 17, 0x08), 17, "class"),
        (changed(SYSTEM, 2, (900_000_001).to_bytes(4, "little", signed=True)), 2, "operator latitude"),
        (changed(OPERATOR, 1, 0x01), 1, "operator id type"),
        (changed(encode(SelfId(text="hello")), 1, 3), 1, "description type"),
        (bytes([0x22, 0x60]) + bytes(23), 1, "authentication type"),
        (bytes([0x22, 0x10, 16]) + bytes(22), 2, "last page"),
        (bytes([0x22, 0x10, 0, 18]) + bytes(21), 3, "17"),
    ],
)
def test_a_field_with_a_value_that_cannot_be(frame: bytes, offset: int, says: str) -> None:
    with pytest.raises(FieldError) as caught:
        decode(frame)
    assert caught.value.offset == offset
    assert says in str(caught.value)


@pytest.mark.parametrize("version", range(3, 16))
def test_versions_nobody_has_published(version: int) -> None:
    with pytest.raises(ProtocolVersionError) as caught:
        decode(changed(LOCATION, 0, 0x10 | version))
    assert caught.value.offset == 0


@pytest.mark.parametrize("kind", range(6, 16))
def test_reserved_message_types(kind: int) -> None:
    with pytest.raises(MessageTypeError):
        decode(changed(LOCATION, 0, kind << 4 | 2))


@pytest.mark.parametrize("length", [0, 1, 24, 26, 50, 1000])
def test_frames_that_are_no_message(length: int) -> None:
    with pytest.raises(FrameLengthError):
        decode((LOCATION * 40)[:length])


def test_a_track_beyond_the_east_half_without_its_bit_is_still_a_track() -> None:
    read = decode(changed(LOCATION, 2, 200))
    assert isinstance(read, Location)
    assert read.track_cdeg == 20_000


@pytest.mark.parametrize(
    ("frame", "offset", "index"),
    [
        (bytes([0xF2, 24, 1]) + LOCATION, 1, -1),
        (bytes([0xF2, 25, 0]), 2, -1),
        (bytes([0xF2, 25, 10]) + LOCATION * 10, 2, -1),
        (bytes([0xF2, 25, 2]) + BASIC + changed(LOCATION, 19, 0x0D), 3 + 25 + 19, 1),
        (bytes([0xF2, 25, 2]) + BASIC + bytes([0xF2, 25, 1]) + bytes(22), 3 + 25, 1),
        (bytes([0xF2, 25, 2]) + BASIC + changed(LOCATION, 0, 0x13), 3 + 25, 1),
        (bytes([0xF2, 25, 2]) + LOCATION + LOCATION, 3 + 25, 1),
        (bytes([0xF2, 25, 2]) + BASIC + BASIC, 3 + 25, 1),
    ],
)
def test_packs_that_are_wrong(frame: bytes, offset: int, index: int) -> None:
    with pytest.raises(PackError) as caught:
        decode(frame)
    assert caught.value.offset == offset
    assert caught.value.index == index


def test_a_pack_names_the_cause_inside() -> None:
    with pytest.raises(
        PackError, match=r"byte 47: message 1 of the pack: horizontal accuracy: 13 is reserved"
    ) as caught:
        decode(bytes([0xF2, 25, 2]) + BASIC + changed(LOCATION, 19, 0x0D))
    assert isinstance(caught.value.cause, FieldError)
    assert caught.value.cause.field == "horizontal accuracy"


@pytest.mark.parametrize(
    "frame", [b"\xf2", b"\xf2\x19", bytes([0xF2, 25, 2]) + LOCATION, bytes([0xF2, 25, 1]) + LOCATION + b"\0"]
)
def test_packs_of_another_length(frame: bytes) -> None:
    with pytest.raises(FrameLengthError):
        decode(frame)


def test_a_pack_of_an_unknown_version() -> None:
    with pytest.raises(ProtocolVersionError):
        decode(bytes([0xF3, 25, 1]) + LOCATION)


def test_packs_that_cannot_be_made() -> None:
    for messages in ((), tuple(Location() for _ in range(2)), tuple(BasicId(uas_id="A") for _ in range(10))):
        with pytest.raises(PackError):
            encode(Pack(messages=messages))


def test_what_is_no_message_cannot_be_encoded() -> None:
    with pytest.raises(MessageTypeError):
        encode("hello")  # type: ignore[arg-type]
    with pytest.raises(MessageTypeError):
        encode(Pack(messages=(Pack(messages=(Location(),)),)))  # type: ignore[arg-type]


frames = st.binary(max_size=300) | st.binary(min_size=25, max_size=25)


@st.composite
def nearly_frames(draw: st.DrawFn) -> bytes:
    """Right frames with a few bytes changed, cut short or spliced: these reach the checks behind the first ones."""
    frame = bytearray(
        draw(
            st.sampled_from([LOCATION, BASIC, SYSTEM, OPERATOR, PAGE, bytes([0xF2, 25, 3]) + BASIC + LOCATION + SYSTEM])
        )
    )
    for _ in range(draw(st.integers(0, 4))):
        frame[draw(st.integers(0, len(frame) - 1))] = draw(st.integers(0, 255))
    return bytes(frame[: draw(st.integers(len(frame) - 2, len(frame)))]) + draw(st.binary(max_size=2))


@settings(max_examples=1500, deadline=None)
@example(b"")
@given(frames | nearly_frames())
def test_garbage_gives_a_message_or_this_packages_error(frame: bytes) -> None:
    try:
        read = decode(frame)
    except RemoteIdError as error:
        offset = error.offset
    else:
        # What was taken can be said again, but for a double spelling of a speed or track and for reserved bits.
        assert decode(encode(read)) == read
        return
    assert offset is not None
    assert 0 <= offset <= len(frame)


@settings(max_examples=300, deadline=None)
@given(data=st.data(), at=st.integers(0, 24), bit=st.integers(0, 7))
def test_a_flipped_bit_is_read_or_refused(
    data: st.DataObject, at: int, bit: int, messages: st.SearchStrategy[Message]
) -> None:
    frame = bytearray(encode(data.draw(messages)))
    frame[at] ^= 1 << bit
    with contextlib.suppress(RemoteIdError):
        decode(bytes(frame))


def test_hex_lines() -> None:
    assert parse_line(LOCATION.hex()).frame == LOCATION
    assert parse_line((LOCATION.hex(" ").upper() + "\r\n").encode()).frame == LOCATION
    line = parse_line(f"AA:bb:cc:dd:ee:ff -67 {BASIC.hex()}\n")
    assert (line.frame, line.address, line.rssi_dbm) == (BASIC, "aa:bb:cc:dd:ee:ff", -67)
    assert parse_line(f"aa:bb:cc:dd:ee:ff {BASIC.hex()}").rssi_dbm is None


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("hello", "no frame"),
        ("", "no frame"),
        ("123", "in half"),
        (b"\xff\xfe", "baud rate"),
        ("00" * 229, "at most 228"),
        ("0" * 2000, "2000 characters"),
        (f"aa:bb:cc:dd:ee:ff 300 {BASIC.hex()}", "300 dBm"),
    ],
)
def test_lines_that_are_no_frame(line: str | bytes, says: str) -> None:
    with pytest.raises(FramingError, match=says):
        parse_line(line)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=1100) | st.text(max_size=200))
def test_lines_of_garbage(line: str | bytes) -> None:
    with contextlib.suppress(FramingError):
        parse_line(line)
