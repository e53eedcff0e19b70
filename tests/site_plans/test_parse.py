"""What a site plan may hold, and what a file that is none is told."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import struct
import time
import zlib

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.site_plans import MAX_BYTES, MAX_PROBLEMS, SitePlanError, parse
from wonderland_edge_agent.commands import pad
from wonderland_simulator.place.plans import site_plan

SQUARE = [[-5, -5], [5, -5], [5, 5], [-5, 5], [-5, -5]]


def area(kind="surface", ring=SQUARE, **properties):
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def plan(*features, **more):
    return json.dumps({"type": "FeatureCollection", "frame": "pad", "features": list(features), **more}).encode()


def problems(body):
    with pytest.raises(SitePlanError) as caught:
        parse(body)
    return [str(each) for each in caught.value.problems]


def png(width, height):
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + head
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + chunk + struct.pack(">I", zlib.crc32(chunk))


def image(raw, corners=((-9, 9), (9, 9), (9, -9), (-9, -9))):
    return {"data": base64.b64encode(raw).decode(), "corners": [list(each) for each in corners]}


@pytest.mark.parametrize("pad_id", ["hatter-quay", "looking-glass-mole", "cheshire-heliport"])
def test_the_demos_plans_are_plans(pad_id):
    found = parse(site_plan(pad_id))
    assert {"surface", "fato", "tlof", "safety_area", "approach_sector", "departure_sector", "obstacle", "charger"} <= {
        each.kind for each in found.features
    }


def test_a_plan_is_read_with_heights_and_holes():
    holed = area("surface")
    holed["geometry"]["coordinates"].append([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    post = {"type": "Feature", "properties": {"kind": "obstacle", "name": "Lamp", "height_m": 6.5}}
    post["geometry"] = {"type": "Point", "coordinates": [7, 0]}
    found = parse(plan(holed, post))
    assert [len(each.rings) for each in found.features] == [2, 1]
    assert (found.features[1].name, found.features[1].height_m) == ("Lamp", 6.5)


@pytest.mark.parametrize(
    ("feature", "why"),
    [
        (
            area(ring=[[0, 0], [5, 5], [5, 0], [0, 5], [0, 0]]),
            "coordinates[0]: the ring crosses itself: its edges 0 and 2",
        ),
        (area(ring=[[0, 0], [5, 0], [5, 5], [2, 0], [0, 5], [0, 0]]), "the ring crosses itself"),
        (area(ring=[[0, 0], [5, 0], [2, 0], [2, 5], [0, 0]]), "the ring crosses itself"),
        (area(ring=[[0, 0], [5, 0], [5, 5], [0, 5]]), "its last is its first"),
        (area(ring=[[0, 0], [0.01, 0], [0.01, 0.01], [0, 0]]), "encloses nothing"),
        (area(ring=[[4000, 0], [4005, 0], [4005, 5], [4000, 0]]), "lies 4.0 km from the pad; at most 1 km"),
        (area(ring=[[0, 0], [5, 0, 3], [5, 5], [0, 0]]), "coordinates[0][1]: must be two numbers"),
        (area(ring=[[0, 0], [True, 0], [5, 5], [0, 0]]), "must be two numbers"),
        (area(ring=[[0, 0], [10**400, 0], [5, 5], [0, 0]]), "must be two numbers"),
        (area(ring=[[i / 100, (i % 2)] for i in range(300)]), "too many points: 250"),
        (area("castle"), "kind: must be one of surface, fato"),
        (area("fence"), "geometry.type: of fence must be LineString"),
        (area("obstacle"), "height_m: is missing: an obstacle has a height"),
        (area("obstacle", height_m=9_000), "at most 500"),
        (area("obstacle", height_m="9"), "must be metres"),
        (area(name="x" * 81), "at most 80 characters"),
        (area(name="Quay\u202eyauQ"), "turn the direction"),
        (area(name="a\x00b"), "cannot be seen"),
        (area(name=["a"]), "must be a text"),
        ({"type": "Feature"}, "features[0]: must be a Feature"),
        (7, "features[0]: must be a Feature"),
        ({"properties": {"kind": ["x"]}, "geometry": {"type": {}}}, "kind: must be one of"),
    ],
)
def test_what_is_wrong_is_said_with_where(feature, why):
    found = problems(plan(feature))
    assert any(why in each for each in found), found
    assert all(each.startswith("features[0]") for each in found)


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b"", "no JSON"),
        (b"\xff\xfe", "no JSON"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[1]", "no GeoJSON object"),
        (b'{"type":"FeatureCollection","type":"x"}', "a name stands twice"),
        (b'{"type":"FeatureCollection","frame":"pad","features":[NaN]}', "NaN is no JSON number"),
        (b"x" * (MAX_BYTES + 1), "more than"),
        (b'{"type":"Feature"}', 'type: must be "FeatureCollection"'),
        (b'{"type":"FeatureCollection","features":[]}', "metres east and north of the pad's origin, not degrees"),
        (plan(), "the plan is empty"),
        (plan(*[area()] * 501), "more than 500"),
        (plan(area("fato"), area("tlof", [[4, 4], [9, 4], [9, 9], [4, 9], [4, 4]])), "TLOF lies outside the FATO"),
        (plan(image=image(b"GIF89a" + b"\0" * 90)), "neither PNG nor JPEG"),
        (plan(image=image(png(60_000, 60_000))), "60000 × 60000 pixels"),
        (plan(image=image(png(10, 10), [(0, 0), (5, 5), (5, 0), (0, 5)])), "crosses itself"),
        (plan(image=image(png(10, 10), [(0, 0), (5, 5)])), "must be four points"),
        (plan(image={"data": "***", "corners": []}), "base64"),
        (plan(image=7), "must be an object"),
    ],
)
def test_files_that_are_no_plans(body, why):
    assert any(why in each for each in problems(body)), problems(body)


def test_an_image_alone_is_a_plan():
    found = parse(plan(image=image(png(640, 480))))
    assert found.image is not None
    assert (found.image.media_type, found.features) == ("image/png", ())


def test_no_more_problems_than_one_reads():
    assert len(problems(plan(*[area("castle")] * 400))) == MAX_PROBLEMS


def test_the_largest_plan_is_checked_within_seconds():
    # A zigzag askew: the boxes around all of its edges overlap, and no two edges do.
    askew = [[0, 0.01 * i] if i % 4 in (0, 3) else [100, 100 + 0.01 * i] for i in range(248)]
    body = plan(*[area(ring=[*askew, [-1, 5], askew[0]])] * 20)
    begun = time.perf_counter()
    parse(body)
    assert time.perf_counter() - begun < 20


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4),
    max_leaves=12,
)
kinds = st.sampled_from(["surface", "fato", "tlof", "obstacle", "fence", "marking"])
geometries = st.fixed_dictionaries(
    {"type": st.sampled_from(["Point", "LineString", "Polygon"]) | json_values, "coordinates": json_values}
)
features = st.fixed_dictionaries(
    {
        "properties": st.dictionaries(st.sampled_from(["kind", "name", "height_m"]), kinds | json_values),
        "geometry": geometries,
    }
)


@settings(max_examples=400, deadline=None)
@given(st.lists(features | json_values, max_size=4), json_values)
def test_whatever_comes_is_a_plan_or_told_why_not(given_features, given_image):
    body = plan(*given_features, image=given_image)
    with contextlib.suppress(SitePlanError):
        assert parse(body).features or given_image


def test_the_command_checks_as_the_server_does(tmp_path):
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    good.write_bytes(site_plan("hatter-quay"))
    bad.write_bytes(plan(area("castle"), area(ring=SQUARE[:-1])))
    told = CliRunner().invoke(pad, ["site-plan", str(good)])
    assert (told.exit_code, told.stdout.split()[0]) == (0, "13")
    assert hashlib.sha256(good.read_bytes()).hexdigest() in told.stdout
    refused = CliRunner().invoke(pad, ["site-plan", str(bad), "--json"])
    assert refused.exit_code == 1
    assert [each["where"] for each in json.loads(refused.stdout)["problems"]] == [
        "features[0].properties.kind",
        "features[1].geometry.coordinates[0]",
    ]
