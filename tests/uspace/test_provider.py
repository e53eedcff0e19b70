"""The service provider over HTTP: what a display provider gets, and what it is refused."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from implicitdict import ImplicitDict
from uas_standards.astm.f3411.v22a.api import (
    ErrorResponse,
    GetFlightDetailsResponse,
    GetFlightsResponse,
    GetIdentificationServiceAreaDetailsResponse,
)

from wonderland_backend.agents.connected import Agent
from wonderland_backend.uspace.netrid.views import BadView, ViewTooLarge, parse_view

INTERFACE = Path(__file__).resolve().parents[3] / "shared/openapi/f3411-22a_netrid_updated.yaml"
VIEW = "60.44,22.25,60.46,22.29"
START_MS = 1_800_000_000_000


def conforms(answer, name, model):
    """Against the types of the standard always, and against its interface file where that is."""
    content = answer.json()
    parsed = ImplicitDict.parse(content, model)
    if INTERFACE.is_file():
        import yaml

        document = yaml.safe_load(INTERFACE.read_text())
        schema = {"$ref": f"#/components/schemas/{name}", "components": document["components"]}
        # OpenAPI 3.0 has the older form of exclusive bounds.
        text = json.dumps(schema).replace('"exclusiveMinimum": false, ', "").replace('"exclusiveMaximum": false, ', "")
        jsonschema.validate(content, json.loads(text.replace('"exclusiveMinimum": true, ', "")))
    return parsed


@pytest.fixture
async def uss(new_uss):
    async with new_uss() as found:
        yield found


async def flights(uss, view=VIEW, **params):
    answer = await uss.get("/uss/flights", params={"view": view, **params})
    assert answer.status_code == 200, answer.text
    conforms(answer, "GetFlightsResponse", GetFlightsResponse)
    return answer.json()


async def test_a_flight_is_told_as_it_was_claimed(uss, track):
    await uss.heard(track(claim_t_ms=uss.uspace.clock() - 300))
    told = await flights(uss)
    (flight,) = told["flights"]
    state = flight["current_state"]
    assert flight["aircraft_type"] == "Helicopter"
    assert "recent_positions" not in flight
    assert state["position"] == {
        "lat": 60.4518, "lng": 22.2666, "alt": 40.0, "accuracy_h": "HA3m", "accuracy_v": "VA10m",
        "extrapolated": False, "pressure_altitude": -1000, "height": {"distance": 12.0, "reference": "TakeoffLocation"},
    }  # fmt: skip
    assert (state["track"], state["speed"], state["vertical_speed"]) == (90.0, 5.25, -0.5)
    assert (state["speed_accuracy"], state["timestamp_accuracy"]) == ("SA03mps", 0.1)
    assert state["operational_status"] == "Airborne"
    assert state["timestamp"]["value"].endswith("Z")
    assert flight["simulated"] is False
    assert uss.uspace.flights.find_flight(flight["id"]).drone not in flight["id"]


async def test_who_flies(uss, track):
    await uss.heard(track(operator_id="FIN87astrdge12k8-xyz", description="Roof survey", description_type="text"))
    (flight,) = (await flights(uss))["flights"]
    answer = await uss.get(f"/uss/flights/{flight['id']}/details")
    conforms(answer, "GetFlightDetailsResponse", GetFlightDetailsResponse)
    details = answer.json()["details"]
    assert details == {
        "id": flight["id"],
        "uas_id": {"serial_number": "1581F5FKD229400A1234"},
        "operator_id": "FIN87astrdge12k8",
        "operator_location": {
            "position": {"lat": 60.452, "lng": 22.267},
            "altitude": {"value": 30.0, "reference": "W84", "units": "M"},
            "altitude_type": "Takeoff",
        },
        "eu_classification": {"category": "Open", "class": "Class2"},
        "operation_description": "Roof survey",
    }
    assert (await uss.get("/uss/flights/nobody/details")).status_code == 404


async def test_the_operators_secret_and_place_are_never_stored(uss, track):
    from sqlalchemy import text

    await uss.heard(track(operator_id="FIN87astrdge12k8-xyz"))
    async with uss.backend.database.read() as session:
        bodies = [row[0] for row in await session.execute(text("select body from tracks"))]
        bodies += [row[0] for row in await session.execute(text("select body from latest_tracks"))]
    assert len(bodies) == 2
    for body in bodies:
        assert "xyz" not in body
        assert "operator_lat" not in body
        assert '"uav_id":"1581F5FKD229400A1234"' in body


async def test_what_is_unknown_has_the_standards_values(uss, track):
    bare = {"uav_id": "1581F5FKD229400A1234", "lat_e7": 604_518_000, "lon_e7": 222_666_000, "transport": "udp"}
    await uss.heard(bare)
    (flight,) = (await flights(uss, recent_positions_duration=60))["flights"]
    state = flight["current_state"]
    assert (state["track"], state["speed"], state["vertical_speed"]) == (361, 255, 63)
    assert (state["position"]["alt"], state["position"]["accuracy_h"]) == (-1000, "HAUnknown")
    assert state["timestamp_accuracy"] == 1.5
    assert state["operational_status"] == "Undeclared"
    assert len(flight["recent_positions"]) == 1


async def test_a_drone_on_the_ground_is_no_flight(uss, track):
    await uss.heard(track(status="ground"))
    assert (await flights(uss))["flights"] == []


async def test_one_position_a_second_for_a_minute(new_uss, track, clock):
    async with new_uss(clock=clock) as uss:
        uss.authority.token = _at(uss.authority.token, clock)
        for second in range(1, 151):
            clock.now_ms = START_MS + second * 1_000
            steps = range(second * 10 - 9, second * 10 + 1)
            await uss.heard(*(track(lat=604_518_000 + step, claim_t_ms=START_MS + step * 100) for step in steps))
        (flight,) = (await flights(uss, recent_positions_duration=60))["flights"]
        times = [each["time"]["value"] for each in flight["recent_positions"]]
        assert 60 <= len(times) <= 62
        assert times == sorted(times)
        assert flight["current_state"]["timestamp"]["value"] == times[-1]
        assert flight["current_state"]["position"]["lat"] == (604_518_000 + 1_500) / 1e7
        (flight,) = (await flights(uss, recent_positions_duration=10))["flights"]
        assert 10 <= len(flight["recent_positions"]) <= 12
        clock.pass_s(61)
        assert (await flights(uss))["flights"] == []
        assert (await uss.get(f"/uss/flights/{flight['id']}/details")).status_code == 404
        await uss.heard(track(lat=604_518_000))
        assert (await flights(uss))["flights"][0]["id"] != flight["id"]


def _at(token, clock):
    return lambda **claims: token(now_s=clock() // 1000, **claims)


async def test_who_flew_through_is_told_with_the_steps_in_and_out_and_no_further(new_uss, track, clock):
    """From west to east through a narrow view, a position each second."""
    async with new_uss(clock=clock) as uss:
        uss.authority.token = _at(uss.authority.token, clock)
        for step in range(30):
            clock.now_ms = START_MS + step * 1_000
            await uss.heard(track(lng=222_600_000 + step * 1_000, claim_t_ms=clock()))
        told = await flights(uss, view="60.44,22.26095,60.46,22.26145", recent_positions_duration=60)
        (flight,) = told["flights"]
        lngs = [each["position"]["lng"] for each in flight["recent_positions"]]
        assert lngs == [22.2609, 22.261, 22.2611, 22.2612, 22.2613, 22.2614, 22.2615]
        assert flight["current_state"]["position"]["lng"] == 22.2629
        assert (await flights(uss, view="60.44,22.2,60.46,22.21"))["flights"] == []


async def test_a_drone_with_a_wrong_clock_is_dated_by_who_heard_it(uss, track):
    now = uss.uspace.clock()
    await uss.heard(track(claim_t_ms=now - 900_000), t_ms=now)
    (flight,) = (await flights(uss))["flights"]
    assert flight["current_state"]["timestamp_accuracy"] == 1.5


async def test_a_time_of_unknown_accuracy_is_not_told_as_a_perfect_one(uss, track):
    await uss.heard(track(claim_t_ms=uss.uspace.clock(), time_accuracy_ms=None))
    (flight,) = (await flights(uss))["flights"]
    assert flight["current_state"]["timestamp_accuracy"] == 1.5


async def test_only_flights_of_our_operators(new_uss, track):
    async with new_uss(serve="ours", operators=["FIN87astrdge12k8-xyz"], drones=["SERIAL2"]) as uss:
        assert uss.uspace.settings.operators == ("FIN87astrdge12k8",)
        await uss.heard(
            track("SERIAL1"), track("SERIAL2", operator_id=None), track("SERIAL3", operator_id="FIN87astrdge12k9")
        )
        ids = [each["id"] for each in (await flights(uss))["flights"]]
        served = {uss.uspace.flights.find_flight(each).drone for each in ids}
        assert served == {"SERIAL1", "SERIAL2"}
        uss.backend.parts.agents.join(Agent("uav", "SERIAL3", "0" * 32))
        assert len((await flights(uss))["flights"]) == 3
        uss.backend.parts.agents.leave(next(iter(uss.backend.parts.agents)))
        others = [each.flight_id for each in uss.uspace.flights if each.drone == "SERIAL3"]
        assert (await uss.get(f"/uss/flights/{others[0]}/details")).status_code == 404


async def test_views_that_are_none(uss):
    for view in ("", "1,2,3", "1,2,3,4,5", "a,b,c,d", "91,0,91,0", "0,181,0,181", "nan,0,0,0", "inf,0,0,0", "1" * 999):
        answer = await uss.get("/uss/flights", params={"view": view})
        assert answer.status_code == 400, view
        assert answer.headers["content-type"] == "application/problem+json"
        ImplicitDict.parse(answer.json(), ErrorResponse)
    assert (await uss.get("/uss/flights")).status_code == 400
    for duration in ("61", "-1", "x", "nan"):
        params = {"view": VIEW, "recent_positions_duration": duration}
        assert (await uss.get("/uss/flights", params=params)).status_code == 400
    assert (await uss.get("/uss/flights", params={"view": VIEW, "unheard_of": "1"})).status_code == 200


@given(st.text(max_size=40) | st.text("0123456789.,-+einfa ", max_size=40))
def test_any_text_is_a_view_or_refused_in_words(text):
    try:
        view = parse_view(text)
    except (BadView, ViewTooLarge):
        return
    assert view.diagonal_m() <= 7_000


async def test_a_system_that_asks_all_the_time_is_told_when_to_go_on(new_uss):
    async with new_uss(requests_per_min=3) as uss:
        codes = [(await uss.get("/uss/flights", params={"view": VIEW})).status_code for _ in range(4)]
        assert codes == [200, 200, 200, 429]
        answer = await uss.get("/uss/flights", params={"view": VIEW})
        assert 0 < int(answer.headers["retry-after"]) <= 60
        answer = await uss.ask("GET", f"/uss/flights?view={VIEW}", "rid.display_provider", sub="another")
        assert answer.status_code == 200


async def test_a_view_of_more_than_7_km(uss):
    assert (await uss.get("/uss/flights", params={"view": "60.40,22.20,60.46,22.28"})).status_code == 413
    # 6.7 km, over the antimeridian.
    answer = await uss.get("/uss/flights", params={"view": "-0.02,179.98,0.02,-179.975"})
    assert answer.status_code == 200
    assert answer.json()["no_isas_present"] is True


async def test_who_may_ask(uss):
    for path in ("/uss/flights?view=" + VIEW, "/uss/flights/a/details"):
        answer = await uss.http.get(path)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == 'Bearer realm="wonderland"'
        answer = await uss.get(path, scope="rid.service_provider")
        assert answer.status_code == 403
        assert "insufficient_scope" in answer.headers["www-authenticate"]
    answer = await uss.ask("POST", "/uss/identification_service_areas/" + "0" * 36, "rid.display_provider", json={})
    assert answer.status_code == 403
    assert (await uss.get("/uss/anything")).status_code == 404
    # A sign-in of the console is no token.
    await uss.sign_in()
    assert (await uss.http.get("/uss/flights?view=" + VIEW)).status_code == 401


async def test_the_extents_of_an_area_of_ours(new_uss, dss, track, until):
    async with new_uss(dss=[dss.url]) as uss:
        await uss.heard(track())
        await until(lambda: dss.areas)
        (area_id,) = dss.areas
        await until(lambda: len(uss.uspace.areas))
        await uss.sign_in()
        metrics = (await uss.http.get("/api/v1/metrics")).text
        assert "wonderland_uspace_flights 1.0" in metrics
        assert "wonderland_uspace_areas 1.0" in metrics
        answer = await uss.get(f"/uss/identification_service_areas/{area_id}")
        name = "GetIdentificationServiceAreaDetailsResponse"
        conforms(answer, name, GetIdentificationServiceAreaDetailsResponse)
        assert len(answer.json()["extents"]["volume"]["outline_polygon"]["vertices"]) == 4
        unknown = "00000000-0000-4000-8000-000000000000"
        assert (await uss.get(f"/uss/identification_service_areas/{unknown}")).status_code == 404
        assert (await uss.get("/uss/identification_service_areas/x")).status_code == 400
