"""Proofs, authorisations: as JSON and GeoJSON, filtered, paged, in two languages."""

from __future__ import annotations

import re

import pytest
from jsonschema import Draft202012Validator
from kit.description import document

from wonderland_backend.areas import Box
from wonderland_backend.errors import BadRequest
from wonderland_backend.languages import language_of
from wonderland_backend.narrowing import field
from wonderland_backend.proofs import queries

START_MS = 1_800_000_000_000
BOTH = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
both = pytest.mark.parametrize("database_url", BOTH, indirect=True)
DOCUMENT = document()
TURKU = "22.2,60.4,22.3,60.5"


def conforms(name, value):
    schema = {"$ref": f"#/components/schemas/{name}", "components": DOCUMENT["components"]}
    assert [each.message for each in Draft202012Validator(schema).iter_errors(value)] == []


@both
async def test_proofs_newest_first_and_each_by_itself(running, machine, number):
    async with machine("wonderland.proofs.read") as http:
        page = (await http.get("/api/v1/proofs")).json()
        conforms("ProofPage", page)
        assert [(each["uav_id"], each["outcome"]) for each in page["items"]] == [
            ("uav-2", "refuted"),
            ("uav-1", "verified"),
        ]
        proof = page["items"][1]
        assert (proof["proof_id"], proof["assurance"], proof["block"]) == (number("session", "one"), 2, 3)
        assert proof["measured"]["lat_e7"] == 604_518_900
        assert (proof["signed"]["error_mm"], proof["signed"]["likelihood_ppm"]) == (120, 999_000)
        answer = await http.get(f"/api/v1/proofs/{proof['proof_id']}")
        conforms("Proof", answer.json())
        assert answer.json() == proof
        known = {"If-None-Match": answer.headers["etag"]}
        assert (await http.get(f"/api/v1/proofs/{proof['proof_id']}", headers=known)).status_code == 304
        assert (await http.get(f"/api/v1/proofs/{'0' * 64}")).status_code == 404
        whole = await http.get("/api/v1/proofs")
        assert (await http.get("/api/v1/proofs", headers={"If-None-Match": whole.headers["etag"]})).status_code == 304


PLACE = {"lat_e7": 604_518_900, "lon_e7": 222_700_000, "height_mm": 42_000}
HEARD = {"outcome": "contradicted", "messages": 3, "attributed": 0, "supported": True}
FAR = {"error_mm": 36_060, "likelihood_ppm": 0, "tolerance_mm": 2_000}


@pytest.mark.parametrize(
    ("record", "shown"),
    [
        (HEARD | FAR | {"claim": PLACE | {"east_mm": 1}}, HEARD | FAR | {"place": PLACE}),
        (HEARD | {"outcome": "not_heard", "messages": 0}, HEARD | {"outcome": "not_heard", "messages": 0}),
        # What former contracts wrote convicts nobody here, either.
        (
            {"outcome": "refuted", "claim": PLACE, "error_mm": 9, "likelihood_ppm": 1, "reasons": []},
            HEARD | {"messages": 1, "supported": False, "place": PLACE, "error_mm": 9, "likelihood_ppm": 1},
        ),
    ],
)
def test_what_was_broadcast_is_a_finding_of_its_own(record, shown):
    found = queries.heard(record)
    assert found == shown
    conforms("BroadcastHeard", found)


@both
@pytest.mark.parametrize(
    ("query", "found"),
    [
        ("outcome=verified", ["uav-1"]),
        ("drone=uav-2", ["uav-2"]),
        ("pad=pad-2", []),
        ("operator=fleet", ["uav-2", "uav-1"]),
        ("operator=flee", []),
        ("operator=FinnMSP", []),
        (f"bbox={TURKU}", ["uav-2", "uav-1"]),
        ("bbox=0,0,1,1", []),
        ("bbox=179,-90,23,90", ["uav-2", "uav-1"]),
        (f"since_ms={START_MS + 5_000}", ["uav-2"]),
        (f"until_ms={START_MS + 5_000}", ["uav-1"]),
        ("limit=1", ["uav-2"]),
    ],
)
async def test_filters(running, query, found):
    answer = await running.get(f"/proofs?{query}")
    assert answer.status_code == 200, answer.text
    assert [each["uav_id"] for each in answer.json()["items"]] == found


async def test_the_link_leads_to_the_next_page(running):
    first = await running.get("/proofs?limit=1&operator=fleet")
    link = re.fullmatch(r'<(.+)>; rel="next"', first.headers["link"])[1]
    second = await running.http.get(link)
    assert [each["uav_id"] for each in second.json()["items"]] == ["uav-1"]
    assert "link" not in second.headers


async def test_geojson(running, number):
    answer = await running.get("/proofs", headers={"Accept": "application/geo+json"})
    assert answer.headers["content-type"] == "application/geo+json"
    collection = answer.json()
    assert collection["type"] == "FeatureCollection"
    feature = collection["features"][1]
    assert (feature["type"], feature["id"]) == ("Feature", number("session", "one"))
    assert feature["geometry"] == {"type": "Point", "coordinates": [22.2666, 60.45189, 42.0]}
    conforms("Proof", feature["properties"])
    single = await running.get(f"/proofs/{feature['id']}", headers={"Accept": "application/geo+json"})
    assert single.json() == feature
    plain = await running.get("/proofs", headers={"Accept": "application/json, application/geo+json"})
    assert "items" in plain.json()
    assert plain.headers["etag"] != answer.headers["etag"]


