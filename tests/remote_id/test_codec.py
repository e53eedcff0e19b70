"""Frames that are right: against the reference implementation's bytes, there and back, and how times are resolved."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_remote_id import (
    BasicId,
    CategoryEu,
    ClassEu,
    ClassificationType,
    FieldError,
    HeightReference,
    HorizontalAccuracy,
    IdType,
    Location,
    Message,
    OperationalStatus,
    OperatorId,
    OperatorLocationType,
    Pack,
    SpeedAccuracy,
    System,
    UaType,
    VerticalAccuracy,
    decode,
    encode,
    public_operator_id,
    resolve_time,
)

# Frames that opendroneid-core-c (the reference implementation) encodes for these values.
REFERENCE = [
    (
        "12262316fda136dd23c28add0e9b08c0080d084b3339300200",
        Location(
            lat_e7=601_700_001,
            lon_e7=249_400_002,
            status=OperationalStatus.AIRBORNE,
            track_cdeg=21_500,
            speed_mm_s=5_500,
            vertical_mm_s=-1_500,
            pressure_altitude_mm=101_500,
            altitude_mm=120_000,
            height_mm=30_500,
            height_reference=HeightReference.GROUND,
            horizontal_accuracy=HorizontalAccuracy.M_3,
            vertical_accuracy=VerticalAccuracy.M_10,
            pressure_altitude_accuracy=VerticalAccuracy.M_25,
            speed_accuracy=SpeedAccuracy.M_S_1,
            after_hour_ms=1_234_500,
            time_accuracy_ms=200,
        ),
    ),
    (
        "1231003118404e08ec60b320d600001c0c00006c04a08c0f00",
        Location(
            lat_e7=-335_000_000,
            lon_e7=-702_500_000,
            status=OperationalStatus.EMERGENCY,
            track_cdeg=0,
            speed_mm_s=100_500,
            vertical_mm_s=12_000,
            altitude_mm=550_000,
            horizontal_accuracy=HorizontalAccuracy.M_1,
            vertical_accuracy=VerticalAccuracy.M_1,
            speed_accuracy=SpeedAccuracy.M_S_0_3,
            after_hour_ms=3_600_000,
            time_accuracy_ms=1_500,
        ),
    ),
    ("1203b5ff7e00000000000000000000000000000000ffff0000", Location()),
    (
        "4205a036dd23c08add0e030019fc08a707252208c0a3d00c00",
        System(
            operator_lat_e7=601_700_000,
            operator_lon_e7=249_400_000,
            operator_location=OperatorLocationType.LIVE_GNSS,
            area_count=3,
            area_radius_mm=250_000,
            area_ceiling_mm=150_000,
            area_floor_mm=-20_500,
            classification=ClassificationType.EU,
            category=CategoryEu.SPECIFIC,
            uas_class=ClassEu.C4,
            operator_altitude_mm=41_000,
            t_ms=1_761_300_800_000,
        ),
    ),
    (
        "0212313538314635464b443232393430304131323334000000",
        BasicId(uas_id="1581F5FKD229400A1234", ua_type=UaType.HELICOPTER_OR_MULTIROTOR),
    ),
    (
        "022146494e2d4f502d37370000000000000000000000000000",
        BasicId(uas_id="FIN-OP-77", id_type=IdType.CAA_REGISTRATION, ua_type=UaType.AEROPLANE),
    ),
    ("520046494e38376173747264676531326b382d78797a000000", OperatorId(operator_id="FIN87astrdge12k8-xyz")),
]


@pytest.mark.parametrize(("frame", "message"), REFERENCE)
def test_the_reference_implementations_frames(frame: str, message: Message) -> None:
    assert decode(bytes.fromhex(frame)) == message
    assert encode(message).hex() == frame


def test_a_pack_of_the_references_frames() -> None:
    chosen = [REFERENCE[index] for index in (0, 3, 4, 5, 6)]
    frame = "f21905" + "".join(frame for frame, _ in chosen)
    pack = decode(bytes.fromhex(frame))
    assert isinstance(pack, Pack)
    assert pack.messages == tuple(message for _, message in chosen)
    assert encode(pack).hex() == frame


@settings(max_examples=400, deadline=None)
@given(data=st.data())
def test_there_and_back(data: st.DataObject, messages_and_packs: st.SearchStrategy[Message | Pack]) -> None:
    message = data.draw(messages_and_packs)
    frame = encode(message)
    assert len(frame) == (3 + 25 * len(message.messages) if isinstance(message, Pack) else 25)
    read = decode(frame)
    # A text's zero bytes are its end, and a text of blanks is a text: both come back as they went.
    assert read == message
    assert encode(read) == frame


@settings(max_examples=200, deadline=None)
@given(
    track=st.integers(0, 35_999),
    speed=st.integers(0, 400_000),
    vertical=st.integers(-80_000, 80_000),
    altitude=st.integers(-999_500, 31_767_500),
    after_hour=st.integers(0, 3_600_000),
)
def test_rounding_is_to_the_nearest_step(track: int, speed: int, vertical: int, altitude: int, after_hour: int) -> None:
    read = decode(
        encode(
            Location(
                lat_e7=1,
                lon_e7=1,
                track_cdeg=track,
                speed_mm_s=speed,
                vertical_mm_s=vertical,
                altitude_mm=altitude,
                after_hour_ms=after_hour,
            )
        )
    )
    assert isinstance(read, Location)
    assert read.track_cdeg is not None
    assert min(abs(read.track_cdeg - track), 36_000 - abs(read.track_cdeg - track)) <= 50
    assert read.speed_mm_s is not None
    assert abs(read.speed_mm_s - min(speed, 254_250)) <= (125 if speed <= 63_750 else 375)
    assert read.vertical_mm_s is not None
    assert abs(read.vertical_mm_s - max(-62_000, min(62_000, vertical))) <= 250
    assert read.altitude_mm is not None
    assert abs(read.altitude_mm - altitude) <= 250
    assert read.after_hour_ms is not None
    assert abs(read.after_hour_ms - after_hour) <= 50


def test_null_island_is_not_unknown() -> None:
    read = decode(encode(Location(lat_e7=0, lon_e7=0)))
    assert isinstance(read, Location)
    assert (read.lat_e7, read.lon_e7) == (0, 1)


def test_older_protocols_have_no_time_in_their_system_message() -> None:
    frame = bytearray(encode(System(t_ms=1_761_300_800_000)))
    frame[0] = 0x41
    frame[20:24] = bytes(4)
    read = decode(bytes(frame))
    assert isinstance(read, System)
    assert read.t_ms is None
    assert read.version == 1


@pytest.mark.parametrize(
    ("accuracy", "expected_mm"), [(1, 18_520_000), (2, 7_408_000), (8, 92_600), (12, 1_000), (0, None)]
)
def test_horizontal_accuracy(accuracy: int, expected_mm: int | None) -> None:
    assert HorizontalAccuracy(accuracy).mm == expected_mm


@given(st.integers(1, 40_000_000))
def test_an_accuracy_class_is_the_narrowest_that_holds(accuracy_mm: int) -> None:
    found = HorizontalAccuracy.of_mm(accuracy_mm)
    if found is HorizontalAccuracy.UNKNOWN:
        assert accuracy_mm > 18_520_000
        return
    assert found.mm is not None
    assert accuracy_mm <= found.mm
    if found < HorizontalAccuracy.M_1:
        narrower = HorizontalAccuracy(found + 1).mm
        assert narrower is not None
        assert accuracy_mm > narrower


def test_accuracy_classes_survive_the_way_through_units() -> None:
    for horizontal in HorizontalAccuracy:
        assert HorizontalAccuracy.of_mm(horizontal.mm) is horizontal
    for vertical in VerticalAccuracy:
        assert VerticalAccuracy.of_mm(vertical.mm) is vertical
    for speed in SpeedAccuracy:
        assert SpeedAccuracy.of_mm_s(speed.mm_s) is speed


HOUR = 3_600_000
NOON = 1_760_000_400_000 // HOUR * HOUR


@pytest.mark.parametrize(
    ("after_hour_ms", "received_ms", "expected_ms"),
    [
        (1_000, NOON + 1_300, NOON + 1_000),
        (3_599_900, NOON + 200, NOON - 100),  # taken before the full hour, heard after it
        (100, NOON - 200, NOON + 100),  # the drone's clock is ahead of the pad's
        (3_600_000, NOON + 50, NOON),
        (None, NOON, None),
    ],
)
def test_resolve_time(after_hour_ms: int | None, received_ms: int, expected_ms: int | None) -> None:
    assert resolve_time(Location(after_hour_ms=after_hour_ms), received_ms) == expected_ms


@given(
    t_ms=st.integers(NOON, NOON + 3 * HOUR).map(lambda t: t // 100 * 100),
    delay_ms=st.integers(-HOUR // 2 + 1, HOUR // 2 - 1),
)
def test_resolve_time_finds_every_time_within_half_an_hour(t_ms: int, delay_ms: int) -> None:
    assert resolve_time(Location(after_hour_ms=t_ms % HOUR), t_ms + delay_ms) == t_ms


@pytest.mark.parametrize(
    ("broadcast", "public"),
    [
        ("FIN87astrdge12k8", "FIN87astrdge12k8"),
        ("FIN87astrdge12k8-xyz", "FIN87astrdge12k8"),
        ("FIN87astrdge12k8xyz", "FIN87astrdge12k8"),
        ("FIN87astrdge12k8-x", "FIN87astrdge12k8"),
        ("FIN87astrdge12k8-", "FIN87astrdge12k8"),
        ("OP-123", "OP"),
        ("FA3ABCDEFG", "FA3ABCDEFG"),
        ("FIN-OP-4711", "FIN-OP-4711"),
        ("", ""),
    ],
)
def test_the_operators_secret_goes_no_further(broadcast: str, public: str) -> None:
    assert public_operator_id(broadcast) == public


def test_an_operator_id_is_not_printed() -> None:
    assert "xyz" not in repr(OperatorId(operator_id="FIN87astrdge12k8-xyz"))


def test_messages_are_values() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Location().lat_e7 = 5  # type: ignore[misc]


@pytest.mark.parametrize(
    "message",
    [
        Location(lat_e7=900_000_001, lon_e7=0),
        Location(lat_e7=5),
        Location(track_cdeg=36_000),
        Location(speed_mm_s=-1),
        Location(altitude_mm=31_768_000),
        Location(altitude_mm=-1_000_000),
        Location(after_hour_ms=3_600_001),
        Location(time_accuracy_ms=1_501),
        Location(status=7),  # type: ignore[arg-type]
        BasicId(uas_id="X" * 21),
        BasicId(uas_id="Ä1"),
        BasicId(uas_id="no uuid", id_type=IdType.UTM_UUID),
        BasicId(uas_id="00" * 20, id_type=IdType.SPECIFIC_SESSION),
        BasicId(uas_id="zz", id_type=IdType.SPECIFIC_SESSION),
        OperatorId(operator_id="A", operator_id_type=5),
        System(area_count=65_536),
        System(area_radius_mm=2_560_000),
        System(t_ms=1_546_300_799_000),
    ],
)
def test_what_a_field_cannot_hold_is_refused(message: Message) -> None:
    with pytest.raises(FieldError):
        encode(message)
