"""Which zones reach a pad, at which heights, and what is published of them."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from wonderland.proofs.records.closures import MAX_CLOSURES, Closure
from wonderland.proofs.records.transactions import SetClosures
from wonderland_backend.zones.applicability import DAY_MS
from wonderland_backend.zones.closing import PadPlace, TooManyClosuresError, Touch, distance_m, plan, same, touching
from wonderland_backend.zones.heights import Band, reaches
from wonderland_backend.zones.store import around
from wonderland_backend.zones.zone import Limit, Volume, zone_of

NOON = round(datetime(2026, 6, 3, 12, tzinfo=UTC).timestamp() * 1000)
PAD = PadPlace("pad-1", 60.45, 22.27, 30.0, 100.0)
GEOD = Geod(ellps="WGS84")
ALWAYS = (None, None)


def zone(identifier="A", kind="PROHIBITED", at=(22.27, 60.45), radius=50, layer=None, **more):
    point = {"type": "Point", "coordinates": list(at), "extent": {"subType": "Circle", "radius": radius}}
    if layer is not None:
        point["layer"] = layer
    its = {"identifier": identifier, "country": "FIN", "type": kind, **more}
    return zone_of(json.dumps({"geometry": point, "properties": its}))


def touched(*zones, pad=PAD):
    return touching(pad, [(each, ALWAYS) for each in zones])


@settings(max_examples=100, deadline=None)
@given(
    lat=st.floats(-80, 80), lon=st.floats(-180, 180), azimuth=st.floats(0, 360),
    distance=st.floats(200, 3_000), radius=st.floats(1, 150),
)  # fmt: skip
def test_the_distance_to_a_circle_is_the_geodesic_less_its_radius(lat, lon, azimuth, distance, radius):
    """Also across the 180th meridian."""
    there_lon, there_lat, _ = GEOD.fwd(lon, lat, azimuth, distance)
    pad = PadPlace("p", lat, lon, 0, 0)
    found = distance_m(pad, zone(at=(there_lon, there_lat), radius=radius).volumes[0].area)
    assert found == pytest.approx(distance - radius, abs=1.0 + distance * 2e-3)
    box = around(lat, lon, distance)
    assert box.holds(round(there_lat * 1e7), round(there_lon * 1e7))


def test_zones_within_the_reach_count_and_no_others():
    lon, lat, _ = GEOD.fwd(22.27, 60.45, 90, 149)
    near = zone("NEAR", at=(lon, lat))
    lon, lat, _ = GEOD.fwd(22.27, 60.45, 90, 152)
    far = zone("FAR", at=(lon, lat))
    here = zone("HERE", "CONDITIONAL")
    found = touched(far, here, near)
    assert [(each.zone.zone_id, each.closes) for each in found] == [("FIN:NEAR", True), ("FIN:HERE", False)]
    assert found[0].distance_m == pytest.approx(99, abs=0.5)


@pytest.mark.parametrize(
    ("layer", "expected"),
    [
        (None, ["yes"]),
        ({"lower": 0, "lowerReference": "AGL", "upper": 120, "upperReference": "AGL"}, ["yes"]),
        ({"lower": 101, "lowerReference": "AGL"}, []),
        ({"lower": 400, "lowerReference": "AGL", "uom": "ft"}, []),
        ({"lower": 120, "lowerReference": "WGS84"}, ["yes"]),
        ({"lower": 131, "lowerReference": "WGS84"}, []),
        ({"upper": 29, "upperReference": "WGS84"}, []),
        ({"lower": 100, "lowerReference": "AMSL"}, ["perhaps"]),  # sea level is anywhere from −107 to +86 m there
        ({"lower": 300, "lowerReference": "AMSL"}, []),
        ({"lower": -200, "lowerReference": "AMSL", "upper": 300, "upperReference": "AMSL"}, ["yes"]),
    ],
)
def test_heights_over_different_references(layer, expected):
    assert [each.heights for each in touched(zone(layer=layer))] == expected


limits = st.none() | st.builds(Limit, st.integers(-300, 1_000), st.sampled_from(["AGL", "AMSL", "WGS84"]))


@settings(max_examples=300, deadline=None)
@given(
    lower=limits, upper=limits, band=st.tuples(st.integers(-200, 900), st.integers(0, 300)),
    reference=st.sampled_from(["AGL", "AMSL", "WGS84"]), ground=st.integers(-400, 4_000),
    geoid=st.integers(-107, 86), known=st.booleans(),
)  # fmt: skip
def test_what_is_said_of_heights_holds_on_any_terrain(lower, upper, band, reference, ground, geoid, known):
    def height(limit):
        return limit.metres + {"AGL": ground, "AMSL": geoid, "WGS84": 0}[limit.reference]

    low, high = band[0], band[0] + band[1]
    truth = (lower is None or height(lower) <= height(Limit(high, reference))) and (
        upper is None or height(upper) >= height(Limit(low, reference))
    )
    said = reaches(Volume(None, lower, upper), Band(low, high, reference, ground if known else None))
    assert said in ({"yes", "perhaps"} if truth else {"no", "perhaps"})
    if known and "AMSL" not in {reference, *(each.reference for each in (lower, upper) if each is not None)}:
        assert said == ("yes" if truth else "no")


def scheduled(identifier="A", minutes=60):
    entry = {"day": ["ANY"], "startTime": "18:00:00Z", "endTime": f"{18 + minutes // 60}:00:00Z"}
    return zone(identifier, limitedApplicability=[{"schedule": [entry]}])


def test_a_plan_writes_out_whole_days_from_today():
    due = plan(touched(scheduled(), zone("C", "CONDITIONAL")), NOON, 3)
    midnight = NOON - NOON % DAY_MS
    assert due.valid_until_ms == midnight + 3 * DAY_MS
    assert [(each.zone_id, (each.from_ms - midnight) / 3_600_000) for each in due.closures] == [
        ("FIN:A", 18), ("FIN:A", 42), ("FIN:A", 66),
    ]  # fmt: skip
    assert {each.actions for each in due.closures} == {("land", "takeoff", "dock")}
    SetClosures(pad_id="pad-1", closures=tuple(due.closures), valid_until_ms=due.valid_until_ms).encode()


def test_a_plan_that_does_not_fit_ends_sooner_and_misses_nothing_until_then():
    zones = [scheduled(f"Z{number}") for number in range(50)]
    due = plan(touched(*zones), NOON, 30)
    assert len(due.closures) == MAX_CLOSURES
    assert due.valid_until_ms == NOON - NOON % DAY_MS + 8 * DAY_MS + 18 * 3_600_000
    with pytest.raises(TooManyClosuresError):
        plan(touched(*(zone(f"Z{number}") for number in range(MAX_CLOSURES + 1))), NOON, 3)


def test_the_data_sets_own_validity_counts():
    touch = Touch(zone(), (None, NOON + 5), 0, "yes")
    assert [each.until_ms for each in plan([touch], NOON, 3).closures] == [NOON + 5]


def closure(start, end, zone_id="FIN:A", actions=("land",)):
    return Closure(zone_id=zone_id, actions=actions, from_ms=start, until_ms=end)


def test_what_is_published_is_compared_by_what_it_forbids():
    pieces = [closure(10, 20), closure(20, 30)]
    assert same(pieces, [closure(0, 50)], 10, 30)
    assert not same(pieces, [closure(0, 50)], 10, 31)
    assert not same(pieces, [closure(10, 30, "FIN:B")], 10, 30)
    assert not same(pieces, [closure(10, 30, actions=("land", "dock"))], 10, 30)
    assert same([], [closure(10, 30)], 30, 99)
