"""The pad's frame against pyproj's own topocentric conversion."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from wonderland.proofs.frame import to_local, to_wgs84
from wonderland_edge_agent.geodesy import GeodesyError, frame_at

LATITUDES_E7 = [-700_000_000, -335_000_000, 0, 1_234_567, 375_665_000, 601_699_000, 800_000_000]


def exact(lat_e7, lon_e7, height_mm, point):
    """East, north, up (mm) of a point (lat_e7, lon_e7, height_mm) by PROJ."""
    cartesian = Transformer.from_pipeline("+proj=cart +ellps=WGS84")
    topocentric = Transformer.from_pipeline(
        f"+proj=topocentric +ellps=WGS84 +lon_0={lon_e7 / 1e7} +lat_0={lat_e7 / 1e7} +h_0={height_mm / 1e3}"
    )
    return tuple(
        value * 1e3
        for value in topocentric.transform(*cartesian.transform(point[1] / 1e7, point[0] / 1e7, point[2] / 1e3))
    )


@pytest.mark.parametrize("lat_e7", LATITUDES_E7)
@pytest.mark.parametrize("height_mm", [0, 1_500_000])
def test_within_a_kilometre_the_error_stays_under_five_millimetres(lat_e7, height_mm):
    lon_e7 = 1_269_976_920
    frame = frame_at(lat_e7, lon_e7, height_mm)
    worst = 0.0
    for bearing in range(0, 360, 30):
        for distance_m in (3, 100, 1_000):
            north, east = distance_m * math.cos(math.radians(bearing)), distance_m * math.sin(math.radians(bearing))
            for up_m in (-50, 0, 200):
                point = (
                    lat_e7 + round(north / 0.01113),
                    lon_e7 + round(east / (0.01113 * math.cos(math.radians(lat_e7 / 1e7)))),
                    height_mm + up_m * 1000,
                )
                ours, theirs = to_local(frame, *point), exact(lat_e7, lon_e7, height_mm, point)
                worst = max(worst, *(abs(a - b) for a, b in zip(ours, theirs, strict=True)))
    assert worst <= 5.0


@settings(max_examples=50, deadline=None)
@given(
    lat_e7=st.integers(-800_000_000, 800_000_000),
    lon_e7=st.integers(-1_800_000_000, 1_800_000_000),
    local=st.tuples(st.integers(-500_000, 500_000), st.integers(-500_000, 500_000), st.integers(-50_000, 200_000)),
)
def test_to_the_globe_and_back_gives_the_same_point(lat_e7, lon_e7, local):
    frame = frame_at(lat_e7, lon_e7, 20_000)
    back = to_local(frame, *to_wgs84(frame, *local))
    # One unit of latitude or longitude is 11 mm at most.
    assert all(abs(a - b) <= 12 for a, b in zip(back, local, strict=True))


@pytest.mark.parametrize(("lat_e7", "height_mm"), [(895_000_000, 0), (-900_000_000, 0), (0, 60_000_000)])
def test_places_without_a_frame_are_refused_in_words(lat_e7, height_mm):
    with pytest.raises(GeodesyError, match=r"pole|stand there"):
        frame_at(lat_e7, 0, height_mm)
