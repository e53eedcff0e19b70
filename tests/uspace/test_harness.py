"""The interfaces of InterUSS: flights go in as a test injects them and are seen as a person would see them."""

from __future__ import annotations

import json
import uuid

import pytest
from implicitdict import ImplicitDict
from uas_standards.interuss.automated_testing.rid.v1 import injection, observation
from uas_standards.interuss.automated_testing.versioning import api as versioning

from wonderland import __version__
from wonderland_backend.http.times import rfc3339

INJECT, OBSERVE = "rid.inject_test_data", "dss.read.identification_service_areas"
JSON = {"Content-Type": "application/json"}
NEAR = "60.447,22.255,60.457,22.278"


def test_flight(now, **change):
    states = [
        {
            "timestamp": rfc3339(now - 3_000 + 1_000 * step), "timestamp_accuracy": 0.1, "operational_status": "Airborne",
            "position": {
                "lat": 60.4518 + step / 1e5, "lng": 22.2666, "alt": 41.5, "accuracy_h": "HA3m", "accuracy_v": "VA3m",
                "extrapolated": False,
            },
            "track": 12.5, "speed": 3.25, "speed_accuracy": "SA1mps", "vertical_speed": 0.5,
            "height": {"distance": 11, "reference": "TakeoffLocation"},
        }
        for step in range(20)
    ]  # fmt: skip
    details = {
        "id": f"flight-{uuid.uuid4()}", "operator_id": "FIN87astrdge12k8", "operator_location": {"lat": 60.45, "lng": 22.26},
        "operator_altitude": {"altitude": 19.5, "altitude_type": "Takeoff"}, "uas_id": {"serial_number": "INTCJ123-4567-890"},
        "operation_description": "A survey", "eu_classification": {"category": "Open", "class": "Class2"},
        "auth_data": {"format": 0, "data": ""},
    }  # fmt: skip
    return {
        "injection_id": str(uuid.uuid4()),
        "aircraft_type": "Helicopter",
        "telemetry": states,
        "details_responses": [{"effective_after": rfc3339(now - 10_000), "details": details}],
    } | change


test_flight.__test__ = False


@pytest.fixture
async def uss(new_uss, dss):
    async with new_uss(dss=[dss.url], test_harness=True, serve="ours") as found:
        yield found


async def test_injected_flights_are_told_shown_and_taken_away(uss, dss, until):
    test_id = str(uuid.uuid4())
    asked = test_flight(uss.uspace.clock())
    answer = await uss.ask("PUT", f"/tests/{test_id}", INJECT, json={"requested_flights": [asked]})
    assert answer.status_code == 200, answer.text
    made = ImplicitDict.parse(answer.json(), injection.ChangeTestResponse)
    assert answer.json()["injected_flights"] == [asked]
    assert (await uss.ask("PUT", f"/tests/{test_id}", INJECT, json={"requested_flights": []})).status_code == 409

    answer = await uss.get("/uss/flights", params={"view": NEAR, "recent_positions_duration": 60})
    (flight,) = answer.json()["flights"]
    details = asked["details_responses"][0]["details"]
    assert flight["id"] == details["id"]
    assert flight["simulated"] is True
    assert (flight["current_state"]["track"], flight["current_state"]["speed"]) == (12.5, 3.25)
    assert flight["current_state"]["position"]["height"] == {"distance": 11.0, "reference": "TakeoffLocation"}
    assert 3 <= len(flight["recent_positions"]) <= 6
    told = (await uss.get(f"/uss/flights/{flight['id']}/details")).json()["details"]
    assert told["operator_location"] == {
        "position": {"lat": 60.45, "lng": 22.26},
        "altitude": {"value": 19.5, "reference": "W84", "units": "M"},
        "altitude_type": "Takeoff",
    }
    await until(lambda: dss.areas)

    answer = await uss.ask("GET", "/display_data", OBSERVE, params={"view": NEAR})
    assert answer.status_code == 200, answer.text
    ImplicitDict.parse(answer.json(), observation.GetDisplayDataResponse)
    (shown,) = answer.json()["flights"]
    assert shown["most_recent_position"]["alt"] == 41.5
    assert shown["current_state"]["speed"] == 3.25
    answer = await uss.ask("GET", f"/display_data/{shown['id']}", OBSERVE)
    ImplicitDict.parse(answer.json(), observation.GetDetailsResponse)
    assert answer.json()["operator"]["id"] == "FIN87astrdge12k8"
    assert answer.json()["uas"]["id"] == "INTCJ123-4567-890"

    answer = await uss.ask("GET", "/display_data", OBSERVE, params={"view": "60.44,22.23,60.47,22.30"})
    ImplicitDict.parse(answer.json(), observation.GetDisplayDataResponse)
    assert [each["number_of_flights"] for each in answer.json()["clusters"]] == [1]

    assert (await uss.ask("DELETE", f"/tests/{test_id}/other", INJECT)).status_code == 409
    answer = await uss.ask("DELETE", f"/tests/{test_id}/{made.version}", INJECT)
    assert answer.status_code == 200
    ImplicitDict.parse(answer.json(), injection.DeleteTestResponse)
    assert (await uss.get("/uss/flights", params={"view": NEAR})).json()["flights"] == []
    assert (await uss.ask("DELETE", f"/tests/{test_id}/{made.version}", INJECT)).status_code == 404


