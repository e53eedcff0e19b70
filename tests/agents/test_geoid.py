"""Mean sea level above the ellipsoid, from NGA's grid."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.geoids import write_geoid

from wonderland.geoid import COLUMNS, ROWS, Geoid, GeoidError


@pytest.fixture(scope="module")
def geoid(tmp_path_factory):
    return Geoid(write_geoid(tmp_path_factory.mktemp("geoid") / "WW15MGH.DAC"))


def test_between_its_points(geoid):
    assert geoid.undulation_mm(600_000_000, 222_500_000) == 60_000
    assert geoid.undulation_mm(601_250_000, 222_600_000) == 60_125
    assert geoid.undulation_mm(600_000_000, 0) == 63_000
    assert geoid.undulation_mm(600_000_000, -1_250_000) == 61_500
    assert geoid.undulation_mm(600_000_000, 1_250_000) == 61_500
    assert geoid.undulation_mm(-900_000_000, 1_800_000_000) == -90_000
    assert geoid.undulation_mm(900_000_000, -1_800_000_000) == 90_000


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1))
def test_there_is_one_for_whatever_an_autopilot_says(geoid, lat_e7, lon_e7):
    assert -93_000 <= geoid.undulation_mm(lat_e7, lon_e7) <= 93_000


@pytest.mark.parametrize("content", [b"", b"x", b"\x7f\xff" * (ROWS * COLUMNS)])
def test_files_that_are_none(tmp_path, content):
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(GeoidError, match="file"):
        Geoid(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(GeoidError, match="No such file"):
        Geoid(tmp_path / "none")
