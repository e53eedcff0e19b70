"""The interface by which InterUSS tests geo-awareness, over real HTTP, with a real source of files."""

from __future__ import annotations

import asyncio
import json
import uuid

import pytest
from fastapi import FastAPI, Response

from wonderland_backend.uspace.geo_awareness import holds_sometime
from wonderland_backend.zones.files.reading import read
from wonderland_backend.zones.store import rows_of
from wonderland_backend.zones.zone import zone_of

SCOPE = "geo-awareness.test"
SOURCE = str(uuid.UUID(int=1, version=4))
SQUARE = [[22.26, 60.45], [22.28, 60.45], [22.28, 60.46], [22.26, 60.46], [22.26, 60.45]]
MONDAY = "2027-01-18"


def zone(identifier, restriction="PROHIBITED", **change):
    volume = {
        "uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL",
        "upperLimit": 120, "upperVerticalReference": "AGL",
        "horizontalProjection": {"type": "Polygon", "coordinates": [SQUARE]},
    }  # fmt: skip
    return {
        "identifier": identifier, "country": "FIN", "type": "COMMON", "restriction": restriction,
        "applicability": [{"permanent": "YES"}],
        "zoneAuthority": [{"name": "Traficom", "purpose": "INFORMATION", "siteURL": "https://traficom.example"}],
        "geometry": [volume | change.pop("volume", {})],
    } | change  # fmt: skip


def file(*zones):
    return json.dumps({"title": "Test", "features": list(zones)}).encode()


class Source:
    """A server of files."""

    def __init__(self):
        self.app = FastAPI()
        self.body = file(zone("EFP1"))
        self.status = 200
        self.asked = 0
        self.app.get("/zones.json")(self.zones)

    async def zones(self):
        self.asked += 1
        if self.status == 302:
            return Response(status_code=302, headers={"Location": "/elsewhere"})
        return Response(self.body, status_code=self.status, media_type="application/json")


@pytest.fixture
async def source(served):
    found = Source()
    async with served(found.app) as url:
        found.url = f"{url}/zones.json"
        yield found


@pytest.fixture
async def uss(new_uss):
    async with new_uss(test_harness=True) as found:
        yield found


async def put(uss, url, source_id=SOURCE, **more):
    body = {"https_source": {"url": url, "format": "ED-269"} | more}
    answer = await uss.ask("PUT", f"/geo-awareness/geozone_sources/{source_id}", SCOPE, json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()


async def check(uss, *filters):
    answer = await uss.ask(
        "POST", "/geo-awareness/geozones/check", SCOPE, json={"checks": [{"filterSets": [each]} for each in filters]}
    )
    assert answer.status_code == 200, answer.text
    return [each["geozone"] for each in answer.json()["applicableGeozone"]]


def at(lat=60.455, lng=22.27, height=60, reference="AGL", unit="M"):
    return {
        "position": {
            "uomDimensions": unit, "verticalReferenceType": reference, "height": height,
            "longitude": lng, "latitude": lat,
        }
    }  # fmt: skip


async def test_a_source_is_activated_asked_about_and_deactivated(uss, source):
    address = f"/geo-awareness/geozone_sources/{SOURCE}"
    assert (await uss.ask("GET", "/geo-awareness/status", SCOPE)).json() == {"status": "Ready"}
    assert (await uss.ask("GET", address, SCOPE)).status_code == 404
    assert await put(uss, source.url) == {"result": "Ready"}
    assert (await uss.ask("GET", address, SCOPE)).json() == {"result": "Ready"}
    assert await check(uss, at(), at(lat=61), at(height=200)) == ["Present", "Absent", "Absent"]
    assert (await uss.ask("DELETE", address, SCOPE)).json() == {"result": "Deactivating"}
    assert (await uss.ask("GET", address, SCOPE)).status_code == 404
    assert (await uss.ask("DELETE", address, SCOPE)).status_code == 404
    assert await check(uss, at()) == ["Absent"]


async def test_filters(uss, source):
    source.body = file(
        zone("EFP1", "PROHIBITED", uSpaceClass="C2"),
        zone("EFA2", "REQ_AUTHORISATION", volume={"upperLimit": 400, "uomDimensions": "FT"}),
        zone("EFT3", "CONDITIONAL", applicability=[
            {"permanent": "NO", "startDateTime": f"{MONDAY}T00:00:00Z", "endDateTime": "2027-02-01T00:00:00Z",
             "schedule": [{"day": ["MON"], "startTime": "08:00:00.00Z", "endTime": "10:00:00.00Z"}]},
        ]),
    )  # fmt: skip
    assert await put(uss, source.url) == {"result": "Ready"}
    only = [{"ed269": {"acceptableRestrictions": [each]}} for each in ("REQ_AUTHORISATION", "NO_RESTRICTION")]
    assert await check(uss, *only) == ["Present", "Absent"]
    assert await check(uss, {"ed269": {"uSpaceClass": "C2"}}, {"ed269": {"uSpaceClass": "C3"}}) == ["Present", "Absent"]
    # 400 ft are 121.92 m: of what asks for an authorisation there is something at 121 m, and nothing at 123 m.
    authorised = {"ed269": {"acceptableRestrictions": ["REQ_AUTHORISATION"]}}
    assert await check(uss, at(height=121) | authorised, at(height=123) | authorised) == ["Present", "Absent"]
    assert await check(uss, at(height=399, unit="FT") | authorised, at(height=401, unit="FT") | authorised) == [
        "Present",
        "Absent",
    ]
    # What cannot be told without the terrain is taken to be there.
    assert await check(uss, at(height=100, reference="AMSL") | authorised) == ["Present"]
    timed = {"ed269": {"acceptableRestrictions": ["CONDITIONAL"]}}
    spans = (
        ({"after": f"{MONDAY}T09:00:00Z", "before": f"{MONDAY}T09:30:00Z"}, "Present"),
        ({"after": f"{MONDAY}T11:00:00Z", "before": f"{MONDAY}T12:00:00Z"}, "Absent"),
        ({"after": "2027-01-26T00:00:00Z"}, "Absent"),  # no Monday is left
        ({"after": "2027-01-24T00:00:00Z"}, "Present"),
        ({"before": f"{MONDAY}T08:00:00Z"}, "Present"),  # that very moment is included
        ({"before": f"{MONDAY}T07:59:59Z"}, "Absent"),
        ({"after": f"{MONDAY}T09:00:00Z", "before": f"{MONDAY}T08:00:00Z"}, "Error"),
    )
    assert await check(uss, *(timed | span for span, _ in spans)) == [wanted for _, wanted in spans]


async def test_one_of_several_sets_is_enough_and_none_selects_nothing(uss, source):
    await put(uss, source.url)
    body = {"checks": [{"filterSets": [at(lat=61), at()]}, {"filterSets": []}, {"filterSets": [{}]}]}
    answer = await uss.ask("POST", "/geo-awareness/geozones/check", SCOPE, json=body)
    assert [each["geozone"] for each in answer.json()["applicableGeozone"]] == ["Present", "Absent", "Present"]


async def test_sources_that_cannot_be_had(uss, source, tmp_path):
    for status in (404, 500, 302):
        source.status = status
        told = await put(uss, source.url)
        assert told["result"] == "Error", status
        assert str(status) in told["message"]
    source.status = 200
    for url in ("http://127.0.0.1:1/zones.json", "https://localhost/zones.json", "http://10.0.0.1/z", "no address"):
        assert (await put(uss, url))["result"] == "Error", url
    asked = source.asked
    source.body = b"{" + b" " * (33 << 20) + b"}"
    told = await put(uss, source.url)
    assert (told["result"], "more than" in told["message"]) == ("Error", True)
    assert source.asked == asked + 1


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (b"no json", "valid JSON"),
        (b"{}", "ED-318"),
        (
            file(zone("EFP1", volume={"horizontalProjection": {"type": "Polygon", "coordinates": [SQUARE[:-1]]}})),
            "ring",
        ),
    ],
)
async def test_files_that_are_refused_leave_what_held(uss, source, body, said):
    await put(uss, source.url)
    source.body = body
    told = await put(uss, source.url)
    assert told["result"] == "Rejected"
    assert said in told["message"]
    assert await check(uss, at()) == ["Present"]