async def test_reasons_in_finnish(running, number):
    path = f"/proofs/{number('session', 'one')}"
    english = "Measured 0.12\u00a0m from the claim, within 1.00\u00a0m."
    facts = {"error_mm": 120, "buffer_mm": 1_000}
    for accept, language, text in (
        ("fi-FI,fi;q=0.9,en;q=0.5", "fi", "Mitattu 0,12\u00a0m päähän ilmoituksesta, 1,00\u00a0m puskurin sisälle."),
        ("sv, fi;q=0.1, en;q=0.5", "en", english),
        ("", "en", english),
        ("fi;q=0", "en", english),
        ("fi;q=x", "en", english),
    ):
        answer = await running.get(path, headers={"Accept-Language": accept})
        assert answer.headers["content-language"] == language
        assert answer.json()["signed"]["reasons"][0] == {
            "code": "within_buffer",
            "facts": facts,
            "text": text,
        }


@pytest.mark.parametrize("bbox", ["1,2,3", "a,b,c,d", "0,10,1,5", "0,-91,1,1", "181,0,182,1", "1e2,0,1,1", "1,2,3,4,5"])
async def test_boxes_that_are_none(running, bbox):
    answer = await running.get(f"/proofs?bbox={bbox}")
    assert answer.status_code in {400, 422}
    assert answer.headers["content-type"] == "application/problem+json"


def test_boxes_across_the_180th_meridian():
    box = Box.parse("170,-10,-170,10")
    assert box.holds(0, 1_750_000_000)
    assert box.holds(0, -1_750_000_000)
    assert not box.holds(0, 0)
    with pytest.raises(BadRequest):
        Box.parse("0,1,0,-1")


@both
async def test_authorisations(running, chain, facts):
    chain.add(facts.grant("uav-2", "b1"))
    await running.mirrored(chain.height)
    page = await running.json("/authorisations")
    conforms("AuthorisationPage", page)
    assert [(each["uav_id"], each["authorisation_id"]) for each in page["items"]] == [("uav-1", "a1"), ("uav-2", "b1")]
    first = await running.json("/authorisations", limit=1)
    second = await running.json("/authorisations", limit=1, cursor=first["next"])
    assert first["items"] + second["items"] == page["items"]
    for filters, count in (
        ({"drone": "uav-2"}, 1),
        ({"operator": "fleet"}, 2),
        ({"operator": "nobody"}, 0),
        ({"pad": "pad-1"}, 2),
        ({"revoked": "true"}, 0),
        ({"revoked": "false"}, 2),
    ):
        assert len((await running.json("/authorisations", **filters))["items"]) == count, filters


async def test_a_fleet_operators_machine_sees_its_own_drones_only(running, chain, facts, machine, tx, number):
    from wonderland.proofs.records import keys

    other = facts.uav("uav-3", msp_id="OtherMSP", operator_id="other")
    chain.add(tx("RegisterUav", {}, {keys.composite(keys.UAV, "uav-3"): other.encode()}), facts.grant("uav-3", "c1"))
    chain.add(facts.request("other", uav_id="uav-3"))
    chain.add(facts.decide("other", uav_id="uav-3"))
    await running.mirrored(chain.height)
    scopes = "wonderland.proofs.read wonderland.drones.read"
    async with machine(scopes, role="fleet_operator", msp_id="OtherMSP") as http:
        assert [each["uav_id"] for each in (await http.get("/api/v1/proofs")).json()["items"]] == ["uav-3"]
        assert [each["uav_id"] for each in (await http.get("/api/v1/authorisations")).json()["items"]] == ["uav-3"]
        assert (await http.get(f"/api/v1/proofs/{number('session', 'one')}")).status_code == 404


def test_a_field_cannot_be_forged_by_a_text_within_a_record():
    assert field("operator_id", 'a"b') == '"operator_id":"a\\"b"'


def test_languages_of_long_headers():
    class Request:
        headers = {"accept-language": "fi;q=0.1," * 1_000}  # noqa: RUF012

    assert language_of(Request()) == "fi"


@both
async def test_pads_drones_and_tracks_on_a_map(running):
    geo = {"Accept": "application/geo+json"}
    pads = (await running.get("/pads", headers=geo)).json()
    assert pads["features"][0]["geometry"] == {"type": "Point", "coordinates": [22.2666, 60.4518, 30.0]}
    pad = (await running.get("/pads/pad-1", headers=geo)).json()
    assert (pad["id"], pad["properties"]["pad_id"]) == ("pad-1", "pad-1")
    drones = (await running.get("/drones", headers=geo)).json()
    assert [each["geometry"] for each in drones["features"]] == [None, None], "nobody has heard them"
    assert (await running.get("/tracks", headers=geo)).json() == {"type": "FeatureCollection", "features": []}
    for path, count in (
        (f"/pads?bbox={TURKU}", 2),
        ("/pads?bbox=0,0,1,1", 0),
        ("/pads?operator=turku", 2),
        ("/pads?operator=nobody", 0),
        ("/drones?operator=fleet", 2),
        ("/drones?operator=nobody", 0),
        (f"/sessions?bbox={TURKU}", 3),
        ("/sessions?bbox=0,0,1,1", 0),
        ("/sessions?operator=fleet&outcome=refuted", 1),
        ("/sessions?operator=nobody", 0),
        (f"/verdicts?bbox={TURKU}", 2),
        ("/verdicts?bbox=0,0,1,1", 0),
        ("/verdicts?operator=fleet", 2),
        ("/verdicts?operator=nobody", 0),
        (f"/alerts?bbox={TURKU}&kind=refuted", 1),
        ("/alerts?bbox=0,0,1,1", 0),
        ("/alerts?operator=fleet&kind=refuted", 1),
        ("/alerts?operator=nobody", 0),
    ):
        assert len((await running.get(path)).json()["items"]) == count, path
