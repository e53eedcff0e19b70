"""One offset for all of a drone's ranges: found, known as well as it says, and refused where there is none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from wonderland.proofs.records.pads import Anchor, BiasPoint, Commissioning, Frame
from wonderland.proofs.records.sessions import AnchorRanges, RangeTable
from wonderland_edge_agent.commissioning.drone_offset import Ranged, find_offset
from wonderland_edge_agent.commissioning.errors import CalibrationError

FRAME = Frame(lat_e7=0, lon_e7=0, height_mm=0, e1=1 << 32, e2=0, e3=0, n1=1 << 32, n2=0, n3=0, n4=0, u2=0, u3=0)
ANCHORS = ((2_000, 2_000, 1_600), (-2_000, 2_000, 250), (-2_000, -2_000, 250), (2_000, -2_000, 250))
FIVE = (*ANCHORS, (0, 2_800, 250))
BETWEEN = (300.0, -200.0, 150.0)
OUTSIDE = (9_000.0, 3_000.0, 150.0)
BIAS_MM, NOISE_MM, REFERENCE_MM = 20, 30, 10.0


def commissioned(anchors=ANCHORS):
    return Commissioning(
        frame=FRAME,
        anchors=tuple(
            Anchor(
                anchor_id=f"A{number}",
                mac=number,
                east_mm=east,
                north_mm=north,
                up_mm=up,
                survey_sigma_mm=3,
                bias=(BiasPoint(range_mm=0, bias_mm=40 * number, sigma_mm=BIAS_MM),),
            )
            for number, (east, north, up) in enumerate(anchors, 1)
        ),
        range_sigma_mm=NOISE_MM,
        installation_sigma_mm=8,
        max_range_mm=50_000,
        valid_from_ms=0,
        valid_until_ms=1,
        method="test",
    )


def ranged(rng, commissioning, offset_mm, place=BETWEEN, *, stated=None, rounds=40, own=None, walk_mm=0.0):
    own = rng.normal(0, BIAS_MM, len(commissioning.anchors)) if own is None else own
    steps = np.linspace(0.0, walk_mm, rounds)
    columns = []
    for error, anchor in zip(own, commissioning.anchors, strict=True):
        at = (anchor.east_mm, anchor.north_mm, anchor.up_mm)
        away = [math.dist(at, (place[0] + step, place[1], place[2])) for step in steps]
        noise = rng.normal(0, NOISE_MM, rounds)
        values = tuple(
            round(x + anchor.bias[0].bias_mm + offset_mm + error + n) for x, n in zip(away, noise, strict=True)
        )
        columns.append(AnchorRanges(anchor_id=anchor.anchor_id, range_mm=values))
    table = RangeTable(t_ms=tuple(range(0, 50 * rounds, 50)), anchors=tuple(columns))
    at = tuple(place if stated is None else stated)
    return Ranged(f"{rng.integers(1 << 30):064x}", table, lambda _: at)


def find(sessions, commissioning):
    return find_offset(sessions, commissioning, reference_mm=REFERENCE_MM)


def test_its_error_is_what_it_says():
    rng = np.random.default_rng(3)
    pad = commissioned()
    off = []
    for _ in range(200):
        own = rng.normal(0, BIAS_MM, 4)
        places = [np.array(place) for place in (BETWEEN, (-900.0, 700.0, 150.0))]
        sessions = [
            ranged(rng, pad, 310.0, tuple(place + rng.normal(0, REFERENCE_MM, 3)), stated=tuple(place), own=own)
            for place in places
        ]
        try:
            found = find(sessions, pad)
        except CalibrationError:
            continue
        off.append((found.offset_mm - 310.0) / found.sigma_mm)
    assert len(off) > 190  # one in a thousand is refused by chance
    assert abs(float(np.mean(off))) < 0.2
    assert 0.4 < float(np.std(off)) < 0.95  # another day's temperature is not in this simulation
    assert found.rounds == 80
    assert 15 <= found.sigma_mm <= 25
    assert not found.rests_on_place
    assert found.by_anchor.keys() == {"A1", "A2", "A3", "A4"}


def test_more_rounds_do_not_make_it_surer_than_the_pad_is_known():
    rng = np.random.default_rng(4)
    pad = commissioned()
    own = rng.normal(0, BIAS_MM, 4)
    few = find([ranged(rng, pad, -200.0, own=own)], pad)
    many = find([ranged(rng, pad, -200.0, own=own, rounds=400) for _ in range(8)], pad)
    assert few.sigma_mm - 5 < many.sigma_mm
    assert many.sigma_mm > math.hypot(BIAS_MM / 2, 15)
    assert abs(many.offset_mm + 200.0) < 4 * many.sigma_mm


def test_outside_of_the_anchors_it_rests_on_the_place_that_is_stated():
    rng = np.random.default_rng(5)
    pad = commissioned()
    found = find([ranged(rng, pad, 250.0, OUTSIDE)], pad)
    assert found.rests_on_place
    assert abs(found.offset_mm - 250.0) < 4 * found.sigma_mm


def test_a_wrong_place_is_told_from_an_offset_between_the_anchors():
    rng = np.random.default_rng(6)
    pad = commissioned()
    stated = (BETWEEN[0] + 400.0, BETWEEN[1], BETWEEN[2])
    with pytest.raises(CalibrationError, match="another place does: measure again"):
        find([ranged(rng, pad, 300.0, stated=stated)], pad)


def test_an_anchor_that_says_otherwise_is_named():
    rng = np.random.default_rng(7)
    pad = commissioned(FIVE)
    own = np.array((0.0, 0.0, 350.0, 0.0, 0.0))
    with pytest.raises(CalibrationError, match="without anchor A3 they agree"):
        find([ranged(rng, pad, 300.0, own=own)], pad)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"rounds": 29}, "29 rounds in 1 sessions; 30 are needed"),
        ({"offset_mm": 640.0}, r"\+6\d\d mm longer .* no antenna delay is beyond 500 mm"),
        ({"walk_mm": 2_000.0}, "the drone moved"),
        ({"place": ANCHORS[0]}, "cannot be where anchor A1 is"),
    ],
)
def test_what_teaches_nothing_is_refused_with_its_reason(more, said):
    rng = np.random.default_rng(8)
    pad = commissioned()
    with pytest.raises(CalibrationError, match=said):
        find([ranged(rng, pad, **({"offset_mm": 300.0} | more))], pad)


def test_three_anchors_are_too_few():
    rng = np.random.default_rng(9)
    pad = commissioned(ANCHORS[:3])
    with pytest.raises(CalibrationError, match="3 anchors ranged the drone; 4 are needed"):
        find([ranged(rng, pad, 300.0)], pad)


def test_a_pad_that_is_hardly_known_calibrates_nothing():
    rng = np.random.default_rng(10)
    pad = commissioned()
    vague = replace(
        pad,
        anchors=tuple(replace(each, bias=(replace(each.bias[0], sigma_mm=450),)) for each in pad.anchors),
    )
    with pytest.raises(CalibrationError, match=r"known to 2.. mm only"):
        find([ranged(rng, vague, 300.0, own=np.zeros(4))], vague)
