"""Files of zones: what is read, what is repaired, and every error with its line."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
import referencing
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_backend.zones.files.lines import Lines
from wonderland_backend.zones.files.reading import read
from wonderland_backend.zones.zone import volumes_of, zone_of

FILES = Path(__file__).parent / "files"
STANDARD = Path(__file__).resolve().parents[3] / "shared" / "openapi" / "ed318"
needs_standard = pytest.mark.skipif(not STANDARD.exists(), reason="the standard's schema is not on this machine")


def read_file(name):
    return read((FILES / name).read_bytes())


def changed(change, name="turku.ed318.json"):
    """The report about a good file after one change."""
    document = json.loads((FILES / name).read_text())
    change(document)
    return read(json.dumps(document, indent=1).encode())


def test_a_good_file_of_ed318():
    file = read_file("turku.ed318.json")
    assert (file.format, file.error_count, file.notice_count) == ("ed318", 0, 0)
    castle, circle, night = map(zone_of, map(json.dumps, file.features))
    assert castle.zone_id == "FIN:P20"
    assert len(castle.volumes[0].area.interiors) == 1
    assert (circle.volumes[0].lower.metres, circle.volumes[0].upper.reference) == (pytest.approx(15.24), "AMSL")
    assert circle.bounds == pytest.approx((22.2302, 60.43385, 22.3030, 60.46975), abs=1e-4)
    assert [each.lower for each in night.volumes] == [night.volumes[0].lower, None]  # its own layer counts
    assert night.volumes[1].upper.metres == 100
    assert night.feature["properties"]["extendedProperties"] == {"local": True}


def test_a_good_file_of_ed269_becomes_ed318():
    file = read_file("naantali.ed269.json")
    assert (file.format, file.error_count) == ("ed269", 0)
    assert [(each.line, each.message.split(";")[0]) for each in file.notices] == [
        (13, "FOREIGN_TERRITORY is unknown to ED-318")
    ]
    refinery, concerts = file.features
    its = refinery["properties"]
    assert (its["type"], its["variant"], its["reason"]) == ("REQ_AUTHORIZATION", "COMMON", ["SENSITIVE", "OTHER"])
    assert its["name"] == [{"text": "Refinery", "lang": "und"}]
    assert "limitedApplicability" not in its
    low, high = volumes_of(refinery["geometry"])
    assert (low.upper.metres, high.lower.metres) == (150, pytest.approx(152.4))
    assert high.area.bounds[3] - high.area.bounds[1] == pytest.approx(2 * 3048 / 111_400, rel=0.01)
    (period,) = concerts["properties"]["limitedApplicability"]
    assert period["schedule"] == [{"day": ["FRI", "SAT"], "startTime": "18:00:00Z", "endTime": "01:00:00Z"}]


@needs_standard
@pytest.mark.parametrize("name", ["turku.ed318.json", "naantali.ed269.json"])
def test_what_is_kept_fits_the_standards_schema(name):
    resources = [
        (path.name, referencing.Resource.from_contents(json.loads(path.read_text())))
        for path in (STANDARD / "schema").glob("*.json")
    ]
    registry = referencing.Registry().with_resources(
        [*resources, *((f"./{path}", resource) for path, resource in resources)]
    )
    schema = json.loads((STANDARD / "schema" / "Schema_GeoZones.json").read_text())
    file = read_file(name)
    collection = {"type": "FeatureCollection", **file.about, "features": file.features}
    jsonschema.Draft7Validator(schema, registry=registry).validate(collection)


@needs_standard
@pytest.mark.parametrize("path", sorted(STANDARD.glob("examples/Example_*.json")), ids=lambda path: path.stem)
def test_the_standards_examples_are_read(path):
    file = read(path.read_bytes())
    assert file.errors == []
    assert file.features


@needs_standard
def test_the_standards_invalid_example_is_refused():
    file = read((STANDARD / "examples" / "InvalidExample_GeoZone_2_Layers.json").read_bytes())
    assert [each.path for each in file.errors] == [
        "metadata.validFrom",
        "features[0].properties.name[0].lang",
        "features[0].properties.type",
    ]


def test_every_error_of_a_file_is_told_with_its_line():
    file = read_file("broken.ed318.json")
    told = [(each.line, each.path.removeprefix("features"), each.message.split(";")[0][:40]) for each in file.errors]
    assert told == [
        (9, "[0].geometry.coordinates[0][0]", "the polygon crosses itself near [22.0500"),
        (15, "[0].geometry.layer", "the lower limit (200) is not below the u"),
        (18, "[0].properties.identifier", "11 characters"),
        (19, "[0].properties.country", "2 characters"),
        (20, "[0].properties.type", "'FORBIDDEN' is none of USPACE, PROHIBITE"),
        (23, "[0].properties.limitedApplicability[0].startDateTime", "'2026-06-01T08:00:00' is no date and tim"),
        (23, "[0].properties.limitedApplicability[0].schedule[0].day[0]", "'MOO' is none of MON, TUE, WED, THU, FRI"),
        (23, "[0].properties.limitedApplicability[0].schedule[0].startTime", "'08:00' is no time such as 08:00:00Z"),
        (25, "[0].properties.zoneAuthority[0].purpose", "`purpose` is missing here"),
        (25, "[0].properties.zoneAuthority[0].email", "'nobody': expected an address such as na"),
        (25, "[0].properties.zoneAuthority[0].siteURL", "'javascript:alert(1)': expected an addre"),
        (32, "[1].geometry.coordinates[0][3]", "the ring is not closed"),
        (39, "[1].properties.colour", "`colour` is not known here"),
        (45, "[2].geometry.coordinates", "latitude 122.0: longitude comes first, t"),
        (45, "[2].geometry.extent.radius", "-5 is outside of 0.1 to 500000"),
        (46, "[2].properties.zoneAuthority", "0 items"),
    ]
    assert file.features == []


def ring(document, points):
    document["features"][0]["geometry"]["coordinates"] = [points]


SQUARE = [[22.0, 60.0], [22.1, 60.0], [22.1, 60.1], [22.0, 60.1], [22.0, 60.0]]


def test_a_ring_in_the_wrong_direction_is_turned_and_that_is_said():
    file = changed(lambda document: ring(document, SQUARE[::-1]))
    assert file.errors == []
    assert [each.message for each in file.notices] == [
        "the ring was turned: an outer ring runs anticlockwise (RFC 7946, 3.1.6)"
    ]
    assert file.features[0]["geometry"]["coordinates"] == [SQUARE]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: ring(d, SQUARE[:-1]), "not closed"),
        (lambda d: ring(d, SQUARE[:2]), "a ring has at least four"),
        (lambda d: ring(d, [[y, x] for x, y in [(22.0, 122.0), (23.0, 122.0), (23.0, 123.0), (22.0, 122.0)]]), None),
        (lambda d: ring(d, [[-179.0, 60.0], [179.0, 60.0], [179.0, 61.0], [-179.0, 60.0]]), "180th meridian"),
        (lambda d: ring(d, [[22.0, 60.0], [22.1, 60.0], [22.2, 60.0], [22.0, 60.0]]), ""),
        (lambda d: ring(d, [[22.0, "60"], *SQUARE[1:]]), "two numbers"),
        (lambda d: ring(d, [[22.0, 1e400], *SQUARE[1:]]), ""),
        (lambda d: d["features"][0].update(geometry={"type": "LineString", "coordinates": SQUARE}), "has no area"),
        (lambda d: d["features"][0].update(geometry={"type": ["Polygon"], "coordinates": []}), "has no area"),
        (lambda d: d["features"][0].update(geometry={"type": "Point", "coordinates": [22, 60]}), "add `extent`"),
        (lambda d: d["features"][0].update(geometry=None), "`geometry` is missing"),
        (lambda d: d["features"].append(d["features"][0]), "in the file twice"),
        (lambda d: d["metadata"].update(validTo="2019-01-01T00:00:00Z"), "ends before it begins"),
        (lambda d: d.update(features={}), "expected a list, found an object"),
        (lambda d: d["features"].append(7), "expected an object, found a number"),
        (lambda d: d["features"][0]["properties"].update(reason=["SENSITIVE", 5]), "expected a text"),
        (lambda d: d["features"][0]["properties"].update(region=1.5), "whole number"),
        (lambda d: d["features"][0]["geometry"]["layer"].pop("upperReference"), "say whether the limit is AGL"),
        (lambda d: d.update(type="Topology"), "neither ED-318"),
    ],
)
def test_what_is_refused(change, says):
    file = changed(change)
    assert (file.error_count > 0) == (says is not None)
    if says is not None:
        assert any(says in each.message for each in file.errors), file.errors
        assert file.features == []
        assert all(each.line >= 1 for each in file.errors)


@pytest.mark.parametrize(
    ("data", "line", "column", "says"),
    [
        (b"", 1, 1, "no valid JSON"),
        (b'{"type":\n "FeatureCollection",\n "features": [}', 3, 15, "no valid JSON"),
        (b'{"type":\n "\xe4"}', 2, 3, "not UTF-8"),
        ("\ufeff[]".encode(), 1, 1, "expected an object, found a list"),
        (b'{"features": [' + b"[" * 2000, 1, None, "no valid JSON"),
    ],
)
def test_what_is_no_json_at_all(data, line, column, says):
    (error,) = read(data).errors
    assert error.line == line
    assert column in {None, error.column}
    assert says in error.message


def test_many_errors_are_counted_and_the_first_listed():
    file = changed(lambda document: document.update(features=[{}] * 300))
    assert (file.error_count, len(file.errors)) == (900, 200)


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


def _paths(value, path=()):
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, each in inner:
        yield from _paths(each, (*path, key))


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_file_with_anything_anywhere_is_read_or_refused_and_never_more(data):
    name = data.draw(st.sampled_from(["turku.ed318.json", "naantali.ed269.json"]))
    document = json.loads((FILES / name).read_text())
    path = data.draw(st.sampled_from(list(_paths(document))[1:]))
    place = document
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = data.draw(anything)
    file = read(json.dumps(document).encode())
    assert (file.error_count > 0) == bool(file.errors)
    for feature in file.features:
        zone_of(json.dumps(feature))


@settings(max_examples=100, deadline=None)
@given(anything, st.sampled_from([None, 1, 2]))
def test_every_value_is_found_in_its_line(document, indent):
    text = json.dumps(document, indent=indent, ensure_ascii=False)
    lines, rows = Lines(text), text.split("\n")
    for path in _paths(document):
        value = document
        for part in path:
            value = value[part]
        line, column = lines.of(path)
        rest = "\n".join([rows[line - 1][column - 1 :], *rows[line:]])
        assert json.JSONDecoder().raw_decode(rest)[0] == value
