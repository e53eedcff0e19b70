"""Messages that hypothesis makes up: each value lies on its field's grid, so that a frame says it exactly."""

from __future__ import annotations

import pytest
from hypothesis import strategies as st

from wonderland_remote_id import (
    Authentication,
    AuthenticationType,
    BasicId,
    CategoryEu,
    ClassEu,
    ClassificationType,
    DescriptionType,
    HeightReference,
    HorizontalAccuracy,
    IdType,
    Location,
    OperationalStatus,
    OperatorId,
    OperatorLocationType,
    Pack,
    ProtocolVersion,
    SelfId,
    SpeedAccuracy,
    System,
    UaType,
    VerticalAccuracy,
)

versions = st.sampled_from(ProtocolVersion)
altitudes = st.none() | st.integers(1, 65535).map(lambda code: code * 500 - 1_000_000)
positions = st.tuples(st.integers(-900_000_000, 900_000_000), st.integers(-1_800_000_000, 1_800_000_000)).filter(
    lambda pair: pair != (0, 0)
) | st.just((None, None))
speeds = (
    st.none() | st.integers(0, 255).map(lambda code: code * 250) | st.integers(1, 254).map(lambda c: 63_750 + c * 750)
)


def texts(size: int) -> st.SearchStrategy[str]:
    return st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=size)


@st.composite
def locations(draw: st.DrawFn) -> Location:
    lat_e7, lon_e7 = draw(positions)
    return Location(
        lat_e7=lat_e7,
        lon_e7=lon_e7,
        status=draw(st.sampled_from(OperationalStatus)),
        track_cdeg=draw(st.none() | st.integers(0, 359).map(lambda degrees: degrees * 100)),
        speed_mm_s=draw(speeds),
        vertical_mm_s=draw(st.none() | st.integers(-124, 124).map(lambda code: code * 500)),
        pressure_altitude_mm=draw(altitudes),
        altitude_mm=draw(altitudes),
        height_mm=draw(altitudes),
        height_reference=draw(st.sampled_from(HeightReference)),
        horizontal_accuracy=draw(st.sampled_from(HorizontalAccuracy)),
        vertical_accuracy=draw(st.sampled_from(VerticalAccuracy)),
        pressure_altitude_accuracy=draw(st.sampled_from(VerticalAccuracy)),
        speed_accuracy=draw(st.sampled_from(SpeedAccuracy)),
        after_hour_ms=draw(st.none() | st.integers(0, 36_000).map(lambda tenths: tenths * 100)),
        time_accuracy_ms=draw(st.none() | st.integers(1, 15).map(lambda tenths: tenths * 100)),
        version=draw(versions),
    )


@st.composite
def basic_ids(draw: st.DrawFn) -> BasicId:
    id_type = draw(st.sampled_from(IdType))
    if id_type is IdType.UTM_UUID:
        uas_id = str(draw(st.uuids()))
    elif id_type is IdType.SPECIFIC_SESSION:
        uas_id = (bytes([draw(st.integers(1, 255))]) + draw(st.binary(min_size=19, max_size=19))).hex()
    else:
        uas_id = draw(texts(20))
    return BasicId(uas_id=uas_id, id_type=id_type, ua_type=draw(st.sampled_from(UaType)), version=draw(versions))


@st.composite
def systems(draw: st.DrawFn) -> System:
    lat_e7, lon_e7 = draw(positions)
    return System(
        operator_lat_e7=lat_e7,
        operator_lon_e7=lon_e7,
        operator_location=draw(st.sampled_from(OperatorLocationType)),
        area_count=draw(st.integers(0, 65535)),
        area_radius_mm=draw(st.integers(0, 255)) * 10_000,
        area_ceiling_mm=draw(altitudes),
        area_floor_mm=draw(altitudes),
        classification=draw(st.sampled_from(ClassificationType)),
        category=draw(st.sampled_from(CategoryEu)),
        uas_class=draw(st.sampled_from(ClassEu)),
        operator_altitude_mm=draw(altitudes),
        t_ms=draw(st.none() | st.integers(1, 2**32 - 1).map(lambda seconds: 1_546_300_800_000 + seconds * 1000)),
        version=draw(versions),
    )


@st.composite
def pages(draw: st.DrawFn) -> Authentication:
    kind, page, version = draw(st.sampled_from(AuthenticationType)), draw(st.integers(0, 15)), draw(versions)
    if page:
        data = draw(st.binary(min_size=23, max_size=23))
        return Authentication(authentication_type=kind, page=page, data=data, version=version)
    last_page = draw(st.integers(0, 15))
    return Authentication(
        authentication_type=kind,
        page=0,
        data=draw(st.binary(min_size=17, max_size=17)),
        last_page=last_page,
        length=draw(st.integers(0, min(255, 17 + 23 * last_page))),
        t_ms=1_546_300_800_000 + draw(st.integers(1, 2**32 - 1)) * 1000,
        version=version,
    )


private = st.integers(201, 255)
self_ids = st.builds(
    SelfId, text=texts(23), description_type=st.sampled_from(DescriptionType) | private, version=versions
)
operator_ids = st.builds(OperatorId, operator_id=texts(20), operator_id_type=st.just(0) | private, version=versions)
every = locations() | basic_ids() | systems() | pages() | self_ids | operator_ids


def _part(message: object) -> object:
    return type(message), getattr(message, "id_type", None), getattr(message, "page", None)


packs = st.builds(Pack, messages=st.lists(every, min_size=1, max_size=9, unique_by=_part).map(tuple), version=versions)


@pytest.fixture(scope="session")
def messages() -> st.SearchStrategy[object]:
    return every


@pytest.fixture(scope="session")
def messages_and_packs() -> st.SearchStrategy[object]:
    return every | packs
