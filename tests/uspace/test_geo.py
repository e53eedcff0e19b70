"""Views, boxes and the grid: at the antimeridian, at the poles, anywhere."""

from __future__ import annotations

import math

from hypothesis import example, given
from hypothesis import strategies as st

from wonderland_backend.uspace.geo import E7, FINEST_E7, TILES, TURN, Box, Cell, cells_of, distance_m

LAT = st.integers(-90 * E7, 90 * E7)
LNG = st.integers(-180 * E7, 180 * E7)
SMALL = st.integers(0, 600_000)
LEVEL = st.integers(0, TILES)


@st.composite
def small_boxes(draw):
    south = draw(LAT)
    north = min(90 * E7, south + draw(SMALL))
    return Box(south, draw(st.integers(-180 * E7, 180 * E7 - 1)), north, draw(SMALL))


def test_a_view_over_the_antimeridian():
    box = Box.between(0, 179.99, 0.01, -179.99)
    assert (box.west, box.width) == (1_799_900_000, 200_000)
    assert box.contains(50_000, 1_800_000_000)
    assert box.contains(50_000, -1_800_000_000)
    assert box.contains(50_000, -1_799_950_000)
    assert not box.contains(50_000, 0)
    assert box.east == -1_799_900_000
    assert math.isclose(box.diagonal_m(), math.hypot(2_226.4, 1_113.2), rel_tol=1e-3)


def test_a_view_at_the_pole_is_as_wide_as_it_is():
    """Its diagonal from corner to corner ends in the pole; it reaches farther the other way."""
    assert math.isclose(Box.between(89.95, 0, 90, 180).diagonal_m(), 2 * 5_566, rel_tol=1e-3)


@example(0, 1_799_999_926, 0, -77)  # half a turn but for the rounding: outwards on the other way round as well
@given(LAT, LNG, LAT, LNG)
def test_a_box_has_its_corners(lat_1, lng_1, lat_2, lng_2):
    box = Box.between(lat_1 / E7, lng_1 / E7, lat_2 / E7, lng_2 / E7)
    assert box.contains(lat_1, lng_1)
    assert box.contains(lat_2, lng_2)
    assert 0 <= box.width <= TURN // 2 + 2
    assert -180 * E7 <= box.west < 180 * E7
    assert box == Box.between(lat_2 / E7, lng_2 / E7, lat_1 / E7, lng_1 / E7) or box.width >= TURN // 2


@given(small_boxes())
def test_a_view_as_text_is_the_same_view(box):
    assert Box.between(*map(float, box.view().split(","))).meets(box)
    south, west, north, east = (round(float(each) * E7) for each in box.view().split(","))
    assert (south, north, east) == (box.south, box.north, box.east)
    assert west == box.west


@given(LAT, LNG, LEVEL)
def test_a_position_lies_in_its_cell_and_that_in_the_coarser_one(lat, lng, level):
    cell = Cell.at(lat, lng, level)
    assert cell.box().contains(lat, lng)
    coarser = Cell.at(lat, lng, min(level + 1, TILES)).box()
    assert coarser.south <= cell.box().south
    assert cell.box().north <= coarser.north
    assert coarser.area_m2() >= cell.box().area_m2() * 0.999


@given(LAT, LNG)
def test_the_finest_cell_hides_within_300_metres_all_round(lat, lng):
    box = Cell.at(lat, lng, 0).box()
    assert distance_m(box.south, 0, box.north, 0) >= 600
    if box.width < TURN:
        assert min(distance_m(edge, 0, edge, box.width) for edge in (box.south, box.north)) >= 600


@given(small_boxes(), LEVEL, st.integers(0, 100), st.integers(0, 100))
def test_the_cells_of_a_box_cover_it(box, level, up, along):
    lat = box.south + (box.north - box.south) * up // 100
    lng = (box.west + box.width * along // 100 + TURN // 2) % TURN - TURN // 2
    cells = list(cells_of(box, level))
    assert Cell.at(lat, lng, level) in cells
    assert len(cells) == len(set(cells))
    assert all(cell.box().meets(box) for cell in cells)


@given(small_boxes(), small_boxes())
def test_meeting_is_mutual(one, other):
    assert one.meets(other) == other.meets(one)
    assert one.meets(one)


def test_a_cap_goes_all_the_way_round():
    cell = Cell.at(90 * E7, 0, TILES)
    assert cell.is_cap
    assert cell.box().north == 90 * E7
    assert cell.box().width == TURN
    assert not Cell.at(604_500_000, 222_600_000, TILES).is_cap
    assert 180 * E7 % (FINEST_E7 << TILES) == 0
