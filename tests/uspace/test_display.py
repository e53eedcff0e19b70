"""Two providers, each a backend of its own, find each other by the DSS and show each other's flights."""

from __future__ import annotations

import asyncio

import pytest
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, Response
from hypothesis import given
from hypothesis import strategies as st

from wonderland_backend.http.times import rfc3339
from wonderland_backend.uspace.claims import Details, State
from wonderland_backend.uspace.flights import Flight
from wonderland_backend.uspace.geo import E7, Box, distance_m
from wonderland_backend.uspace.netrid.clusters import clusters_of, shows_each
from wonderland_backend.uspace.netrid.foreign import FlightsAnswer

NEAR = "60.447,22.255,60.457,22.278"
FAR = "60.44,22.23,60.47,22.30"


@pytest.fixture
async def pair(new_uss, dss):
    """Us, who look, and them, who fly."""
    async with new_uss(dss=[dss.url], client_id="us") as us, new_uss(dss=[dss.url], client_id="them") as them:
        await us.sign_in()
        yield us, them


async def look(us, view=NEAR):
    answer = await us.http.get("/api/v1/networked-flights", params={"view": view})
    assert answer.status_code == 200, answer.text
    return answer.json()


async def test_a_flight_goes_from_their_pad_to_our_map(pair, track, until, dss):
    us, them = pair
    await them.heard(track(claim_t_ms=them.uspace.clock() - 2_000))
    await them.heard(track(lat=604_519_000, claim_t_ms=them.uspace.clock() - 500))
    await until(lambda: dss.areas)
    shown = await until(lambda: seen(us))
    (flight,) = shown["flights"]
    assert shown["clusters"] == []
    assert (flight["lat_e7"], flight["lon_e7"], flight["height_mm"]) == (604_519_000, 222_666_000, 40_000)
    assert [each["lat_e7"] for each in flight["trail"]] == [604_518_000, 604_519_000]
    assert flight["provider"] == them.url.removeprefix("http://")
    assert (flight["speed_mm_s"], flight["track_cdeg"], flight["verified"]) == (5_250, 9_000, False)
    assert flight["flight_id"] not in {each.flight_id for each in them.uspace.flights}
    assert shown["providers"] == [{"provider": them.url.removeprefix("http://")}]

    answer = await us.http.get(f"/api/v1/networked-flights/{flight['flight_id']}")
    assert answer.status_code == 200, answer.text
    assert answer.json()["operator_registration"] == "FIN87astrdge12k8"
    assert answer.json()["uas_id"] == {"serial_number": "1581F5FKD229400A1234"}


async def seen(us, view=NEAR):
    found = await look(us, view)
    return found if found["flights"] or found["clusters"] else None


async def test_from_further_away_only_areas_are_shown_and_no_details(pair, track, until, dss):
    us, them = pair
    await them.heard(*(track(f"SERIAL{each}", lat=604_518_000 + 40 * each) for each in range(5)))
    await until(lambda: dss.areas)
    shown = await until(lambda: seen(us, FAR))
    assert shown["flights"] == []
    assert sum(each["flights"] for each in shown["clusters"]) == 5
    flight_id = next(iter(us.uspace.display._flights)).flight_id
    assert (await us.http.get(f"/api/v1/networked-flights/{flight_id}")).status_code == 404


async def test_a_provider_that_comes_while_we_look_is_told_by_notification(pair, track, until, dss):
    us, them = pair
    assert (await look(us))["flights"] == []
    (subscription,) = dss.subscriptions.values()
    assert subscription.owner == "us"
    asked = len(dss.asked)
    await them.heard(track())
    await until(lambda: seen(us))
    assert ("GET", "/dss/identification_service_areas") not in dss.asked[asked:]
    assert len(dss.subscriptions) == 1


async def test_a_provider_is_asked_once_a_second_however_many_look(pair, track, until, dss):
    us, them = pair
    await them.heard(track())
    await until(lambda: seen(us))
    asked = []
    provider = them.uspace.provider
    answer = provider.flights_in
    provider.flights_in = lambda *args, **more: asked.append(args) or answer(*args, **more)
    await asyncio.sleep(1.1)
    await asyncio.gather(*(look(us) for _ in range(40)))
    assert len(asked) <= 2


async def test_who_may_tell_of_an_area(pair, dss, until):
    us, _ = pair
    await look(us)
    (subscription,) = dss.subscriptions.values()
    area_id = "00000000-0000-4000-8000-00000000000a"
    now = us.uspace.clock()

    def notice(**change):
        area = {
            "id": area_id, "owner": "third", "uss_base_url": "http://127.0.0.1:9", "version": "1",
            "time_start": {"value": rfc3339(now), "format": "RFC3339"},
            "time_end": {"value": rfc3339(now + 600_000), "format": "RFC3339"},
        } | change  # fmt: skip
        told = [{"subscription_id": subscription.entity_id, "notification_index": 1}]
        return {"service_area": area, "subscriptions": told, "future_field": 1}

    async def tell(body, sub="third"):
        path = f"/uss/identification_service_areas/{area_id}"
        return (await us.ask("POST", path, "rid.service_provider", sub=sub, json=body)).status_code

    assert await tell(notice(), sub="fourth") == 403
    assert await tell(notice()) == 204
    assert await tell(notice()) == 204
    assert await tell(notice(uss_base_url="http://127.0.0.1:10")) == 409
    assert await tell(notice(version="2", owner="fourth"), sub="fourth") == 403
    assert await tell({"subscriptions": []}, sub="fourth") == 403
    for bad in ({}, {"subscriptions": 1}, notice(time_end={"value": "soon"}), notice(uss_base_url="file:///etc")):
        assert await tell(bad) == 400
    problem = (await look(us))["providers"]
    assert [each["provider"] for each in problem] == ["127.0.0.1:9"]
    gone = {"subscriptions": [{"subscription_id": subscription.entity_id, "notification_index": 3}]}
    assert await tell(gone) == 204
    assert (await look(us))["providers"] == []