async def test_what_is_not_understood(uss, source):
    assert (await put(uss, source.url, format="KML"))["result"] == "Unsupported"
    answer = await uss.ask("PUT", f"/geo-awareness/geozone_sources/{SOURCE}", SCOPE, json={})
    assert answer.json()["result"] == "Unsupported"
    for method, path, body in (
        ("PUT", "/geo-awareness/geozone_sources/one", {}),
        ("POST", "/geo-awareness/geozones/check", {}),
        ("POST", "/geo-awareness/geozones/check", {"checks": [{"filterSets": [{"position": {"height": 1}}]}]}),
        ("POST", "/geo-awareness/geozones/check", {"checks": [{"filterSets": [{"after": "yesterday"}]}]}),
        ("POST", "/geo-awareness/geozones/check", {"checks": [{"filterSets": []}] * 201}),
    ):
        answer = await uss.ask(method, path, SCOPE, json=body)
        assert (answer.status_code, answer.headers["content-type"]) == (400, "application/problem+json"), answer.text


async def test_two_sources_at_once(uss, source):
    other = str(uuid.UUID(int=2, version=4))
    first, second = await asyncio.gather(put(uss, source.url), put(uss, source.url, other))
    # The same zone twice: whose it is must be clear.
    assert sorted([first["result"], second["result"]]) == ["Ready", "Rejected"]


async def test_only_with_the_scope_and_only_under_the_harness(uss, new_uss):
    for scope, status in ((SCOPE, 200), ("rid.inject_test_data", 403), (None, 401)):
        assert (await uss.get("/geo-awareness/status", scope=scope)).status_code == status
    async with new_uss() as closed:
        for method, path in (
            ("GET", "/geo-awareness/status"),
            ("PUT", f"/geo-awareness/geozone_sources/{SOURCE}"),
            ("DELETE", f"/geo-awareness/geozone_sources/{SOURCE}"),
            ("POST", "/geo-awareness/geozones/check"),
        ):
            assert (await closed.ask(method, path, SCOPE)).status_code == 404, path


def test_time_without_an_end():
    winter = zone("EFN1", applicability=[
        {"permanent": "NO", "schedule": [{"day": ["ANY"], "startEvent": "SR", "endEvent": "SS"}]},
    ])  # fmt: skip
    read_zone = zone_of(rows_of(read(file(winter)), "0" * 32)[0]["feature"])
    assert holds_sometime(read_zone, None, None)
    assert holds_sometime(read_zone, 1_800_000_000_000, None)
    assert holds_sometime(read_zone, None, 1_800_000_000_000)
    assert not holds_sometime(read_zone, 1_800_000_000_000, None, (None, 1_700_000_000_000))
    assert not holds_sometime(read_zone, None, 1_700_000_000_000, (1_800_000_000_000, None))
