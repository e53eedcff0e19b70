from __future__ import annotations

import mpmath
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.records.pads import Commissioning, Frame
from wonderland_chaincode.contract import ContractError, survey
from wonderland_edge_agent.geodesy import frame_at

COEFFICIENTS = ("e1", "e2", "e3", "n1", "n2", "n3", "n4", "u2", "u3")


def checked(make_scene, frame: Frame) -> str | None:
    commissioning = Commissioning.parse(make_scene().commissioning(frame=frame.to_json()))
    try:
        survey.check(commissioning)
    except ContractError as error:
        return error.code
    return None


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.floats(-1.5707963267948966, 1.5707963267948966))
def test_sine_and_cosine_are_as_good_as_double_precision(angle):
    sine, cosine = survey.sine_cosine(angle)
    assert abs(sine - float(mpmath.sin(angle))) < 1e-15
    assert abs(cosine - float(mpmath.cos(angle))) < 1e-15


@settings(deadline=None, derandomize=True, max_examples=150)
@given(
    st.integers(-890_000_000, 890_000_000), st.integers(-1_800_000_000, 1_800_000_000), st.integers(-400_000, 9_000_000)
)
def test_every_frame_of_the_geodesy_library_passes(make_scene, lat_e7, lon_e7, height_mm):
    assert checked(make_scene, frame_at(lat_e7, lon_e7, height_mm)) is None


@pytest.mark.parametrize("lat_e7", [-889_000_000, -335_000_000, 0, 604_518_000, 880_000_000])
def test_the_check_and_the_library_agree_to_rounding(lat_e7):
    frame = frame_at(lat_e7, 0, 30_000)
    for name, value in survey.expected(lat_e7, 30_000).items():
        assert getattr(frame, name) == pytest.approx(value, rel=1e-9, abs=0.51), name


@pytest.mark.parametrize("name", COEFFICIENTS)
@pytest.mark.parametrize("lat_e7", [0, 604_518_000, -335_000_000])
def test_a_coefficient_that_is_off_is_found(make_scene, make_frame, name, lat_e7):
    value = survey.expected(lat_e7, 30_000)[name]
    near = max(abs(value), 1e6)
    step = near * (20e-6 if name in {"e1", "n1"} else 4.0)
    for wrong in (value + step, value - step):
        assert checked(make_scene, make_frame(lat_e7, **{name: round(wrong)})) == "FRAME_IMPLAUSIBLE"


@pytest.mark.parametrize("shift_e7", [-2_000_000, 2_000_000])
def test_a_frame_of_another_place_is_found(make_scene, make_frame, shift_e7):
    """A fifth of a degree of latitude away; a longitude needs no other coefficients."""
    elsewhere = frame_at(604_518_000 + shift_e7, 222_666_000, 30_000)
    wrong = make_frame(604_518_000, **{name: getattr(elsewhere, name) for name in COEFFICIENTS})
    assert checked(make_scene, wrong) == "FRAME_IMPLAUSIBLE"


@pytest.fixture
def make_frame():
    def make(lat_e7: int, **more: int) -> Frame:
        return Frame.parse(frame_at(lat_e7, 222_666_000, 30_000).to_json() | more)

    return make


@pytest.mark.parametrize("lat_e7", [890_000_001, 900_000_000, -900_000_000])
def test_no_pad_at_a_pole(make_scene, make_frame, lat_e7):
    frame = Frame.parse(make_frame(890_000_000).to_json() | {"lat_e7": lat_e7})
    assert checked(make_scene, frame) == "FRAME_AT_POLE"


def _anchors(scene, *positions):
    template = scene.commissioning()["anchors"][0]
    return [
        template | {"anchor_id": f"B{i}", "mac": i, "east_mm": e, "north_mm": n, "up_mm": u}
        for i, (e, n, u) in enumerate(positions)
    ]


@pytest.mark.parametrize(
    ("positions", "code"),
    [
        ([(0, 0, 0), (5_000, 0, 0), (0, 5_000, 0)], None),
        ([(0, 0, 0), (200_000, 0, 0), (0, 200_000, 0)], None),
        ([(0, 0, 0), (200_001, 0, 0), (0, 5_000, 0)], "ANCHOR_TOO_FAR"),
        ([(0, 0, 200_001), (5_000, 0, 0), (0, 5_000, 0)], "ANCHOR_TOO_FAR"),
        ([(0, 0, 0), (0, 0, 0), (0, 0, 0)], "ANCHORS_ON_A_LINE"),
        ([(0, 0, 0), (0, 0, 1_000), (0, 0, 2_000)], "ANCHORS_ON_A_LINE"),
        ([(-3_000, -3_000, 0), (1_000, 1_000, 900), (3_000, 3_000, 0), (5_000, 5_099, 1)], "ANCHORS_ON_A_LINE"),
        ([(0, 0, 0), (10_000, 0, 0), (5_000, 99, 0)], "ANCHORS_ON_A_LINE"),
        ([(0, 0, 0), (10_000, 0, 0), (5_000, 100, 0)], None),
        ([(7, 7, 7), (7, 7, 7), (5_007, 7, 0), (7, -4_993, 0)], None),
    ],
)
def test_anchors_can_measure_a_position(empty, positions, code):
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    argument = {"pad_id": "pad-1", "commissioning": empty.commissioning(anchors=_anchors(empty, *positions))}
    if code is None:
        assert empty.call(empty.operator, "CommissionPad", argument)["status"] == "commissioned"
    else:
        empty.refuse(400, code, empty.operator, "CommissionPad", argument)


def test_a_roof_with_three_nodes_nearly_in_a_row_passes(empty):
    """The fourth gives the second dimension."""
    positions = [(0, 0, 0), (12_000, 150, 2_500), (25_000, -40, 0), (13_000, 9_000, 2_500)]
    empty.call(empty.operator, "RegisterPad", empty.pad_argument())
    commissioning = empty.commissioning(anchors=_anchors(empty, *positions))
    empty.call(empty.operator, "CommissionPad", pad_id="pad-1", commissioning=commissioning)
