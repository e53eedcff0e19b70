from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.errors import GeometryError
from wonderland.proofs.frame import to_local, to_wgs84
from wonderland_edge_agent.geodesy import frame_at

pyproj = pytest.importorskip("pyproj")

PLACES = [
    (604_518_000, 222_666_000),
    (0, 0),
    (-338_600_000, 1_512_000_000),
    (780_000_000, 150_000_000),
    (-10_000_000, -1_799_995_000),
]
FRAMES = {place: frame_at(*place, 30_000) for place in PLACES}


def exact(frame, lat_e7, lon_e7, height_mm):
    """East, north, up by pyproj's own topocentric transformation."""
    pipeline = (
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={frame.lat_e7 / 1e7} +lon_0={frame.lon_e7 / 1e7} +h_0={frame.height_mm / 1e3}"
    )
    east, north, up = pyproj.Transformer.from_pipeline(pipeline).transform(lon_e7 / 1e7, lat_e7 / 1e7, height_mm / 1e3)
    return east * 1e3, north * 1e3, up * 1e3


@pytest.mark.parametrize("place", PLACES)
@given(st.integers(-700_000, 700_000), st.integers(-700_000, 700_000), st.integers(-100_000, 200_000))
@settings(deadline=None, max_examples=60)
def test_within_a_kilometre_the_frame_agrees_with_pyproj(place, east, north, up):
    frame = FRAMES[place]
    lat, lon, height = to_wgs84(frame, east, north, up)
    expected = exact(frame, lat, lon, height)
    got = to_local(frame, lat, lon, height)
    assert max(abs(a - b) for a, b in zip(expected, got, strict=True)) < 6
    # one unit of longitude or latitude is 11 mm
    assert max(abs(a - b) for a, b in zip((east, north, up), got, strict=True)) < 12


def test_far_away_is_said():
    frame = FRAMES[PLACES[0]]
    with pytest.raises(GeometryError, match="too far"):
        to_local(frame, frame.lat_e7 + 3_000_000, frame.lon_e7, 0)
    with pytest.raises(GeometryError, match="too far"):
        to_wgs84(frame, 10**9, 0, 0)