async def test_an_operator_learns_of_telemetry_that_lacks_something(uss):
    now = uss.uspace.clock()
    asked = test_flight(now)
    del asked["telemetry"][0]["speed"]
    del asked["telemetry"][1]["position"]["lat"]
    asked["telemetry"][2]["track"] = 400
    asked["telemetry"][3]["position"]["lat"] = float("nan")
    body = json.dumps({"requested_flights": [asked]})
    answer = await uss.ask("PUT", f"/tests/{uuid.uuid4()}", INJECT, content=body, headers=JSON)
    assert answer.status_code == 200
    answer = await uss.ask("GET", "/user_notifications", INJECT, params={"after": rfc3339(now - 1_000)})
    ImplicitDict.parse(answer.json(), injection.QueryUserNotificationsResponse)
    messages = " ".join(each["message"] for each in answer.json()["user_notifications"])
    assert "lacks speed" in messages
    assert "lacks lat" in messages
    assert "cannot be used (track" in messages
    assert "cannot be used (position.lat" in messages
    (flight,) = (await uss.get("/uss/flights", params={"view": NEAR, "recent_positions_duration": 60})).json()[
        "flights"
    ]
    assert flight["recent_positions"][0]["position"]["lat"] == 60.4518
    for params in ({}, {"after": "soon"}, {"after": rfc3339(now), "before": rfc3339(now - 1)}):
        assert (await uss.ask("GET", "/user_notifications", INJECT, params=params)).status_code == 400


async def test_tests_that_are_none(uss):
    good = test_flight(uss.uspace.clock())
    for body in (
        {},
        {"requested_flights": 1},
        {"requested_flights": [{}]},
        {"requested_flights": [good | {"telemetry": 1}]},
    ):
        assert (await uss.ask("PUT", "/tests/a", INJECT, json=body)).status_code == 400
    details = good["details_responses"][0]
    bad = good | {"details_responses": [details | {"details": details["details"] | {"id": "a/b"}}]}
    assert (await uss.ask("PUT", "/tests/a", INJECT, json={"requested_flights": [bad]})).status_code == 400
    assert (await uss.ask("PUT", "/tests/a", "rid.display_provider", json={})).status_code == 403
    assert (await uss.http.put("/tests/a", json={})).status_code == 401


async def test_without_the_switch_there_is_nothing(new_uss):
    async with new_uss() as uss:
        for method, path in (
            ("PUT", "/tests/a"), ("DELETE", "/tests/a/1"), ("GET", "/user_notifications"), ("GET", "/display_data"),
            ("GET", "/display_data/a"), ("GET", "/versions/gov.eu.uspace.v1.netid"),
        ):  # fmt: skip
            answer = await uss.ask(method, path, f"{INJECT} {OBSERVE}")
            assert answer.status_code == 404, path


async def test_the_version_of_what_runs_here(uss):
    scope, identity = "interuss.versioning.read_system_versions", "gov.eu.uspace.v1.netid"
    answer = await uss.ask("GET", f"/versions/{identity}", scope)
    assert answer.status_code == 200, answer.text
    told = ImplicitDict.parse(answer.json(), versioning.GetVersionResponse)
    assert (told.system_identity, told.system_version) == (identity, f"v{__version__}")
    assert (await uss.ask("GET", "/versions/gov.au.casa", scope)).status_code == 404
    assert (await uss.ask("GET", f"/versions/{identity}", INJECT)).status_code == 403
    assert (await uss.http.get(f"/versions/{identity}")).status_code == 401