class Bad:
    """A provider that answers as it should not."""

    def __init__(self):
        self.asked = 0
        self.answer = Response("nonsense")
        self.app = FastAPI()
        self.app.get("/uss/flights")(self.flights)

    async def flights(self, request: Request):
        self.asked += 1
        if self.answer is None:
            await asyncio.sleep(5)
        return self.answer


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (Response("nonsense"), "did not answer with a JSON object"),
        (Response("[" * 100_000), "did not answer with a JSON object"),
        (JSONResponse({"flights": []}), "answered what it should not: timestamp"),
        (JSONResponse({}, 500), "answered 500"),
        (JSONResponse({}, 429, {"Retry-After": "100"}), "answered 429"),
        (Response("", 302, {"Location": "http://127.0.0.1:9/"}), "answered 302"),
        (Response(b"x" * (5 << 20)), "sends more than"),
        (None, None),
    ],
)
async def test_providers_that_answer_badly_are_left_alone_and_named(
    new_uss, dss, served, authority, until, answer, problem
):
    bad = Bad()
    bad.answer = answer
    async with served(bad.app) as url, new_uss(dss=[dss.url], client_id="us") as us:
        await us.sign_in()
        cell = "00000000-0000-4000-8000-00000000000b"
        token = authority.token(scope="rid.service_provider", sub="bad")
        view = Box.between(60.44, 22.25, 60.46, 22.29)
        body = {
            "extents": {
                "volume": {"outline_polygon": {"vertices": view.vertices()}},
                "time_end": {"value": rfc3339(us.uspace.clock() + 600_000), "format": "RFC3339"},
            },
            "uss_base_url": url,
        }
        answered = await us.http.put(
            f"{dss.url}/dss/identification_service_areas/{cell}",
            json=body,
            headers={"Authorization": f"Bearer {token}"},
        )
        assert answered.status_code == 200, answered.text
        shown = await look(us)
        assert shown["flights"] == []
        (told,) = shown["providers"]
        if problem is None:
            assert "problem" not in told
        else:
            assert problem in told["problem"]
            asked = bad.asked
            await look(us)
            assert bad.asked == asked


async def test_the_eleventh_subscription_is_a_search(pair, dss, track, until):
    us, them = pair
    for _ in range(20):
        dss.refusals.append((429, {"Retry-After": "5"}))
    await them.heard(track())
    dss.refusals.clear()
    await until(lambda: dss.areas)
    dss.refusals.append((429, {"Retry-After": "5"}))
    assert await until(lambda: seen(us))
    assert ("GET", "/dss/identification_service_areas") in dss.asked


def flight(lat, lng):
    found = Flight("a", "b", Details({}))
    found.take_state(State(t_ms=0, lat=lat, lng=lng))
    return found


@given(
    st.floats(-89.97, 89.97), st.floats(-180, 180), st.floats(0.012, 0.055), st.floats(0.0, 1.0), st.floats(0.0, 1.0)
)
def test_what_clusters_hide(lat, lng, height, up, along):
    """At least 15 % of the view, and 300 m to each side, wherever the view is."""
    import math

    width = min(height / max(math.cos(math.radians(min(89.97, abs(lat) + height))), 1e-3), 179)
    east = lng + width if lng + width <= 180 else lng + width - 360
    view = Box.between(lat, lng, min(90, lat + height), east)
    if shows_each(view) or view.diagonal_m() > 7_000:
        return
    where = (int(view.south + up * (view.north - view.south)), int(view.west + along * view.width))
    where = (where[0], (where[1] + 180 * E7) % (360 * E7) - 180 * E7)
    (cluster,) = clusters_of([flight(*where)], view)
    assert cluster.flights == 1
    assert cluster.box.contains(*where)
    for edge in (cluster.box.south, cluster.box.north):
        assert abs(edge) == 90 * E7 or distance_m(where[0], 0, edge, 0) >= 299.9
    assert cluster.box.area_m2() >= 0.15 * view.area_m2() * 0.999
    assert distance_m(cluster.box.south, 0, cluster.box.north, 0) >= 600
    if cluster.box.width < 360 * E7:
        for edge in (cluster.box.west, cluster.box.east):
            assert distance_m(where[0], where[1], where[0], edge) >= 299.9, "also where it is at a cell's edge"
        assert min(distance_m(e, 0, e, cluster.box.width) for e in (cluster.box.south, cluster.box.north)) >= 600


def test_panning_narrows_nothing_down():
    one = flight(604_518_000, 222_666_000)
    found = {
        cluster.box
        for step in range(20)
        for cluster in clusters_of([one], Box.between(60.44 + step / 5_000, 22.24, 60.47 + step / 5_000, 22.29))
    }
    assert len(found) == 1


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8) | st.integers(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(["id", "current_state", "position", "lat", "lng", "timestamp", "value", "recent_positions", "alt"]),
        inner, max_size=4,
    ),
    max_leaves=12,
)  # fmt: skip


@given(st.lists(JSON, max_size=4))
def test_flights_of_any_shape_are_read_or_left_out(flights):
    answer = FlightsAnswer.model_validate({"timestamp": {"value": "2027-01-15T08:00:00Z"}, "flights": flights})
    good, bad = answer.good()
    assert len(good) + bad == len(flights)
    for each in good:
        assert all(-900_000_000 <= state.lat <= 900_000_000 for state in each.states())
