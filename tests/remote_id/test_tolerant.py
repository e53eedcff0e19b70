"""Frames that break the standard, read as far as they can be: each fault named, the rest kept, nothing guessed."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_remote_id import (
    BasicId,
    IdType,
    Location,
    OperatorId,
    Pack,
    RemoteIdError,
    SelfId,
    System,
    decode,
    decode_tolerant,
    encode,
)

PLACE = Location(lat_e7=601_700_000, lon_e7=249_400_000, track_cdeg=9_000, speed_mm_s=2_500, vertical_mm_s=0)
SERIAL = BasicId(uas_id="1581F5FKD229400A1234")


def changed(frame: bytes, *changes: tuple[int, bytes]) -> bytes:
    out = bytearray(frame)
    for at, piece in changes:
        out[at : at + len(piece)] = piece
    return bytes(out)


@pytest.mark.parametrize(
    ("changes", "field", "lost"),
    [
        ([(5, (910_000_000).to_bytes(4, "little"))], "latitude", {"lat_e7": None, "lon_e7": None}),
        ([(9, (1_900_000_000).to_bytes(4, "little"))], "longitude", {"lat_e7": None, "lon_e7": None}),
        ([(1, b"\x02"), (2, b"\xff")], "track", {"track_cdeg": None}),
        ([(4, b"\x7f")], "vertical speed", {"vertical_mm_s": None}),
        ([(21, b"\xb0\xff")], "time", {"after_hour_ms": None}),
        ([(1, b"\x70")], "status", {}),
        ([(19, b"\x0f")], "horizontal accuracy", {}),
        ([(19, b"\xf0")], "vertical accuracy", {}),
        ([(20, b"\x0f")], "speed accuracy", {}),
        ([(20, b"\xf0")], "pressure altitude accuracy", {}),
    ],
)
def test_a_bad_field_becomes_unknown(changes, field, lost) -> None:
    frame = changed(encode(PLACE), *changes)
    with pytest.raises(RemoteIdError):
        decode(frame)
    read = decode_tolerant(frame)
    assert [problem.field for problem in read.problems] == [field]
    [message] = read.messages
    assert isinstance(message, Location)
    kept = {"lat_e7": PLACE.lat_e7, "lon_e7": PLACE.lon_e7, "track_cdeg": 9_000, "speed_mm_s": 2_500}
    for name, value in (kept | {"vertical_mm_s": 0} | lost).items():
        assert getattr(message, name) == value


def test_several_faults_are_all_named() -> None:
    frame = changed(encode(PLACE), (0, b"\x17"), (1, b"\x72"), (2, b"\xff"), (19, b"\xff"))
    read = decode_tolerant(frame)
    assert [problem.kind for problem in read.problems] == ["ProtocolVersionError", *["FieldError"] * 4]
    assert read.problems[1].offset == 1
    assert read.messages[0].lat_e7 == PLACE.lat_e7


def test_a_pack_keeps_its_good_messages() -> None:
    pack = encode(Pack(messages=(SERIAL, PLACE, OperatorId(operator_id="FIN87astrdge12k8"))))
    bad = changed(pack, (3 + 25 + 5, (910_000_000).to_bytes(4, "little")), (3 + 50, b"\xf2"))
    read = decode_tolerant(bad)
    assert read.is_pack
    assert [type(message) for message in read.messages] == [BasicId, Location]
    assert [(problem.kind, problem.index) for problem in read.problems] == [("FieldError", 1), ("MessageTypeError", 2)]
    assert read.problems[0].offset == 3 + 25 + 5


@pytest.mark.parametrize(
    ("frame", "messages"),
    [
        (b"", 0),
        (b"\x12" * 24, 0),
        (encode(PLACE) + b"\0\0", 1),
        (b"\xf2", 0),
        (b"\xf2\x18\x01" + bytes(25), 0),
        (b"\xf2\x19\x00", 0),
        (b"\xf2\x19\x02" + encode(SERIAL), 1),
        (b"\xf2\x19\x01" + encode(SERIAL) + encode(PLACE), 1),
        (b"\xf2\x19\x0b" + 11 * encode(SERIAL), 9),
        (b"\xf2\x19\x02" + 2 * encode(SERIAL), 2),
        (b"\x92" + bytes(24), 0),
    ],
)
def test_lengths_and_types(frame, messages) -> None:
    read = decode_tolerant(frame)
    assert len(read.messages) == messages
    assert read.problems


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (changed(encode(SelfId(text="hello")), (3, b"\x07")), "h?llo"),
        (changed(encode(SelfId(text="hello")), (1, b"\x09")), "hello"),
        (changed(encode(SERIAL), (1, b"\x70")), "1581F5FKD229400A1234"),
        (changed(encode(SERIAL), (1, b"\x40"), (2, b"\0")), ""),
    ],
)
def test_texts(frame, text) -> None:
    [message] = decode_tolerant(frame).messages
    assert (message.text if isinstance(message, SelfId) else message.uas_id) == text
    if isinstance(message, BasicId):
        assert message.id_type is IdType.NONE


def test_system_and_authentication() -> None:
    frame = changed(encode(System(operator_lat_e7=1, operator_lon_e7=2)), (1, b"\x0b"), (17, b"\x4f"))
    read = decode_tolerant(frame)
    assert [problem.field for problem in read.problems] == [
        "operator location",
        "classification",
        "EU category",
        "EU class",
    ]
    assert read.messages[0].operator_lon_e7 == 2
    read = decode_tolerant(bytes((0x22, 0x60, 0x40, 0xFF)) + bytes(21))
    assert [problem.field for problem in read.problems] == ["authentication type", "last page"]
    assert read.messages[0].length == 255


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=240))
def test_never_raises_and_agrees_with_the_strict_decoder(frame) -> None:
    read = decode_tolerant(frame)
    try:
        decoded = decode(frame)
    except RemoteIdError:
        assert read.problems
    else:
        assert not read.problems
        assert read.messages == (decoded.messages if isinstance(decoded, Pack) else (decoded,))
    for message in read.messages:
        if not (isinstance(message, BasicId) and message.id_type is IdType.UTM_UUID):
            assert decode(encode(message)) is not None


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_one_flipped_byte(messages_and_packs, data) -> None:
    frame = bytearray(encode(data.draw(messages_and_packs)))
    frame[data.draw(st.integers(0, len(frame) - 1))] ^= data.draw(st.integers(1, 255))
    read = decode_tolerant(bytes(frame))
    assert read.messages or read.problems
